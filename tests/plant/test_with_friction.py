"""Bodies that stick and slide, with classical friction or one's own, against exact solutions."""

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import bisect

import ballscrew as bs
from ballscrew import ForceTerm, Parameter, State, symbol, with_friction
from ballscrew.plant.classical import classical, with_sticking
from ballscrew.plant.direct_drive import direct_drive
from ballscrew.solver.codegen import generate
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import Model

FS, STIFFNESS, BREAK_AWAY = 2.35, 100.0, 3.0


def block_on_belt(damping=0.0):
    """A mass of 1 kg on a spring; v is its speed on the belt."""
    x, v = symbol("x"), symbol("v")
    spring = ForceTerm("spring", -STIFFNESS * x, "a spring")
    damper = ForceTerm("damper", -damping * (v + symbol("belt")), "to the ground")
    return bs.Component(
        "block",
        "A mass on a spring on a belt",
        parameters=(Parameter("belt", 0.5, "m/s", "speed of the belt", "test"),),
        states=(
            State("x", "m", "position", v + symbol("belt")),
            State("v", "m/s", "speed on the belt", nominal=0.1),
        ),
        outputs=(bs.Output("x", "m", "position", x),),
        balances=(bs.ForceBalance("v", 1, (spring, damper)),),
    )


def falling():
    """Friction that falls with the speed of sliding, as no law of the catalogue does."""
    curve = symbol("F0") / (1 + 3 * sp.Abs(symbol("v")))
    largest = Parameter("F0", BREAK_AWAY, "N", "largest friction", "test")
    return ForceTerm("friction", -sp.sign(symbol("v")) * curve, "falling", parameters=(largest,))


def test_stick_and_slip_on_a_belt_take_the_exact_times():
    """With Coulomb friction 1 N above a break-away of 2 N; the Stribeck velocity is made so small
    that the fall between the two is over before the mass has moved a nanometre."""
    kernel, belt = generate(with_friction(block_on_belt(), "classical")), 0.1
    values = {"Fc": 1.0, "Fs": 2.0, "Vs": 1e-9, "sigma2": 0.0, "belt": belt}

    def stuck(t):
        probe = Model(kernel, values, 1e-11)
        probe.advance(0.0, t)
        return probe.outputs(t, probe.x)["stuck"]

    def switches(start, stop):
        """Time within (start, stop) at which it sticks or slips, by bisection on fresh runs."""
        return bisect(lambda t: 0.5 - abs(stuck(t) - stuck(start)), start, stop, xtol=1e-12)

    omega, excess = np.sqrt(STIFFNESS), 1.0 / STIFFNESS
    break_away = 2.0 / STIFFNESS / belt
    slip = (2 * np.pi - 2 * np.arctan(excess * omega / belt)) / omega
    stick = 2 * excess / belt
    assert switches(1e-6, break_away + 0.01) == pytest.approx(break_away, abs=1e-10)
    ends = switches(break_away + 1e-3, break_away + slip + 1e-3)
    assert ends == pytest.approx(break_away + slip, abs=2e-7)
    again = switches(ends + 1e-3, ends + stick + 1e-3)
    assert again - ends == pytest.approx(stick, abs=2e-6)


def test_while_stuck_friction_is_the_force_applied_and_nothing_moves():
    """Up to the static force, either way, and not beyond it."""
    model = Model(generate(direct_drive(classical)))
    for force in (0.5, -1.0, FS * (1 - 1e-12), -FS * (1 - 1e-12)):
        model.set_input("u", force)
        model.advance(0.0, 1.0)
        y = model.outputs(1.0, model.x)
        assert (y["friction"], y["stuck"]) == (force, 1.0)
        assert model.x.tolist() == [0.0, 0.0]
    model.set_input("u", -FS * (1 + 1e-12))
    model.advance(1.0, 2.0)
    assert model.mode == "backward"


def test_a_reversal_under_a_large_force_does_not_stick():
    """With 1 N of Coulomb friction it slows down at 11 m/s^2 and turns back at 9 m/s^2."""
    values = {"Fc": 1.0, "Fs": 1.0, "sigma2": 0.0, "v_start": 0.02}
    model = Model(generate(direct_drive(classical)), values, 1e-11)
    model.set_input("u", -10.0)
    model.advance(0.0, 0.01)
    assert model.mode == "backward"
    assert model.info[4] == 3  # into motion, to rest, away from it
    turn = 0.02 / 11.0
    back = 0.01 - turn
    np.testing.assert_allclose(model.x, [0.01 * turn - 4.5 * back**2, -9.0 * back], rtol=1e-10)


def test_dry_friction_of_ones_own_sticks_up_to_its_largest_force_and_slides_by_its_curve():
    kernel = generate(with_friction(block_on_belt(damping=5.0), falling()))
    model = Model(kernel, {}, 1e-10)
    off = (BREAK_AWAY - 5.0 * 0.5) / STIFFNESS / 0.5  # s
    model.advance(0.0, 0.999 * off)
    assert model.outputs(0.999 * off, model.x)["stuck"] == 1.0
    model.advance(0.999 * off, 1.2 * off)
    outputs = model.outputs(1.2 * off, model.x)
    assert outputs["stuck"] == 0.0
    assert outputs["friction"] == pytest.approx(-BREAK_AWAY / (1 + 3 * abs(model.x[1])), rel=1e-14)
    sliding_ahead = Model(kernel, {"v_start": 0.1})
    sliding_ahead.settle(0.0)
    assert sliding_ahead.outputs(0.0, sliding_ahead.x)["friction"] == BREAK_AWAY / 1.3


def test_what_cannot_stick_or_is_not_there_is_refused_with_the_reason():
    with pytest.raises(ContractError, match="add forces before the modes"):
        direct_drive(classical).with_force(ForceTerm("more", symbol("u"), "more"))
    with pytest.raises(ContractError, match="needs a force balance of 'v' with a term 'friction'"):
        with_sticking(direct_drive(classical))
    smooth = ForceTerm("friction", -sp.tanh(symbol("v")), "smooth friction")
    for law, options, said in (
        (smooth, {}, r"has no sign\(v\)"),
        ("dahl", {"breakaway": sp.Float(1.0)}, "sticking as a mode, and dahl does not"),
        ("lugre", {"values": {"mu": 0.3}}, "no parameter 'mu'"),
        ("coulomb", {}, "no friction law 'coulomb'; there are"),
    ):
        with pytest.raises((ValueError, KeyError), match=said):
            with_friction(block_on_belt(), law, **options)
