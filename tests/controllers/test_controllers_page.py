"""The table on docs/controllers.md against runs of the same loops, for as long as a step lasts."""

import re
from pathlib import Path

import numpy as np
import pytest

from ballscrew.controllers import CONTROLLERS
from ballscrew.orchestration.whole_loop import loop_kernel
from ballscrew.solver.kernel import Model

PAGE = (Path(__file__).parents[2] / "docs" / "controllers.md").read_text("utf-8")
ROWS = {
    name: list(map(float, figures.split()))
    for name, figures in re.findall(r"^(\w+) +((?:[-\d.e]+ +){5})monolithic", PAGE, re.M)
}
FAST = [n for n, (_, settling, *_) in ROWS.items() if settling < 2.0]


def test_the_table_has_every_continuous_controller():
    left_out = {n for n in CONTROLLERS if n not in ROWS}
    assert left_out == {
        "iol_true_acceleration",
        "pid_sampled",
        "iol_sampled",
        "nctf_sampled",
        "pid_encoder",
    }


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.long) if n == "fuzzy_pd_i" else n for n in FAST],
)
def test_peak_settling_and_overshoot_are_those_of_a_run(name):
    """The slow ones, PIDs and NCTF, are left to the page's own command."""
    model = Model(loop_kernel("plant", name))
    model.set_input("x_d", 0.08)
    model.settle(0.0)
    run = model.simulate(np.linspace(0.0, 4.0, 4001))
    error = np.abs(run.outputs["x"] - 0.08)
    outside = np.flatnonzero(error > 0.02 * 0.08)[-1]
    peak, settling, overshoot, *_ = ROWS[name]
    assert np.abs(run.outputs["u"]).max() == pytest.approx(peak, abs=0.01)
    assert run.time[outside] == pytest.approx(settling, abs=2e-3)
    assert max(0.0, run.outputs["x"].max() - 0.08) == pytest.approx(overshoot, rel=0.02, abs=1e-8)
