"""What holds for every controller: ranges for tuning, anti-windup."""

import re
from pathlib import Path

import numpy as np
import pytest

from ballscrew.controllers import CONTROLLERS, tunable
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.kernel import Model

PAGE = Path(__file__).parents[2] / "docs" / "controllers.md"


def test_what_is_tunable_is_a_parameter_with_its_default_within_the_range():
    for name in [*CONTROLLERS, "pid+feed_forward"]:
        known = {p.name: p for p in component(name).all_parameters}
        assert tunable(name)
        for parameter, (low, high) in tunable(name).items():
            assert known[parameter].minimum <= min(low, 0.01 * low), name  # some tune further
            assert low <= known[parameter].default <= high, name
            assert high <= known[parameter].maximum, name
    assert {*tunable("pid+feed_forward")} == {*tunable("pid"), "Kvff", "Kaff", "Kfff"}


@pytest.mark.ci
@pytest.mark.parametrize(
    "name", ["iol", "lqi", "p_pi", pytest.param("super_twisting", marks=pytest.mark.prove)]
)
def test_the_figures_of_the_page_are_those_of_a_run(name):
    (row,) = re.findall(
        rf"^{name} +([-\d.e]+) +([-\d.e]+) +([-\d.e]+) ", PAGE.read_text("utf-8"), re.M
    )
    peak, settling, overshoot = map(float, row)
    model = Model(loop_kernel("plant", name))
    model.set_input("x_d", 0.08)
    model.settle(0.0)
    run = model.simulate(np.linspace(0.0, 2.0, 2001))
    outside = np.flatnonzero(np.abs(run.outputs["x"] - 0.08) > 0.02 * 0.08)[-1]
    assert np.abs(run.outputs["u"]).max() == pytest.approx(peak, abs=0.01)
    assert run.time[outside] == pytest.approx(settling, abs=2e-3)
    assert max(0.0, run.outputs["x"].max() - 0.08) == pytest.approx(overshoot, rel=0.02, abs=1e-8)
