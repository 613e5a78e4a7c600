"""A body turned by a torque ``gain*u``, with a friction law: the direct drive in angles."""

from __future__ import annotations

from dataclasses import replace

from ..solver.component import Component, symbol
from . import TURNING
from .direct_drive import drive
from .law import Law, with_each_law
from .modified_lugre import modified_lugre


def rotary_drive(friction: Law = modified_lugre, name: str = "rotary_drive") -> Component:
    """The drive from its command `u` to the angle `x` [rad] of a body of inertia `J`.

    The numbers of the friction law are in N*m instead of N, and rad instead of m.
    """
    return turned(drive(friction, name))


def turned(slides: Component) -> Component:
    """A direct drive as a rotating body: the same numbers, in rad and N*m."""
    turns = slides.in_units(TURNING)
    parameters = tuple(
        replace(p, name="J", meaning="inertia of all that turns") if p.name == "m" else p
        for p in turns.parameters
    )
    description = turns.description.replace("a force on a sliding block", "a torque on a body")
    return turns.substituted(
        {symbol("m"): symbol("J")}, parameters=parameters, description=description
    )


__getattr__ = with_each_law(rotary_drive, "rotary_drive")
