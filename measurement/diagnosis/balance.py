"""Residuals of a drive's balances, in newtons, and the effect of values and causes on them.

A balance is scaled to the prior's force per unit of the command. Otherwise, a model with too small
forces and masses would have smaller residuals than the true model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Matrix, Vector
from .causes.cause import Form
from .drive import Drive
from .modelled_record import (
    CalibrationPrior,
    ModelledRecord,
    calibration_priors,
    mean_current,
    true_current,
)
from .weak_form import averaged, lagged, rate, windows

EXACT = 3e-3
"""Smallest noise, as a share of the friction: friction laws are not exact."""
_STEP = 1e-3  # step of finite differences, relative to a value


@dataclass(frozen=True)
class Added:
    """Forces and commands added to a model's own equations, one array per record, as in `Form`."""

    force: list[Vector]
    command: list[Vector]

    @classmethod
    def nothing(cls, courses: Sequence[ModelledRecord]) -> Added:
        return cls(*([np.zeros(len(c.x)) for c in courses] for _ in range(2)))

    def more(self, form: Form, amplitudes: Vector) -> Added:
        """Return this with a cause of these amplitudes added."""

        def sums(before: list[Vector], parts: list[Matrix] | None) -> list[Vector]:
            if parts is None:
                return before
            return [b + p @ amplitudes for b, p in zip(before, parts, strict=True)]

        return Added(sums(self.force, form.force), sums(self.command, form.command))


def balance(
    course: ModelledRecord, model: Drive, friction: Vector, force: Vector, command: Vector
) -> Matrix:
    """Residual of each balance in each window, shape (windows, channels) [N].

    The balance of forces comes first. If a current is known, the balance of voltages follows; a
    voltage is given as the force that it holds at rest. `friction` is the law along the record;
    `force` and `command` are added to the model's own equations, shape (n,) each.
    """
    width, step = course.width, course.step
    v = course.moved_v
    u = course.u + course.calibration["command_shift"] * course.next_change + command
    opposed = averaged(friction + force + model.linear_friction * v, width)
    opposed += course.own_offset + model.inertia * course.measured_a
    if "fast_speed" in course.calibration:
        opposed += course.calibration["fast_speed"] * model.inertia * course.inner_a
    if not model.has_motor:
        driven = model.values["gain"] * averaged(u, width)
        return (course.per_command / model.values["gain"] * (driven - opposed))[:, None]
    resistance, inductance = model.values["R"], model.values["L"]
    volts = u - model.back_emf * v
    per_volt = course.per_command
    if not course.by_current:
        late = lagged((volts / resistance)[:, None], step, inductance / resistance)[:, 0]
        scale = per_volt / model.per_command
        forces = scale * (model.per_ampere * averaged(late, width) - opposed)
        if not course.has_current:
            return forces[:, None]
    read = averaged(mean_current(course, model), width)
    if course.by_current:
        scale = per_volt * course.resistance / model.per_ampere
        scale /= 1.0 + course.calibration["current_gain"]
        forces = scale * (model.per_ampere * read - opposed)
    left_volts = averaged(volts, width) - resistance * read
    left_volts -= inductance * rate(true_current(course), step, width)
    return np.column_stack([forces, per_volt * left_volts])


def shown(course: ModelledRecord, model: Drive, form: Form, record: int) -> npt.NDArray[np.float64]:
    """Effect of a cause of amplitude one on each balance, shape (windows, channels, m) [N]."""
    m = len(form.amplitudes)
    out = np.zeros((windows(len(course.x), course.width), len(course.channels), m))
    if form.force is not None:
        out[:, 0] += averaged(form.force[record], course.width)
    if form.command is not None:
        command = form.command[record]
        if not model.has_motor:
            out[:, 0] -= model.values["gain"] * averaged(command, course.width)
        elif not course.by_current:
            late = lagged(command, course.step, model.values["L"] / model.values["R"])
            out[:, 0] -= model.per_command * averaged(late, course.width)
        if course.has_current:
            out[:, 1] -= course.per_command * averaged(command, course.width)
    return out


def leftovers(
    courses: Sequence[ModelledRecord],
    model: Drive,
    added: Added,
    law: Sequence[Vector] | None = None,
) -> list[Matrix]:
    """`balance` of each record; `law` is the friction along the records if already computed."""
    if law is None:
        law = [model.friction(c.x, c.v, c.step) for c in courses]
    return [
        balance(c, model, *given)
        for c, *given in zip(courses, law, added.force, added.command, strict=True)
    ]


def responses(courses: Sequence[ModelledRecord], model: Drive, form: Form) -> list[Matrix]:
    """Effect of a cause of amplitude one on the balances of each record, see `shown`."""
    return [shown(c, model, form, r) for r, c in enumerate(courses)]


def calibrated(courses: Sequence[ModelledRecord]) -> dict[str, CalibrationPrior]:
    """Possible errors of the instruments of a study."""
    return calibration_priors(courses[0])


def sensitivities(
    courses: Sequence[ModelledRecord],
    model: Drive,
    added: Added,
    usual: Sequence[Vector],
    of_law: bool = True,
) -> list[Matrix]:
    """Effect of values and calibrations on the balances: (windows, channels, columns) per record.

    The columns are a relative change of each adjustable value, then a change of each of
    `calibrated`. `usual` is the law along the records. Without `of_law`, the columns of its values
    are zero.
    """

    def of_value(name: str) -> list[Matrix]:
        law = None if name in model.law_parameters else usual
        low, high = (
            leftovers(courses, model.changed({name: model.values[name] * (1 + s)}), added, law)
            for s in (-_STEP, _STEP)
        )
        return [(a - b) / (2 * _STEP) for a, b in zip(low, high, strict=True)]

    def of_calibration(name: str) -> list[Matrix]:
        low, high = (
            leftovers(recalibrated(courses, {name: s}), model, added, usual)
            for s in (-_STEP, _STEP)
        )
        return [(a - b) / (2 * _STEP) for a, b in zip(low, high, strict=True)]

    fixed = () if of_law else model.law_parameters
    nothing = [np.zeros((windows(len(c.x), c.width), len(c.channels))) for c in courses]
    columns = [nothing if name in fixed else of_value(name) for name in model.adjustable]
    columns += [of_calibration(name) for name in calibrated(courses)]
    return [np.stack(record, axis=2) for record in zip(*columns, strict=True)]


def recalibrated(
    courses: Sequence[ModelledRecord], changes: Mapping[str, float]
) -> list[ModelledRecord]:
    """Return the courses with their calibration changed by `change`."""
    return [
        replace(c, calibration={n: v + changes.get(n, 0.0) for n, v in c.calibration.items()})
        for c in courses
    ]
