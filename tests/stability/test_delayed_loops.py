"""Verdicts and exponents of systems and loops with delays."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.special import lambertw

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.codegen import generate
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
from ballscrew.solver.for_tangents import with_delay_states
from ballscrew.solver.kernel import Kernel, Model
from ballscrew.stability.attractor import Kind
from ballscrew.stability.lyapunov import LyapunovRun, loop_lyapunov, lyapunov

X, LATE, GAIN = map(symbol, ("x", "late", "r"))


@pytest.fixture(scope="module")
def wright() -> Kernel:
    """x' = -r x(t - 1) (1 + x): at rest up to r = pi / 2, then a cycle."""
    return generate(
        with_delay_states(
            Component(
                "wright",
                "Wright's equation.",
                parameters=(Parameter("r", 1.0, "1", "parameter", "test"),),
                states=(State("x", "1", "x", -GAIN * LATE * (1 + X), 0.1),),
                outputs=(Output("x", "1", "x", X),),
                delays=(Delay("late", X, sp.Float(1.0), start=0.1),),
            )
        )
    )


def judged(kernel: Kernel, stop: float, **values: float) -> LyapunovRun:
    return lyapunov(lambda tolerance: Model(kernel, values, tolerance), stop, 1e-9)


@pytest.mark.prove
def test_beyond_the_border_it_is_a_cycle_with_one_exponent_of_zero(wright: Kernel) -> None:
    run = judged(wright, 60.0, r=1.8)
    assert run.motion.kind is Kind.CYCLE
    assert run.motion.limit is not None
    assert run.motion.period == pytest.approx(4.1, abs=0.2)
    assert abs(run.motion.limit[0]) < 1e-4
    assert run.motion.limit[1] < -0.05


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
