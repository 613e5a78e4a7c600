"""What acts after a reversal: a gap or a spring between encoder and block, bristles.

The plant has a gap or a spring as a force between two bodies, see `two_masses`. Along a record, the
motion of the encoder's side is given, and compiled code integrates that of the block with steps
that are stable for any stiffness. The friction of the block has its own states, so its motion is
not a closed expression.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ....plant.two_masses import GAP, STIFFNESS, with_gap, with_spring
from ....solver.component import Component, Parameter
from ...identification.fitted_law import assumed_damping
from ...identification.law_along_record import SHARPNESS, force_behind
from ..model import Drive
from ..motion import with_law_force
from .cause import Cause, Courses, Form, Grid, Mechanism, Values, parameter


def joint(
    kind: str, varied: Parameter, build: Callable[[Component], Component], grid: Grid, sure: float
) -> Mechanism:
    """A joint with one parameter; `kind` as in `force_behind`."""

    def at(courses: Courses, model: Drive, values: Values) -> Form:
        size, block, forces = values[varied.name], model.linear.block, []
        for c in courses:
            behind = force_behind(kind, model.law_values, c.x, c.v, c.step, size, block)
            rigid = c.bristle + model.linear_friction * c.middle_v + block * c.mean_a
            forces.append((behind - rigid)[:, None])
        return Form((varied.name,), force=forces, values=values, sure=sure)

    return Mechanism((varied,), at, grid, lambda plant, curve, cause: build(plant), varied.name)


_GAPS = 1e-6 * 2.0 ** np.arange(1.0, 10.75, 0.5)  # [m]

BACKLASH = Cause(
    "backlash",
    "backlash: at each reversal the screw turns through a gap before it moves the block",
    (
        joint(
            "gap",
            GAP,
            with_gap,
            lambda courses, model: [{GAP.name: float(gap)} for gap in _GAPS],
            sure=0.2,
        ),
    ),
    confirm="reverse slowly and record the current: it is near zero until the gap is closed",
)


_YIELDING = 1e-6 * 2.0 ** np.arange(-4.0, 8.0)  # deflection under the friction of slow sliding [m]


def _spring_grid(courses: Courses, model: Drive) -> list[Values]:
    stiffest = model.values.get("sigma0", math.inf)  # a stiffer spring acts like bristles
    grid = (model.friction_scale / float(way) for way in _YIELDING)
    return [{STIFFNESS.name: k} for k in grid if k < stiffest]


COMPLIANCE = Cause(
    "compliance",
    "something elastic lies between the encoder and the block",
    (joint("spring", STIFFNESS, with_spring, _spring_grid, sure=0.3),),
    confirm="a sensor on the block in addition to the encoder: their readings differ when the "
    "force reverses",
    entry="softer at reversal",
)


BRISTLES = "presliding_hysteresis"
_RATIOS = (0.35, 0.0)  # bristle damping over critical damping, in addition to one
_WAYS = 1e-6 * 2.0 ** np.arange(0.0, 9.5, 0.5)  # presliding distances [m]


def bristled(model: Drive, sigma0: float, damping_ratio: float = 1.0) -> Drive:
    """The model with LuGre bristles and its own curve over speed, see `damping_ratio`."""
    sigma1 = assumed_damping(sigma0, model.values["sigma2"], model.linear.block, damping_ratio)
    values = {**model.values, "sigma0": sigma0, "sigma1": max(sigma1, 0.0), "Kv": SHARPNESS}
    return replace(model, law="modified_lugre", values=values)


def _grid(courses: Courses, model: Drive) -> list[Values]:
    return [{"sigma0": model.friction_scale / float(way)} for way in _WAYS]


def _at(courses: Courses, model: Drive, values: Values) -> Form:
    bent = bristled(model, **values)
    forces = [(with_law_force(c, bent).bristle - c.bristle)[:, None] for c in courses]
    return Form(("sigma0",), force=forces, values=values, sure=0.3)


def _beyond(courses: Courses, model: Drive) -> str | None:
    return None if model.law == "classical" else "the prior law is not the classical one"


_STIFFNESS = parameter("sigma0", "N/m", "stiffness of the bristles", 1e6)
_RATIO = parameter("damping_ratio", "1", "damping of the bristles, share of the critical one", 1.0)
PRESLIDING_HYSTERESIS = Cause(
    BRISTLES,
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
    beyond=_beyond,
    entry="softer at reversal",
)
