"""Pictures of runs: small however long the run, with every peak, and nothing hidden."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.orchestration import pictures
from ballscrew.orchestration.closed_loop_result import ClosedLoopResult
from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.loop_run import LoopRun
from ballscrew.orchestration.thinning import rows_over_plane, rows_over_time
from ballscrew.orchestration.verdict import Verdict
from ballscrew.results.run_result import RunResult

LONG = 200_000


def result(name="pid", steps=2000, stop=20.0, spike=0.0, noise=0.0):
    """A motion to 8 cm, its voltage with a spike in one step, as a run would record it."""
    t = np.linspace(0.0, stop, steps + 1)
    shaken = noise * np.random.default_rng(1).standard_normal(len(t))
    x = 0.08 * (1 - np.exp(-2 * t)) + 1e-3 * shaken
    u = 10 * np.exp(-t) + shaken
    u[0] += spike
    v = 0.16 * np.exp(-2 * t) + 1e-2 * shaken
    run = LoopRun(
        time=t,
        outputs={"x": x, "v": v, "z": 1e-5 * np.tanh(t), "i": 0.1 * u, "friction": v},
        commands={"u": u},
        reference=np.full(len(t), 0.08),
        coupling=Coupling.INTERFACE_JACOBIAN,
        coupling_reason="as asked",
        corrected=True,
        residual_max={"u": 0.0},
        effect_rate_max={},
        macro_steps=steps,
        step_range=(1e-3, 1e-3),
        verdict=Verdict(True, "", ""),
    )
    return ClosedLoopResult(Loop(name), run)


def test_a_picture_ends_soon_after_the_motion_and_says_so():
    figures = pictures.run_figures(result())  # within 0.5 % of its range after 2.65 s
    for name in ("position", "voltage", "states"):
        axes = figures[name].axes[-1]
        assert 5.0 < axes.get_xlim()[1] < 7.5  # the voltage takes 5.3 s
        assert "at rest from here to 20 s" in axes.get_xlabel()
    shaking = pictures.run_figures(result(noise=1.0))["position"].axes[0]
    assert shaking.get_xlim()[1] >= 20.0
    assert shaking.get_xlabel() == "time [s]"


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


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize("scale", [1e308, 1.7e308])
def test_a_picture_that_cannot_be_drawn_costs_no_result(scale, tmp_path, capsys):
    """A voltage near the largest number, to and fro: its range is none."""
    found = result()
    found.run.commands["u"][:] = scale * np.sign(np.cos(np.arange(2001)))
    RunResult.of(found).save(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} >= {"trajectory.csv", "metrics.json", "states.png"}
    assert not (tmp_path / "voltage.png").exists()
    said = capsys.readouterr().err
    assert said.startswith("note: a picture could not be drawn: ")
    assert len(said.splitlines()) == 1


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_pictures_of_long_runs_are_small_and_soon_done(tmp_path, noise, monkeypatch):
    monkeypatch.setenv("BALLSCREW_SVG", "1")
    begin = time.process_time()
    RunResult.of(result(steps=LONG, noise=noise)).save(tmp_path)
    assert time.process_time() - begin < 60  # one path for each step took minutes
    for stem in ("position", "voltage", "states", "phase"):
        assert (tmp_path / f"{stem}.svg").stat().st_size < 2e6, stem
    assert (tmp_path / "phase.svg").stat().st_size < 5e5


def test_a_comparison_shows_every_peak_on_one_time_axis_with_legends_beside_the_curves():
    figure = pictures.comparison_figure([result("nctf", LONG, spike=25.6), result("pid")])
    figure.canvas.draw()
    position, fine, voltage = figure.axes
    assert position.get_xlim() == fine.get_xlim() == voltage.get_xlim()
    low, high = voltage.get_xlim()
    assert low < -0.01 * high  # a peak at t = 0 does not lie on the frame
    shown = [text.get_text() for text in voltage.get_legend().get_texts()]
    assert shown == ["35.6 V at 0 s", "10.0 V at 0 s"]
    peaks = [tuple(line.get_xydata()[0]) for line in voltage.lines if line.get_marker() == "o"]
    assert peaks == [(0.0, 35.6), (0.0, 10.0)]
    for axes in (position, voltage):
        assert axes.get_legend().get_window_extent().x0 >= axes.bbox.x1
