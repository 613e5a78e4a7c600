"""A spring between the encoder and the load, friction behind it or before it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp
from scipy.signal import cont2discrete, lfilter

from ...identification.law_along_record import force_behind_spring
from ...plant.two_masses import SPRING_DAMPING, with_load_on_spring, with_spring
from ...solver.component import Component
from .cause import Cause, Courses, Shape, Values, of_forms, parameter

if TYPE_CHECKING:
    from ..drive import Drive
    from ..modelled_record import ModelledRecord

_YIELDING = 1e-6 * 2.0 ** np.arange(-4.0, 8.0)  # under the friction of slow sliding [m]
_RESONANCES = (0.02, 1.0)  # of one over the sampling interval [rad/s]


def _missing(course: ModelledRecord, model: Drive, stiffness: float) -> np.ndarray:
    """Force of the law on a block behind the spring, beyond that of one without."""
    motion = course.x, course.v, course.step
    behind = force_behind_spring(model.law_values, *motion, stiffness, model.block)
    rigid = course.bristle + model.linear_friction * course.middle_v + model.block * course.mean_a
    return np.asarray(behind - rigid)


def _grid(courses: Courses, model: Drive) -> list[Values]:
    del courses
    stiffest = model.values.get("sigma0", math.inf)  # beyond, bristles of another form do the same
    grid = (model.friction_scale / float(way) for way in _YIELDING)
    return [{"stiffness": k} for k in grid if k < stiffest]


def _at(courses: Courses, model: Drive, values: Values) -> Shape:
    force = [_missing(c, model, values["stiffness"])[:, None] for c in courses]
    return Shape(("stiffness",), force=force, values=values, sure=0.3)


def _extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    return with_spring(plant)


def _load_grid(courses: Courses, model: Drive) -> list[Values]:
    """Stiffnesses at which the load swings within what the samples show, half octaves.

    None where nobody told which part of the mass is the load.
    """
    if not model.values.get("Jm"):
        return []
    slowest, fastest = (share / courses[0].step for share in _RESONANCES)
    count = math.ceil(4.0 * math.log2(fastest / slowest)) + 1
    resonances = np.geomspace(slowest, fastest, count)
    return [{"load_stiffness": float(model.block * w**2)} for w in resonances]


def _load_at(courses: Courses, model: Drive, values: Values) -> Shape:
    """What a load that swings behind a spring asks for beyond a rigid one."""
    resonance = math.sqrt(values["load_stiffness"] / model.block)
    swings = [1.0, 2.0 * float(SPRING_DAMPING) * resonance, resonance**2]
    force = []
    for c in courses:
        b, a, _ = cont2discrete(([-1.0, 0.0, 0.0], swings), c.step, method="foh")
        force.append(model.block * lfilter(b.ravel(), a, c.mean_a)[:, None])
    return Shape(("load_stiffness",), force=force, values=values, sure=0.3)


def _load_extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
    del curve, values
    return with_load_on_spring(plant)


_FRICTION_BEHIND = Cause(
    "compliance",
    "something elastic lies between the encoder and the block",
    _grid,
    _at,
    (parameter("stiffness", "N/m", "of what lies between encoder and block", 1e9),),
    _extend,
    confirm="a sensor on the block beside the encoder: the two part when the force reverses",
    refined=("stiffness",),
    mistaken_for=("parameter_error", "backlash"),
)
_FRICTION_BEFORE = Cause(
    _FRICTION_BEHIND.name,
    _FRICTION_BEHIND.says,
    _load_grid,
    _load_at,
    (parameter("load_stiffness", "N/m", "of what lies between friction and load", 1e9),),
    _load_extend,
    confirm=_FRICTION_BEHIND.confirm,
    refined=("load_stiffness",),
)
CAUSE = of_forms(_FRICTION_BEHIND, _FRICTION_BEFORE)
