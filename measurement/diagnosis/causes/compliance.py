"""A spring between the encoder and the load, with friction on either side of it."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import cont2discrete, lfilter

from ....plant.two_masses import (
    LOAD_STIFFNESS,
    SPRING_DAMPING,
    STIFFNESS,
    with_load_on_spring,
    with_spring,
)
from ..drive import Drive
from .cause import Cause, Courses, Mechanism, Shape, Values
from .joint import joint

_YIELDING = 1e-6 * 2.0 ** np.arange(-4.0, 8.0)  # deflection under the friction of slow sliding [m]
_RESONANCES = (0.02, 1.0)  # limits of the resonance, over the sampling rate [rad]


def _grid(courses: Courses, model: Drive) -> list[Values]:
    stiffest = model.values.get("sigma0", math.inf)  # a stiffer spring acts like bristles
    grid = (model.friction_scale / float(way) for way in _YIELDING)
    return [{STIFFNESS.name: k} for k in grid if k < stiffest]


def _load_grid(courses: Courses, model: Drive) -> list[Values]:
    """Stiffnesses with a resonance that the samples can show, in half octaves.

    Empty if the mass of the load is not known.
    """
    if not model.values.get("Jm"):
        return []
    slowest, fastest = (share / courses[0].step for share in _RESONANCES)
    count = math.ceil(4.0 * math.log2(fastest / slowest)) + 1
    resonances = np.geomspace(slowest, fastest, count)
    return [{LOAD_STIFFNESS.name: float(model.block * w**2)} for w in resonances]


def _load_at(courses: Courses, model: Drive, values: Values) -> Shape:
    """Additional force of a load behind a spring, relative to a rigid load.

    The plant's spring is linear, so its response from sample to sample is exact.
    """
    resonance = math.sqrt(values[LOAD_STIFFNESS.name] / model.block)
    swings = [1.0, 2.0 * float(SPRING_DAMPING) * resonance, resonance**2]
    forces = []
    for c in courses:
        b, a, _ = cont2discrete(([-1.0, 0.0, 0.0], swings), c.step, method="foh")
        forces.append(model.block * lfilter(b.ravel(), a, c.mean_a)[:, None])
    return Shape((LOAD_STIFFNESS.name,), force=forces, values=values, sure=0.3)


CAUSE = Cause(
    "compliance",
    "something elastic lies between the encoder and the block",
    (
        joint("spring", STIFFNESS, with_spring, _grid, sure=0.3),
        Mechanism(
            (LOAD_STIFFNESS,),
            _load_at,
            _load_grid,
            lambda plant, curve, cause: with_load_on_spring(plant),
            LOAD_STIFFNESS.name,
        ),
    ),
    confirm="a sensor on the block in addition to the encoder: their readings differ when the "
    "force reverses",
    mistaken_for=("parameter_error", "backlash"),
)
