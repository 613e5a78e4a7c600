"""A block behind a joint, which is between the block and the encoder.

The plant has the joint as a force between two bodies, see `two_masses`. Along a record, the motion
of the encoder's side is given, and compiled code integrates that of the block with steps that are
stable for any stiffness. The friction of the block has its own states, so its motion is not a
closed expression.
"""

from __future__ import annotations

from collections.abc import Callable

from ....solver.component import Component, Parameter
from ...identification.law_along_record import force_behind
from ..drive import Drive
from .cause import Courses, Grid, Mechanism, Shape, Values


def joint(
    kind: str, told: Parameter, build: Callable[[Component], Component], grid: Grid, sure: float
) -> Mechanism:
    """A joint with one parameter; `kind` as in `force_behind`."""

    def at(courses: Courses, model: Drive, values: Values) -> Shape:
        size, forces = values[told.name], []
        for c in courses:
            behind = force_behind(kind, model.law_values, c.x, c.v, c.step, size, model.block)
            rigid = c.bristle + model.linear_friction * c.middle_v + model.block * c.mean_a
            forces.append((behind - rigid)[:, None])
        return Shape((told.name,), force=forces, values=values, sure=sure)

    return Mechanism((told,), at, grid, lambda plant, curve, cause: build(plant), told.name)
