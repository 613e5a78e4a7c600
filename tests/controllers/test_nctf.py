"""NCTF: the printed figures, and both ways of its design procedure."""

import numpy as np
import pytest

from ballscrew.controllers.nctf import design, nctf
from ballscrew.orchestration.loop.closed_loop import metrics
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.orchestration.master.reference_signal import Reference


def test_printed_design_of_the_nominal_plant_gives_the_printed_gains():
    d = design()
    assert d.stopping_time == pytest.approx(0.1, rel=1e-3)
    assert d.proportional == pytest.approx(379.4, rel=1e-3)
    assert d.integral == pytest.approx(1897, rel=1e-3)
    assert d.coefficient == pytest.approx(13.25, rel=1e-3)
    defaults = {p.name: p.default for p in nctf().parameters}
    assert defaults["Kp"] == pytest.approx(2 * 0.3 * 3 * 30 / (1.193 * 0.1193), rel=1e-12)
    assert (defaults["h"], defaults["c"]) == (0.1193, 13.25)
    assert defaults["Ki"] == pytest.approx(9 * 30 / (1.193 * 0.1193), rel=1e-12)


@pytest.mark.ci
def test_fitted_design_takes_everything_from_the_simulated_step():
    d = design(mode="fitted")
    assert d.speed == pytest.approx(0.1190, abs=5e-5)
    assert d.stopping_time == pytest.approx(1.3988e-3, rel=1e-4)  # a percent of the speed is left
    assert d.coefficient == pytest.approx(33495, rel=1e-4)  # not the printed 13.25
    assert d.proportional == pytest.approx(5.33096, rel=1e-4)
    assert d.fit_error == pytest.approx(0.033265, rel=1e-3)


@pytest.mark.parametrize(("sigma0", "stopping_time"), [(0.7, 0.142), (1.3, 0.077)])
def test_a_perturbed_plant_gives_its_own_printed_design(sigma0, stopping_time):
    d = design({"sigma0": sigma0 * 66967.231})
    assert d.stopping_time == pytest.approx(stopping_time, abs=1e-3)
    assert d.coefficient * d.stopping_time == pytest.approx(1.325)


def test_published_figures_of_the_nominal_step():
    run = run_monolithic(Loop("nctf", reference=Reference.constant(0.08), stop=20.0), 1e-3)
    m = metrics(run)
    assert m["settling_time_2pct"] == pytest.approx(2.10, abs=0.005)
    assert m["overshoot"] == pytest.approx(0.06e-3, abs=2e-6)
    assert abs(m["steady_state_error"]) < 1e-9
    mirrored = run_monolithic(Loop("nctf", reference=Reference.constant(-0.08), stop=20.0), 1e-3)
    np.testing.assert_allclose(mirrored.outputs["x"], -run.outputs["x"], atol=1e-9)
