"""Verdicts and exponents of loops that are sampled or have delays."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.special import lambertw

from ballscrew import Component, Delay, DiscreteState, Input, Loop, Output, Parameter, State, symbol
from ballscrew.solver.codegen import generate
from ballscrew.solver.errors import UserError
from ballscrew.solver.for_tangents import with_held_states
from ballscrew.solver.kernel import Kernel, Model
from ballscrew.stability.attractor import Kind
from ballscrew.stability.lyapunov import LyapunovRun, loop_lyapunov, lyapunov

PERIOD = 0.05


def kernel(states: dict[str, sp.Expr], held: dict[str, sp.Expr]) -> Kernel:
    component = Component(
        name="system",
        description="A sampled system.",
        parameters=(Parameter("r", 1.0, "1", "parameter", "test"),),
        states=tuple(State(n, "1", n, sp.sympify(e), 0.3) for n, e in states.items()),
        discrete=tuple(DiscreteState(n, "1", n, sp.sympify(e), 0.3) for n, e in held.items()),
        outputs=(Output("y", "1", "output", symbol(next(iter(states or held)))),),
        sample_time=Parameter("T", PERIOD, "s", "period", "test", minimum=1e-6),
    )
    return generate(with_held_states(component))


def judged(kernel: Kernel, stop: float, **values: float) -> LyapunovRun:
    return lyapunov(lambda tolerance: Model(kernel, values, tolerance), stop, 1e-10)


@pytest.fixture(scope="module")
def logistic() -> Kernel:
    d = symbol("d")
    return kernel({}, {"d": symbol("r") * d * (1 - d)})


def test_a_stable_fixed_point_of_a_map_has_the_logarithm_of_its_slope(logistic: Kernel) -> None:
    run = judged(logistic, 5.0, r=2.8)
    assert run.motion.kind is Kind.FIXED_POINT
    assert run.motion.equilibrium is not None
    assert run.motion.equilibrium.state[0] == pytest.approx(1 - 1 / 2.8, rel=1e-8)
    assert run.motion.limit == pytest.approx([np.log(0.8) / PERIOD], rel=1e-6)


@pytest.mark.parametrize(("r", "samples"), [(3.2, 2), (3.5, 4), (3.83, 3)])
def test_cycles_of_the_logistic_map_close_after_their_samples(
    logistic: Kernel, r: float, samples: int
) -> None:
    run = judged(logistic, 20.0, r=r)
    assert run.motion.kind is Kind.CYCLE
    assert run.motion.period == pytest.approx(samples * PERIOD, rel=1e-9)
    orbit = [0.3]
    for _ in range(5000):
        orbit.append(r * orbit[-1] * (1 - orbit[-1]))
    slopes = np.abs(r * (1 - 2 * np.array(orbit[-12:])))
    assert run.motion.limit == pytest.approx([np.log(slopes).mean() / PERIOD], rel=1e-5)


def test_an_invariant_circle_is_a_cycle_that_no_sampling_period_divides() -> None:
    """The delayed logistic map just beyond its Neimark-Sacker bifurcation at r = 2."""
    a, b = symbol("a"), symbol("b")
    run = judged(kernel({}, {"a": symbol("r") * a * (1 - b), "b": a}), 50.0, r=2.05)
    assert run.motion.kind is Kind.CYCLE
    assert "no sampling period divides" in run.motion.evidence
    assert run.motion.period == pytest.approx(6.0 * PERIOD, rel=0.1)  # the sixth root of one
    assert run.motion.limit is not None
    assert abs(run.motion.limit[0]) * PERIOD < 1e-3


def test_a_mass_under_a_sampled_law_loses_stability_where_its_map_does() -> None:
    """x'' = u with u = -r (x + 2 x') held: a factor is -1 where r is 1 / T = 20."""
    x, v, h = symbol("x"), symbol("v"), symbol("h")
    loop = kernel({"x": v, "v": h}, {"h": -symbol("r") * (x + 2 * v)})
    for gain in (1.0, 10.0):
        generator = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
        update = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-gain, -2.0 * gain, 0.0]])
        step = np.eye(3) + generator * PERIOD + generator @ generator * PERIOD**2 / 2
        factors = np.abs(np.linalg.eigvals(step @ update))
        run = judged(loop, 10.0, r=gain)
        exact = np.log(np.sort(factors)[::-1][:2]) / PERIOD
        assert run.motion.kind is Kind.FIXED_POINT
        assert run.motion.limit is not None
        assert run.motion.limit[:2] == pytest.approx(exact, rel=1e-6)
        assert run.motion.limit[2] == -np.inf
    assert judged(loop, 10.0, r=19.9).motion.kind is Kind.FIXED_POINT
    assert judged(loop, 10.0, r=20.1).motion.kind is Kind.DIVERGES


@pytest.mark.prove
def test_quantized_loops_have_the_exponents_of_the_average_and_the_verdict_of_the_staircase() -> (
    None
):
    exact = loop_lyapunov(Loop("pid_sampled", "plant_classical", stop=2.0), tolerance=1e-9)
    values = {"position_encoder_resolution": 0.05}
    values |= {f"position_encoder_{n}_harmonic": 0.0 for n in ("first", "second")}
    run = loop_lyapunov(
        Loop(
            "pid_sampled+position_encoder",
            "plant_classical",
            reference=0.08,
            stop=2.0,
            controller_values=values,
        ),
        tolerance=1e-9,
    )
    assert "average with dither" in run.method
    assert run.exponents == pytest.approx(exact.exponents, rel=1e-6)
    assert run.motion.kind is Kind.BOUNDED  # it hunts from count to count
    assert run.motion.amplitude["plant_x"] > 1e-5


# -- delays --------------------------------------------------------------------------------------


X = symbol("x")


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
    assert run.motion.limit[:3] == pytest.approx(exact[:3], abs=1e-7)
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
