"""The axis as it is exported: ball screw with a friction law behind an amplifier."""

from __future__ import annotations

from dataclasses import replace

from ..instruments.amplifier import with_amplifier
from ..instruments.load import with_load
from ..solver.component import Component
from .ball_screw import ball_screw
from .bliman_sorine import bliman_sorine
from .classical import classical
from .dahl import dahl
from .directional_lugre import directional_lugre
from .law import Law
from .lugre import lugre
from .maxwell_slip import maxwell_slip
from .modified_lugre import modified_lugre


def axis() -> Component:
    """The nominal plant of this project, with modified LuGre friction, as ``plant``."""
    return _axis(modified_lugre, "plant")


def classical_axis() -> Component:
    """The axis with classical friction: sticking and sliding as modes."""
    return _axis(classical, "plant_classical")


def lugre_axis() -> Component:
    """The axis with LuGre friction as first published."""
    return _axis(lugre, "plant_lugre")


def directional_lugre_axis() -> Component:
    """The axis with LuGre friction that differs by direction."""
    return _axis(directional_lugre, "plant_directional_lugre")


def dahl_axis() -> Component:
    """The axis with Dahl friction."""
    return _axis(dahl, "plant_dahl")


def bliman_sorine_axis() -> Component:
    """The axis with Bliman-Sorine friction."""
    return _axis(bliman_sorine, "plant_bliman_sorine")


def maxwell_slip_axis() -> Component:
    """The axis with generalized Maxwell-slip friction."""
    return _axis(maxwell_slip, "plant_maxwell_slip")


def loaded_axis() -> Component:
    """The nominal plant with a load: a force over time, and a payload that it picks up."""
    return replace(with_load(axis()), name="plant_loaded")


def _axis(friction: Law, name: str) -> Component:
    return replace(with_amplifier(ball_screw(friction)), name=name)
