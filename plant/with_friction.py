"""Any body with any friction law."""

from __future__ import annotations

from collections.abc import Mapping

from ..solver.component import Component, symbol
from .classical import with_sticking
from .law import law as law_of


def with_friction(
    body: Component,
    law: str,
    values: Mapping[str, float] | None = None,
    velocity: str = "v",
    position: str = "x",
) -> Component:
    """A body with a friction law; see `ballscrew.with_friction`."""
    component = body.with_force(law_of(law)(symbol(velocity)), velocity)
    if law == "classical":
        component = with_sticking(component, velocity, position)
    return component.with_defaults(values or {}, "given with the law")
