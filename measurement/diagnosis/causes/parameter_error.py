"""A value of the model that is wrong by more than its tolerance; nothing is missing."""

from __future__ import annotations

from itertools import combinations

from ..drive import Drive
from .cause import Cause, Courses, Mechanism, Shape, Values

_OTHERS = ("m", "Jm", "offset", "Fs", "Vs")
"""Values whose error is another cause: more mass, a load, a bend of the friction curve."""


def _grid(courses: Courses, model: Drive) -> list[Values]:
    names = [n for n in model.adjustable if n.partition("_")[0] not in _OTHERS]
    # more than two at once are not distinguished: all forces together act like the mass
    sets = [*combinations(names, 1), *combinations(names, 2)]
    levels = [(n, n.replace("Fc", "Fs")) for n in names if n.startswith("Fc")]
    sets += [pair for pair in levels if pair[1] in model.adjustable]  # sliding and static friction
    return [{n: model.values[n] for n in those} for those in sets]


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    return Shape(tuple(values), freed=tuple(values))


CAUSE = Cause(
    "parameter_error",
    "a value of the model is wrong",
    (Mechanism((), _at, _grid),),
    confirm="measure that value separately",
    mistaken_for=("unmodelled_inertia", "compliance", "stribeck_mismatch"),
)
