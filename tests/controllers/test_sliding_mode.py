"""Sliding mode: reaching time, boundary layer and surface in closed form; where the block
sticks."""

import linear_axis as la
import numpy as np
import pytest

from ballscrew.controllers.sliding_mode import sliding_mode
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.kernel import Model

DEFAULT = {p.name: p.default for p in sliding_mode().parameters}
SLOPE, LEVEL, LAYER = DEFAULT["slope"], DEFAULT["level"], DEFAULT["layer"]
FALL = la.B / la.LAG * LEVEL  # of |s| outside the layer, m/s^2
POLE = FALL / LAYER


def test_s_falls_in_a_straight_line_then_with_the_layer_s_pole():
    reached = (SLOPE * 0.08 - LAYER) / FALL
    assert reached == pytest.approx(0.0849, abs=1e-4)
    times = np.concatenate([np.linspace(0, reached, 30), reached + np.linspace(0, 1.5e-3, 31)[1:]])
    run = la.loop(la.rigid(), sliding_mode(), u_max=1e3).simulate(times)
    s = run.outputs["v"] + SLOPE * (run.outputs["x"] - 0.08)
    before = -SLOPE * 0.08 + FALL * times
    after = -LAYER * np.exp(-POLE * (times - reached))
    np.testing.assert_allclose(s, np.where(times <= reached, before, after), atol=1e-8)


def test_on_the_surface_the_error_decays_with_the_slope():
    times = np.linspace(0.0, 1.2, 7)
    error = la.loop(la.rigid(), sliding_mode(), u_max=1e3).simulate(times).outputs["x"] - 0.08
    wanted = error[1] * np.exp(-SLOPE * (times[1:] - times[1]))
    np.testing.assert_allclose(error[1:], wanted, rtol=1e-7)


@pytest.mark.ci
def test_the_block_sticks_within_the_error_that_static_friction_holds():
    goal = 0.08
    model = Model(loop_kernel("plant", "sliding_mode"))
    model.set_input("x_d", goal)
    run = model.simulate([0.0, 3.0, 4.0])
    left = abs(goal - run.outputs["x"])
    assert left[2] == pytest.approx(left[1], rel=0.01)
    assert 0.5 * 1.284 / (la.M * SLOPE * POLE) < left[2] < 2.35 / (la.M * SLOPE * POLE)
