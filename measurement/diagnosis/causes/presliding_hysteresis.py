"""Bristles that bend before the block slides, for a law with only sticking and sliding.

The law is changed in the plant and along a record, see `bristled`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...identification.fitted_law import assumed_damping
from ...identification.law_along_record import SHARPNESS
from ..drive import Drive
from ..modelled_record import with_law_force
from .cause import Cause, Courses, Mechanism, Shape, Values, parameter

NAME = "presliding_hysteresis"
_RATIOS = (0.35, 0.0)  # bristle damping over critical damping, in addition to one
_WAYS = 1e-6 * 2.0 ** np.arange(0.0, 9.5, 0.5)  # presliding distances [m]


def bristled(model: Drive, sigma0: float, damping_ratio: float = 1.0) -> Drive:
    """The model with LuGre bristles and its own curve over speed, see `damping_ratio`."""
    sigma1 = assumed_damping(sigma0, model.values["sigma2"], model.block, damping_ratio)
    values = {**model.values, "sigma0": sigma0, "sigma1": max(sigma1, 0.0), "Kv": SHARPNESS}
    return replace(model, law="modified_lugre", values=values)


def _grid(courses: Courses, model: Drive) -> list[Values]:
    return [{"sigma0": model.friction_scale / float(way)} for way in _WAYS]


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    bent = bristled(model, **values)
    forces = [(with_law_force(c, bent).bristle - c.bristle)[:, None] for c in courses]
    return Shape(("sigma0",), force=forces, values=values, sure=0.3)


def _beyond(courses: Courses, model: Drive) -> str | None:
    return None if model.law == "classical" else "the prior law is not the classical one"


_STIFFNESS = parameter("sigma0", "N/m", "stiffness of the bristles", 1e6)
_RATIO = parameter("damping_ratio", "1", "damping of the bristles, share of the critical one", 1.0)
CAUSE = Cause(
    NAME,
    "presliding: after each reversal the force rises over a distance, which the law does not "
    "describe",
    (
        Mechanism((_STIFFNESS,), _at, _grid, refined="sigma0"),
        Mechanism(
            (_STIFFNESS, _RATIO),
            _at,
            lambda courses, model: [
                {**v, "damping_ratio": r} for r in _RATIOS for v in _grid(courses, model)
            ],
            refined="sigma0",
        ),
    ),
    confirm="small slow movements forwards and backwards: force over position is a hysteresis loop",
    mistaken_for=("compliance", "backlash"),
    beyond=_beyond,
)
