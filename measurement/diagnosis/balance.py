"""Residuals of a drive's balances, in newtons, and the effect of values and causes on them.

A balance is scaled to the prior's force per unit of the command. Otherwise, a model with too small
forces and masses would have smaller residuals than the true model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_opening, maximum_filter1d

from ...solver.arrays import Mask, Matrix, Vector
from ...solver.errors import BadRecord
from ..identification.fitted_law import fitted_law
from .causes.cause import Form
from .model import Drive
from .motion import Course, mean_current, position_noise, read_anew, recalibrated
from .windows import at_samples, averaged, lagged, per_interval, windows

EXACT = 3e-3  # smallest noise, as a share of the friction: friction laws are not exact
AROUND_REST = 3  # number of windows excluded on each side of a rest; at the start, twice as many
_STEP = float(np.cbrt(np.finfo(float).eps))  # relative, of central differences
_JUMP = 0.1  # jump of the law's force between two samples, as a share of friction
_FEWEST = 50  # smallest number of windows in motion to judge a model

Courses = Sequence[Course]
Laws = Sequence[Vector]


def balance(course: Course, model: Drive, friction: Vector) -> Matrix:
    """Residual of each balance in each window, shape (windows, channels) [N].

    The balance of forces comes first. If a current is known, the balance of voltages follows; a
    voltage is given as the force that it holds at rest. `friction` is the law along the record,
    shape (n,).
    """
    width, step, v = course.width, course.step, course.moved_v
    u = course.given_u
    opposed = averaged(friction + course.added_force + model.linear_friction * v, width)
    opposed += course.own_offset + model.linear.inertia * course.measured_a
    if "fast_speed" in course.calibration:
        opposed += course.calibration["fast_speed"] * model.linear.inertia * course.inner_a
    if not model.has_motor:
        driven = model.values["gain"] * averaged(u, width)
        return (course.per_command / model.values["gain"] * (driven - opposed))[:, None]
    resistance, inductance = model.values["R"], model.values["L"]
    volts = u - model.linear.back_emf * v
    if not course.by_current:
        late = lagged(volts / resistance, inductance / resistance, step)
        scale = course.per_command / model.linear.per_command
        forces = scale * (model.linear.per_ampere * averaged(late, width) - opposed)
        if not course.has_current:
            return forces[:, None]
    read = averaged(mean_current(course, model), width)
    if course.by_current:
        scale = course.per_command * course.resistance / model.linear.per_ampere
        scale /= 1.0 + course.calibration["current_gain"]
        forces = scale * (model.linear.per_ampere * read - opposed)
    left_volts = averaged(volts, width) - resistance * read
    left_volts -= inductance * averaged(per_interval(course.true_current) / step, width)
    return np.column_stack([forces, course.per_command * left_volts])


def leftovers(courses: Courses, model: Drive, law: Laws | None = None) -> list[Matrix]:
    """`balance` of each record; `law` is the friction along the records if already computed."""
    law = law or [model.friction(c.x, c.v, c.step) for c in courses]
    return [balance(c, model, friction) for c, friction in zip(courses, law, strict=True)]


def responses(courses: Courses, model: Drive, form: Form) -> list[Matrix]:
    """Effect of a cause of amplitude one on each balance: (windows, channels, m) per record [N]."""
    found = []
    for record, course in enumerate(courses):
        count = windows(len(course.x), course.width)
        out = np.zeros((count, 1 + course.has_current, len(form.amplitudes)))
        if form.force is not None:
            out[:, 0] += averaged(form.force[record], course.width)
        if form.command is not None:
            command = form.command[record]
            if not model.has_motor:
                out[:, 0] -= model.values["gain"] * averaged(command, course.width)
            elif not course.by_current:
                late = lagged(command, model.values["L"] / model.values["R"], course.step)
                out[:, 0] -= model.linear.per_command * averaged(late, course.width)
            if course.has_current:
                out[:, 1] -= course.per_command * averaged(command, course.width)
        found.append(out)
    return found


def sensitivities(courses: Courses, model: Drive, law: Laws, of_law: bool) -> list[Matrix]:
    """Effect of values and calibrations on the balances: (windows, channels, columns) per record.

    The columns are a relative change of each adjustable value, then a change of each
    calibration. `law` is that along the records, which does not change without `of_law`.
    """

    def slope(name: str, of_model: bool) -> list[Matrix]:
        own = None if of_law and of_model and name in model.law_parameters else law
        ends = []
        for s in (-_STEP, _STEP):
            changed = model.changed({name: model.values[name] * (1 + s)}) if of_model else model
            those = courses if of_model else recalibrated(courses, {name: s})
            ends.append(leftovers(those, changed, own))
        return [(a - b) / (2 * _STEP) for a, b in zip(*ends, strict=True)]

    columns = [slope(name, True) for name in model.adjustable]
    columns += [slope(name, False) for name in courses[0].calibration]
    return [np.stack(record, axis=2) for record in zip(*columns, strict=True)]


# -- where forces are known --------------------------------------------------------------------


def moving(course: Course, model: Drive) -> Vector:
    """One for each window that gives forces, else zero, shape (windows,).

    Windows at a rest or a jump, near one and at the start are zero. A law without bristles has no
    known force at a rest that is longer than a reversal. The current in the winding before the
    start is not known.
    """
    slow, still = course.silent, np.abs(course.v) < course.slowest
    rigid = fitted_law(model.law).form != "bristles"
    if rigid:
        slow = slow | binary_opening(still, np.ones(2 * course.width, dtype=bool))
    rests = averaged(slow.astype(float), course.width) > 0.0
    near = maximum_filter1d(rests, 2 * AROUND_REST + 1, mode="constant")
    near[: 2 * AROUND_REST] = True
    if rigid:  # the direction of friction is not known there
        near |= averaged(still.astype(float), course.width) > 0.0
    return np.asarray(1.0 - near)


def check_motion(courses: Courses, model: Drive) -> None:
    """Raise BadRecord for records with almost no motion, or with one that smoothing takes out."""
    for c in courses:
        seen = 2.0 * np.median(np.abs(c.v)) + 3.0 * position_noise(c.record) / c.step
        if np.median(np.abs(c.moved_v)) > seen:
            raise BadRecord(f"{c.record.name}: the axis vibrates, faster than forces are averaged")
    moves = [moving(c, model) for c in courses]
    count, parts = int(sum(m.sum() for m in moves)), sum(map(len, moves))
    if count < _FEWEST:
        names = ", ".join(c.record.name for c in courses)
        raise BadRecord(
            f"{names}: only {count} of {parts} parts of {courses[0].width} samples are in motion; "
            f"expected {_FEWEST} at least: x is constant, jumps from sample to sample or is noise"
        )


@dataclass(frozen=True)
class Residual:
    """Residuals of one study, its records end to end, shape (n,)."""

    force: Vector  # opposes motion in +x and is missing in the model [N]
    by_current: Vector  # motor force by the voltage less that by the current, 0 without one [N]
    telling: Mask  # samples at which forces are known

    @property
    def force_rms(self) -> float:
        return rms(self.force[self.telling])

    @property
    def by_current_rms(self) -> float:
        return rms(self.by_current[self.telling])


def rms(values: Vector) -> float:
    """Root mean square; zero for an empty array."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def residual(courses: Courses, model: Drive) -> Residual:
    """Force missing in a model and the causes along each record.

    Forces are scaled to the prior model's force per unit of the command, see `balance`. At jumps of
    the law's force they are not known, because the instant within a sampling interval is not.
    """
    parts = []
    for c, left in zip(courses, leftovers(courses, model), strict=True):
        size = len(c.x), c.width
        whole = at_samples(left[:, 0], *size)
        between = at_samples(left[:, 1], *size) if c.has_current else np.zeros(len(whole))
        if c.by_current:  # the input of a simulation is the voltage
            whole = whole + between
        jumps = np.abs(np.diff(c.bristle, append=c.bristle[-1:]))
        steady = averaged(jumps, c.width) < _JUMP * model.friction_scale
        keep = at_samples(np.asarray(moving(c, model) * steady, dtype=float), *size) == 1.0
        parts.append((whole, between, keep))
    return Residual(*map(np.concatenate, zip(*parts, strict=True)))


def noise_of_readings(courses: Courses, model: Drive) -> Residual:
    """Residual due to rounding and instrument noise alone: the change with a repeated reading.

    It does not include the law's error due to the error of the motion, see `force_variance`.
    """
    random = np.random.default_rng(0)
    once = residual(courses, model)
    again = residual([read_anew(c, model, random) for c in courses], model)
    return Residual(again.force - once.force, again.by_current - once.by_current, once.telling)
