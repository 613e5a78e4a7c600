"""Nothing is missing: a value of the model is wrong by more than its tolerance."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import sympy as sp

from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values

if TYPE_CHECKING:
    from ..drive import Drive

_OTHERS = ("m", "Jm", "offset", "Fs", "Vs")
"""Values whose error is another cause: more mass, a load, a bend of the friction curve."""


def _grid(courses: Courses, model: Drive) -> list[Values]:
    del courses
    names = [n for n in model.adjustable if n.partition("_")[0] not in _OTHERS]
    # more than two at once can be anything: all forces together are the mass
    sets = [*combinations(names, 1), *combinations(names, 2)]
    levels = [(n, n.replace("Fc", "Fs")) for n in names if n.startswith("Fc")]
    sets += [pair for pair in levels if pair[1] in model.adjustable]  # of sliding and of rest
    return [{n: model.values[n] for n in those} for those in sets]


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    del courses, model
    return Shape(tuple(values), freed=tuple(values))


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    return plant  # its values are others


CAUSE = Cause(
    "parameter_error",
    "a value of the model is wrong",
    _grid,
    _at,
    (),
    _extend,
    confirm="measure that value by itself",
    mistaken_for=("unmodelled_inertia", "compliance", "stribeck_mismatch"),
)
