"""Verdicts and exponents of systems and loops with delays."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import lambertw

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.component import (
    Component,
    Delay,
    DiscreteState,
    Input,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.errors import UserError
from ballscrew.stability.attractor import Kind
from ballscrew.stability.lyapunov import loop_lyapunov

X, LATE, GAIN = map(symbol, ("x", "late", "r"))


def parts() -> tuple[Component, Component]:
    """An integrator that hears its command late, under a gain."""
    u = symbol("u")
    plant = Component(
        "plant",
        "integrator",
        parameters=(Parameter("tau", 0.7, "s", "delay", "made up"),),
        inputs=(Input("u", "1", "command", law=("x",)),),
        states=(State("x", "1", "x", symbol("heard"), start=0.3),),
        outputs=(Output("x", "1", "x", X),),
        delays=(Delay("heard", u, symbol("tau")),),
    )
    controller = Component(
        "gain",
        "gain",
        parameters=(Parameter("K", 1.0, "1", "gain", "made up"),),
        inputs=(
            Input("x", "1", "x", role="measurement"),
            Input("x_d", "1", "set-point", role="reference"),
        ),
        outputs=(Output("u", "1", "command", symbol("K") * (symbol("x_d") - X)),),
    )
    return plant, controller


@pytest.mark.parametrize("gain", [pytest.param(1.0, marks=pytest.mark.ci), 2.0, 2.4])
def test_a_loop_with_a_delay_is_stable_up_to_its_gain(gain: float) -> None:
    """s = -K exp(-0.7 s): stable while 0.7 K is less than pi / 2, which is K = 2.244."""
    plant, controller = parts()
    run = loop_lyapunov(
        Loop(controller, plant, reference=0.0, stop=20.0, controller_values={"K": gain}),
        tolerance=1e-9,
    )
    if gain > np.pi / 1.4:
        assert run.motion.kind is Kind.DIVERGES
        return
    assert run.motion.kind is Kind.FIXED_POINT
    assert run.motion.limit is not None
    exact = np.sort([lambertw(-0.7 * gain, k).real / 0.7 for k in range(-5, 6)])[::-1]
    assert run.motion.limit[:3] == pytest.approx(exact[:3], abs=1e-6)
    assert run.method == "one solver; 16 nodes along each delay, whose own exponents are last"


def test_a_loop_that_is_sampled_and_has_delays_is_refused_in_one_line() -> None:
    plant, controller = parts()
    (command,) = controller.outputs
    sampled = Component(
        "held_gain",
        "gain, held",
        parameters=controller.parameters,
        inputs=controller.inputs,
        outputs=(Output("u", "1", "command", symbol("held")),),
        discrete=(DiscreteState("held", "1", "command", command.value),),
        sample_time=Parameter("T", 0.1, "s", "period", "made up"),
    )
    with pytest.raises(UserError, match="has delays and is sampled; tangents of both"):
        loop_lyapunov(Loop(sampled, plant, reference=0.0, stop=5.0))
