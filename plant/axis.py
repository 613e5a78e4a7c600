"""The exported axis: ball screw with a friction law, driven by an amplifier."""

from __future__ import annotations

from dataclasses import replace

from ..solver.component import Component
from .ball_screw import ball_screw
from .instruments.amplifier import with_amplifier
from .instruments.load import with_load
from .law import Law, with_each_law
from .modified_lugre import modified_lugre


def axis(friction: Law = modified_lugre, name: str = "plant") -> Component:
    """The axis with a friction law; by default, the nominal plant of this project."""
    return replace(with_amplifier(ball_screw(friction)), name=name)


def loaded_axis() -> Component:
    """The nominal plant with a load: a force over time, and a payload that it picks up."""
    return replace(with_load(axis()), name="plant_loaded")


__getattr__ = with_each_law(axis, "plant")
