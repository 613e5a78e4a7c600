"""Pictures of runs: small however long the run, with every peak, and nothing hidden."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.orchestration.loop.pictures import rows_over_plane, rows_over_time


@given(st.integers(0, 2**32 - 1), st.integers(500, 3000), st.integers(2, 50))
@settings(max_examples=50, deadline=None)
def test_thinned_courses_keep_their_ends_and_the_extremes_of_every_column(seed, count, columns):
    random = np.random.default_rng(seed)
    t = np.cumsum(random.exponential(size=count))
    values = random.standard_cauchy(count)
    rows = rows_over_time(t, values, columns)
    assert np.all(np.diff(rows) > 0)
    assert (rows[0], rows[-1]) == (0, count - 1)
    assert len(rows) <= 4 * columns or len(rows) == count
    column = np.searchsorted(np.linspace(t[0], t[-1], columns + 1)[1:-1], t, side="right")
    for k in np.unique(column):
        inside, shown = values[column == k], values[rows[column[rows] == k]]
        assert (inside.min(), inside.max()) == (shown.min(), shown.max())


@given(st.integers(0, 2**32 - 1), st.integers(3, 3000))
@settings(max_examples=50, deadline=None)
def test_thinned_curves_keep_their_extremes_and_leave_out_nothing_that_could_be_seen(seed, count):
    random = np.random.default_rng(seed)
    points = np.cumsum(
        random.standard_normal((count, 2)) * random.choice([1e-3, 1.0], count)[:, None], axis=0
    )
    rows = rows_over_plane(points, 100)
    shown = points[rows]
    assert (rows[0], rows[-1]) == (0, count - 1)
    assert np.array_equal(shown.min(axis=0), points.min(axis=0))
    assert np.array_equal(shown.max(axis=0), points.max(axis=0))
    before = rows[np.searchsorted(rows, np.arange(count), side="right") - 1]
    span = np.ptp(points, axis=0)
    assert np.all(np.abs(points - points[before]) <= span / 100 * (1 + 1e-9))
