"""The axis as it is exported: ball screw with a friction law behind an amplifier."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from ..instruments.amplifier import with_amplifier
from ..instruments.load import with_load
from ..solver.component import Component
from . import LAWS
from .ball_screw import ball_screw
from .law import Law, law
from .modified_lugre import modified_lugre


def axis(friction: Law = modified_lugre, name: str = "plant") -> Component:
    """The axis with a friction law; as it stands, the nominal plant of this project."""
    return replace(with_amplifier(ball_screw(friction)), name=name)


def loaded_axis() -> Component:
    """The nominal plant with a load: a force over time, and a payload that it picks up."""
    return replace(with_load(axis()), name="plant_loaded")


def __getattr__(name: str) -> Callable[[], Component]:
    """The functions that `PLANTS` names: ``plant_<law>`` makes the axis with that law."""
    known = name.removeprefix("plant_")
    if known == name or known not in LAWS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return partial(axis, law(known), name)
