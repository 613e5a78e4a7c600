"""Bristles that bend before the block slides, where the law knows sticking and sliding only."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...solver.component import Component
from ..modelled_record import with_law_force
from .cause import Cause, Courses, Shape, Values, of_forms, parameter

if TYPE_CHECKING:
    from ..drive import Drive

NAME = "presliding_hysteresis"
_RATIOS = (0.35, 0.0)  # of the bristles' damping to the critical one, beside that one itself
_WAYS = 1e-6 * 2.0 ** np.arange(0.0, 9.5, 0.5)  # over which the force comes up [m]


def bristled(model: Drive, sigma0: float, damping_ratio: float = 1.0) -> Drive:
    """The model with LuGre's bristles under its own curve over speed, see `damping_ratio`."""
    critical = 2.0 * math.sqrt(sigma0 * model.block)  # of sigma1 + sigma2, Eq. 2.17
    sigma1 = max(damping_ratio * critical - model.values["sigma2"], 0.0)
    values = {**model.values, "sigma0": sigma0, "sigma1": sigma1, "Kv": 1e8}
    return replace(model, law="modified_lugre", values=values)


def _grid(courses: Courses, model: Drive) -> list[Values]:
    del courses
    return [{"sigma0": model.friction_scale / float(way)} for way in _WAYS]


def _less_damped_grid(courses: Courses, model: Drive) -> list[Values]:
    return [{**v, "damping_ratio": r} for r in _RATIOS for v in _grid(courses, model)]


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    bent = bristled(model, **values)
    force = [(with_law_force(c, bent).bristle - c.bristle)[:, None] for c in courses]
    return Shape(("sigma0",), force=force, values=values, sure=0.3)


def _beyond(courses: Courses, model: Drive) -> str | None:
    del courses
    return None if model.law == "classical" else "the prior law has presliding of its own"


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    return plant  # the law is another one, see `bristled`


_DAMPED = Cause(
    NAME,
    "the force comes up over a way after each reversal, which the law does not know",
    _grid,
    _at,
    (parameter("sigma0", "N/m", "stiffness of the bristles", 1e6),),
    _extend,
    confirm="small slow movements to and fro: force over position is a loop",
    refined=("sigma0",),
    mistaken_for=("compliance", "backlash"),
    beyond=_beyond,
)
_LESS_DAMPED = replace(
    _DAMPED,
    grid=_less_damped_grid,
    parameters=(
        *_DAMPED.parameters,
        parameter("damping_ratio", "1", "damping of the bristles, share of the critical one", 1.0),
    ),
)
CAUSE = of_forms(_DAMPED, _LESS_DAMPED)
