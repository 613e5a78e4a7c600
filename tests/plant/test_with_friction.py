"""Any body takes any friction law, and sticks to what it slides on."""

import numpy as np
import pytest

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
from ballscrew.plant import LAWS
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


def test_a_block_that_sticks_goes_with_the_belt_until_the_spring_pulls_it_off():
    values = {"Fc": 2.0, "Fs": BREAK_AWAY, "sigma2": 0.0}
    model = Model(generate(with_friction(block_on_belt(), "classical", values)), {}, 1e-10)
    off = (BREAK_AWAY - 5.0 * SPEED) / STIFFNESS / SPEED  # s
    model.advance(0.0, 0.9 * off)
    assert model.x[0] == pytest.approx(0.9 * off * SPEED, rel=1e-9)
    assert model.x[1] == 0.0
    model.advance(0.9 * off, 1.2 * off)
    assert model.x[1] < 0.0


@pytest.mark.parametrize("law", [name for name in LAWS if name != "classical"])
def test_every_law_holds_a_block_with_its_friction_after_a_long_time_of_sliding(law):
    """The spring is held where friction of the law at the belt's speed holds it."""
    model = Model(generate(with_friction(block_on_belt(), law)), {}, 1e-8)
    model.advance(0.0, 20.0)
    outputs = model.outputs(20.0, model.x)
    assert np.isfinite(model.x).all()
    assert STIFFNESS * model.x[0] == pytest.approx(-outputs["friction"], rel=0.02)


def test_a_law_or_a_parameter_that_is_not_there_is_named():
    with pytest.raises(KeyError, match="no friction law 'coulomb'; there are"):
        with_friction(block_on_belt(), "coulomb")
    with pytest.raises(ValueError, match="no parameter 'mu'"):
        with_friction(block_on_belt(), "lugre", {"mu": 0.3})
