"""A body moved by a force ``gain*u``, with a friction law and without a motor model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

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
from .ball_screw import acted_on_of, inner_outputs
from .classical import able_to_stick
from .instruments.amplifier import PARAMETERS as AMPLIFIER
from .instruments.amplifier import clip
from .law import Law, with_each_law
from .modified_lugre import modified_lugre

PARAMETERS = (
    Parameter("m", 1.0, "kg", "mass of all that moves", "the block's in Table 2.1", minimum=1e-6),
    Parameter("gain", 1.0, "N/V", "force of the drive per unit of its command", "one to one"),
    Parameter("offset", 0.0, "N", "constant force against motion in +x", "none"),
)


def direct_drive(
    friction: Callable[[sp.Expr], ForceTerm] = modified_lugre, name: str = "direct_drive"
) -> Component:
    """The drive from its command `u` to position `x` [m], with a given friction law.

    The command is in V; ``drive+force`` and similar names of the catalogue have it in another unit.
    States x, v and those of the friction law; m dv/dt = gain u - friction - offset. A feedback law
    may act on x, v and the friction law's deflection `z` (without one, its states).
    """
    return able_to_stick(bare_direct_drive(friction, name))


def drive(friction: Law = modified_lugre, name: str = "drive") -> Component:
    """The exported drive: its command may have a limit."""
    return replace(with_command_limit(direct_drive(friction)), name=name)


def bare_direct_drive(
    friction: Callable[[sp.Expr], ForceTerm] = modified_lugre, name: str = "direct_drive"
) -> Component:
    """The drive of `direct_drive` before sticking is added, so that forces can be added."""
    x, v = symbol("x"), symbol("v")
    term = friction(v)
    law = ("x", "v", *acted_on_of(term))
    force = ForceTerm("drive", symbol("gain") * symbol("u"), "force of the drive")
    offset = ForceTerm("offset", -symbol("offset"), "constant force")
    return Component(
        name=name,
        description="Direct drive: a force on a sliding block with " + term.meaning.split(",")[0],
        parameters=PARAMETERS,
        inputs=(Input("u", "V", "command of the drive", nominal=10.0, law=law),),
        states=(
            State("x", "m", "position of the body", v, nominal=1e-3),
            State("v", "m/s", "velocity of the body", nominal=1e-3),
        ),
        outputs=(
            Output("x", "m", "position of the body", x, nominal=0.1),
            Output("v", "m/s", "velocity of the body", v, nominal=0.1),
            *inner_outputs(term),
        ),
        balances=(ForceBalance("v", symbol("m"), (force, offset, term)),),
    )


def with_command_limit(plant: Component) -> Component:
    """The plant with its command limited to ``voltage_limit``; without a limit, the same.

    The parameter has the name of the amplifier's limit, so that all plants have the same name.
    """
    u, limit = symbol("u"), symbol("voltage_limit")
    (parameter,) = (p for p in AMPLIFIER if p.name == limit.name)
    (command,) = (i for i in plant.inputs if i.name == u.name)
    meaning = "largest command, either sign; 1e6: no limit"
    parameter = replace(parameter, unit=command.unit, meaning=meaning)
    return plant.substituted({u: clip(u, -limit, limit)}, parameters=(*plant.parameters, parameter))


__getattr__ = with_each_law(drive, "drive")
