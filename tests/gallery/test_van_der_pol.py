"""Van der Pol's oscillator: the table of the Reference-FMUs."""

import numpy as np
import pytest

from ballscrew.gallery.van_der_pol.findings import findings


def rates(_t, y, mu=1.0):
    return [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]]


def test_the_reference_fmus_table_is_what_explicit_euler_gives():
    y, course = np.array([2.0, 0.0]), []
    for _ in range(2000):
        y = y + 0.01 * np.array(rates(0.0, y))
        course.append(y[0])
    printed = {f.what: f.theirs for f in findings() if f.theirs is not None}
    assert course[-1] == pytest.approx(printed["x at 20 s, mu = 1"], abs=1e-5)
    peak = max(course[400:1000])  # of the turn whose peak the table has near 6.7 s
    assert peak == pytest.approx(printed["swing of x in the cycle, mu = 1"], abs=1e-5)
