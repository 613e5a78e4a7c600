"""A block on a ball screw, driven by a DC motor: Eqs. 3.11-3.16 of the thesis."""

from __future__ import annotations

import math
from collections.abc import Callable

import sympy as sp

from ..solver.component import (
    Component,
    ForceBalance,
    ForceTerm,
    Input,
    Output,
    Parameter,
    State,
    symbol,
)
from .classical import able_to_stick
from .modified_lugre import modified_lugre

# Table 3.1 prints the speed constant, 255 rpm/V; the back-EMF constant is its inverse.
_BACK_EMF = 1 / (255 * 2 * math.pi / 60)
_ROTOR = "rotor inertia, reflected through the screw; Table 2.1 gives 4.2e-7, the thesis omits it"

PARAMETERS = (
    Parameter("kt", 37.4e-3, "N*m/A", "torque constant", "Table 3.1", minimum=1e-9),
    Parameter(
        "ke", _BACK_EMF, "V*s/rad", "back-EMF constant", "Table 3.1: 1/(255 rpm/V)", minimum=0.0
    ),
    Parameter("L", 0.953e-3, "H", "terminal inductance", "Table 3.1", minimum=1e-9),
    Parameter("R", 21.4, "ohm", "terminal resistance", "Table 3.1", minimum=1e-9),
    Parameter("p", 1000.0, "1/m", "revolutions of the screw per metre", "Table 3.1", minimum=1e-3),
    Parameter("m", 1.0, "kg", "mass of the block", "Table 2.1", minimum=1e-6),
    Parameter("Jm", 0.0, "kg*m^2", _ROTOR, "Section 3.3", minimum=0.0, nominal=4.2e-7),
)


def ball_screw(
    friction: Callable[[sp.Expr], ForceTerm] = modified_lugre, name: str = "ball_screw"
) -> Component:
    """The axis from motor voltage `u` [V] to position `x` [m], with a given friction law.

    States x, v, i and those of the friction law. A feedback law may act on x, v, the friction law's
    deflection `z` (without one, its states) and i.
    """
    # Sticking is a property of the whole body: its modes keep velocity and position constant.
    return able_to_stick(bare_ball_screw(friction, name))


def bare_ball_screw(
    friction: Callable[[sp.Expr], ForceTerm] = modified_lugre, name: str = "ball_screw"
) -> Component:
    """The axis of `ball_screw` before sticking is added, so that forces can be added."""
    kt, ke, inductance, resistance, p, m, rotor = map(
        symbol, ("kt", "ke", "L", "R", "p", "m", "Jm")
    )
    u, x, v, i = map(symbol, ("u", "x", "v", "i"))
    angle_per_length = 2 * sp.pi * p
    current_rate = (u - resistance * i - ke * angle_per_length * v) / inductance
    motor = ForceTerm("motor", kt * angle_per_length * i, "motor torque through the screw")
    friction_term = friction(v)
    acted_on = acted_on_of(friction_term)
    states = (
        State("x", "m", "position of the block", v, nominal=1e-3),
        State("v", "m/s", "velocity of the block", nominal=1e-3),
        State("i", "A", "armature current", current_rate, nominal=1e-2),
    )
    outputs = (
        Output("x", "m", "position of the block", x, nominal=0.1),
        Output("v", "m/s", "velocity of the block", v, nominal=0.1),
        *inner_outputs(friction_term),
        Output("i", "A", "armature current", i, nominal=0.1),
    )
    return Component(
        name=name,
        description="Ball-screw axis: DC motor, screw, sliding block with "
        + friction_term.meaning.split(",")[0],
        parameters=PARAMETERS,
        inputs=(
            Input("u", "V", "motor terminal voltage", nominal=10.0, law=("x", "v", *acted_on, "i")),
        ),
        states=states,
        outputs=outputs,
        balances=(ForceBalance("v", m + rotor * angle_per_length**2, (motor, friction_term)),),
    )


def acted_on_of(friction: ForceTerm) -> tuple[str, ...]:
    """Signals of a friction law for a feedback law: its `z`; without one, its states."""
    states = tuple(s.name for s in friction.states)
    return ("z",) if "z" in {*states, *(o.name for o in friction.outputs)} else states


def inner_outputs(friction: ForceTerm) -> tuple[Output, ...]:
    """Outputs for the signals of a feedback law that the friction law does not output itself."""
    shown = {o.name for o in friction.outputs}
    return tuple(
        Output(s.name, s.unit, s.meaning, symbol(s.name), nominal=s.nominal)
        for s in friction.states
        if s.name in acted_on_of(friction) and s.name not in shown
    )
