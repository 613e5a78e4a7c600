"""Any body takes any friction law, and sticks to what it slides on."""

import pytest
import sympy as sp

from ballscrew import (
    Component,
    ForceBalance,
    ForceTerm,
    Output,
    Parameter,
    State,
    symbol,
    with_friction,
)
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model

SPEED, STIFFNESS, BREAK_AWAY = 0.5, 100.0, 3.0


def block_on_belt() -> Component:
    """A mass of 1 kg on a spring; v is its speed on the belt."""
    x, v = symbol("x"), symbol("v")
    spring = ForceTerm("spring", -STIFFNESS * x, "a spring")
    damper = ForceTerm("damper", -5.0 * (v + symbol("belt")), "to the ground")
    return Component(
        "block",
        "A mass on a spring on a belt",
        parameters=(Parameter("belt", SPEED, "m/s", "speed of the belt", "test"),),
        states=(
            State("x", "m", "position", v + symbol("belt")),
            State("v", "m/s", "speed on the belt", nominal=0.1),
        ),
        outputs=(Output("x", "m", "position", x),),
        balances=(ForceBalance("v", 1, (spring, damper)),),
    )


def falling() -> ForceTerm:
    """Friction that falls with the speed of sliding, as no law of the catalogue does."""
    v = symbol("v")
    curve = symbol("F0") / (1 + 3 * sp.Abs(v))
    return ForceTerm(
        "friction",
        -sp.sign(v) * curve,
        "falling friction",
        parameters=(Parameter("F0", BREAK_AWAY, "N", "largest friction", "test"),),
    )


def test_dry_friction_of_ones_own_sticks_up_to_its_largest_force_and_slides_by_its_curve():
    model = Model(generate(with_friction(block_on_belt(), falling())), {}, 1e-10)
    off = (BREAK_AWAY - 5.0 * SPEED) / STIFFNESS / SPEED  # s
    model.advance(0.0, 0.999 * off)
    assert model.outputs(0.999 * off, model.x)["stuck"] == 1.0
    model.advance(0.999 * off, 1.2 * off)
    outputs = model.outputs(1.2 * off, model.x)
    assert outputs["stuck"] == 0.0
    assert outputs["friction"] == pytest.approx(-BREAK_AWAY / (1 + 3 * abs(model.x[1])), rel=1e-14)
    sliding_ahead = Model(generate(with_friction(block_on_belt(), falling())), {"v_start": 0.1})
    sliding_ahead.settle(0.0)
    assert sliding_ahead.outputs(0.0, sliding_ahead.x)["friction"] == BREAK_AWAY / 1.3


@pytest.mark.ci
def test_friction_that_cannot_stick_is_refused_with_the_reason():
    smooth = ForceTerm("friction", -sp.tanh(symbol("v")), "smooth friction")
    with pytest.raises(ValueError, match=r"has no sign\(v\)"):
        with_friction(block_on_belt(), smooth)
    with pytest.raises(ValueError, match="for friction with sticking as a mode, and dahl does not"):
        with_friction(block_on_belt(), "dahl", breakaway=sp.Float(1.0))


@pytest.mark.ci
def test_a_law_or_a_parameter_that_is_not_there_is_named():
    with pytest.raises(KeyError, match="no friction law 'coulomb'; there are"):
        with_friction(block_on_belt(), "coulomb")
    with pytest.raises(ValueError, match="no parameter 'mu'"):
        with_friction(block_on_belt(), "lugre", {"mu": 0.3})
