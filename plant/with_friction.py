"""Any body with any friction law."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

from ..solver.component import Component, ForceTerm, symbol
from .classical import with_outputs, with_sticking
from .law import claims, turning
from .law import law as law_of


def with_friction(
    body: Component,
    law: str | ForceTerm,
    values: Mapping[str, float] | None = None,
    velocity: str = "v",
    position: str = "x",
    breakaway: sp.Expr | None = None,
) -> Component:
    """A body with a friction law; see `ballscrew.with_friction`."""
    own = isinstance(law, ForceTerm)
    sticks = isinstance(law, ForceTerm) or claims(law).stiffness is None
    if breakaway is not None and not sticks:
        raise ValueError(f"breakaway is for friction with sticking as a mode, and {law} does not")
    term = with_outputs(law) if isinstance(law, ForceTerm) else law_of(law)(symbol(velocity))
    if not own and any(s.name == velocity and s.unit == "rad/s" for s in body.all_states):
        term = turning(term)
    component = body.with_force(term, velocity)
    if sticks:
        component = with_sticking(component, velocity, position, breakaway)
    return component.with_defaults(values or {}, "given with the law")
