"""Exponents of a cycle do not depend on where its tangents begin."""

import math

import pytest

import ballscrew
from ballscrew.solver.component import (
    Component,
    Event,
    Mode,
    Output,
    State,
    symbol,
)


def pushed(damping):
    """A damped oscillator that is pushed in the direction in which it moves."""
    x, v = map(symbol, ("x", "v"))

    def mode(name, direction, other):
        return Mode(
            name,
            derivatives={"v": direction - x - damping * v},
            events=(Event("turns", v, direction=-direction, next_mode=other),),
        )

    return Component(
        name="pushed",
        description="an oscillator with a push",
        states=(
            State("x", "m", "position", v, start=1.0, nominal=10.0),  # the velocity is looked at
            State("v", "m/s", "velocity", 1 - x - damping * v, start=0.1),
        ),
        outputs=(Output("x", "m", "position", x), Output("v", "m/s", "velocity", v)),
        modes=(mode("forward", 1, "backward"), mode("backward", -1, "forward")),
    )


@pytest.mark.parametrize(
    "ratio", [0.15, *(pytest.param(r, marks=pytest.mark.ci) for r in (0.04, 0.5))]
)
def test_a_cycle_that_is_looked_at_where_it_turns(ratio):
    """There an axis of the states is the direction that shrinks, and stays it but for round-off.

    And a turn at either end of the periods that are looked at may be within them or not.
    """
    found = ballscrew.lyapunov("none", pushed(2.0 * ratio), stop=40.0 + 20.0 / ratio).motion
    assert found.kind.value == "limit cycle"
    assert found.limit == pytest.approx([0.0, -ratio], abs=1e-4 * ratio)
    assert found.period == pytest.approx(2.0 * math.pi / math.sqrt(1.0 - ratio**2), rel=1e-6)
