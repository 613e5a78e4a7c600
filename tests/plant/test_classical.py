"""Classical friction, sticking and sliding as modes, against exact and independent solutions."""

import numpy as np
import pytest
from scipy.optimize import bisect

from ballscrew.plant.classical import classical, with_sticking
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    Component,
    ForceBalance,
    ForceTerm,
    Input,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import Model

FC, FS, VS, SIGMA2 = 1.284, 2.35, 1.13975e-3, 173.0
STIFFNESS, BELT = 100.0, 0.1


def pushed():
    """A mass of 1 kg with classical friction and a force on it."""
    friction = classical(symbol("v"))
    return with_sticking(
        Component(
            "pushed",
            "a mass on the ground",
            inputs=(Input("F", "N", "force"),),
            states=(State("x", "m", "position", symbol("v")), State("v", "m/s", "velocity")),
            outputs=(Output("x", "m", "position", symbol("x")),),
            balances=(
                ForceBalance(
                    "v",
                    symbol("v") * 0 + 1,
                    (ForceTerm("push", symbol("F"), "from outside"), friction),
                ),
            ),
        )
    )


def on_a_belt():
    """A mass on a spring, dragged by a belt, in the belt's frame."""
    v, s, k = symbol("v"), symbol("s"), symbol("k")
    return with_sticking(
        Component(
            "belt",
            "a mass on a belt and a spring",
            parameters=(
                Parameter("k", STIFFNESS, "N/m", "spring", "example value"),
                Parameter("V", BELT, "m/s", "speed of the belt", "example value"),
            ),
            states=(
                State("x", "m", "position on the belt", v),
                State("v", "m/s", "velocity on the belt"),
                State("s", "m", "elongation of the spring", v + symbol("V")),
            ),
            outputs=(Output("s", "m", "elongation of the spring", s),),
            balances=(
                ForceBalance("v", 1 + 0 * v, (ForceTerm("spring", -k * s, "spring"), classical(v))),
            ),
        )
    )


def switches(model, start, stop):
    """Time within (start, stop) at which it sticks or slips, by bisection on fresh runs."""

    def stuck(t):
        probe = model()
        probe.advance(0.0, t)
        return probe.outputs(t, probe.x)["stuck"]

    return bisect(lambda t: 0.5 - abs(stuck(t) - stuck(start)), start, stop, xtol=1e-12)


def test_stick_and_slip_on_a_belt_take_the_exact_times():
    """With Coulomb friction 1 N above a break-away of 2 N; the Stribeck velocity is made so small
    that the fall between the two is over before the mass has moved a nanometre."""
    kernel = generate(on_a_belt())
    values = {"Fc": 1.0, "Fs": 2.0, "Vs": 1e-9, "sigma2": 0.0}

    def model():
        return Model(kernel, values, 1e-11)

    omega = np.sqrt(STIFFNESS)
    excess = 1.0 / STIFFNESS
    break_away = 2.0 / STIFFNESS / BELT
    slip = (2 * np.pi - 2 * np.arctan(excess * omega / BELT)) / omega
    stick = 2 * excess / BELT
    assert switches(model, 1e-6, break_away + 0.01) == pytest.approx(break_away, abs=1e-10)
    ends = switches(model, break_away + 1e-3, break_away + slip + 1e-3)
    assert ends == pytest.approx(break_away + slip, abs=2e-7)
    again = switches(model, ends + 1e-3, ends + stick + 1e-3)
    assert again - ends == pytest.approx(stick, abs=2e-6)


def test_while_stuck_friction_is_the_force_applied_and_nothing_moves():
    model = Model(generate(pushed()))
    for force in (0.5, -1.0, 2.349, -2.349):
        model.set_input("F", force)
        model.advance(0.0, 1.0)
        y = model.outputs(1.0, model.x)
        assert (y["friction"], y["stuck"]) == (force, 1.0)
        assert model.x.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("direction", [1, -1])
def test_it_breaks_away_at_the_static_force_and_not_below(direction):
    kernel = generate(pushed())
    for force, mode in ((FS * (1 - 1e-12), "stuck"), (FS * (1 + 1e-12), "sliding")):
        model = Model(kernel)
        model.set_input("F", direction * force)
        model.advance(0.0, 1.0)
        assert (model.mode == "stuck") == (mode == "stuck")


@pytest.mark.parametrize("velocity", [1e-3, -2e-3])
def test_sliding_friction_is_the_stribeck_curve(velocity):
    model = Model(generate(pushed()), {"v_start": velocity})
    model.settle(0.0)
    speed = abs(velocity)
    curve = FC + (FS - FC) * np.exp(-((speed / VS) ** 2)) + SIGMA2 * speed
    y = model.outputs(0.0, model.x)
    assert y["friction"] == pytest.approx(np.sign(velocity) * curve, rel=1e-14)


def test_a_reversal_under_a_large_force_does_not_stick():
    """With 1 N of Coulomb friction it slows down at 11 m/s^2 and turns back at 9 m/s^2."""
    values = {"Fc": 1.0, "Fs": 1.0, "sigma2": 0.0, "v_start": 0.02}
    model = Model(generate(pushed()), values, 1e-11)
    model.set_input("F", -10.0)
    model.advance(0.0, 0.01)
    assert model.mode == "backward"
    assert model.info[4] == 3  # into motion, to rest, away from it
    turn = 0.02 / 11.0
    back = 0.01 - turn
    np.testing.assert_allclose(model.x, [0.01 * turn - 4.5 * back**2, -9.0 * back], rtol=1e-10)


def test_a_force_added_after_the_modes_is_refused_since_they_would_not_feel_it():
    with pytest.raises(ContractError, match="add forces before the modes"):
        pushed().with_force(ForceTerm("more", symbol("F"), "more"))
    with pytest.raises(ContractError, match="needs a force balance of 'v' with a term 'friction'"):
        with_sticking(pushed())
