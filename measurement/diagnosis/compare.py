"""Errors of models on a record: of the force, and of the predicted position."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...orchestration.loop.parameter_file import TURNS, Diagnosed, ParameterFile, Value
from ...plant.law import claims
from ...solver.arrays import Mask, Vector
from ...solver.errors import BadParameters, BadRecord
from ..identification.motion_parts import REST, motion_parts
from ..records.examine import check_identifiable
from ..records.record import Record
from .balance import AROUND_REST, Added, balance, check_motion, noise_of_readings, residual, rms
from .causes import CAUSES
from .compared import ALL, Blocks, Compared, Estimate, Gain, Left, Traces
from .corrected import NOT_PREDICTED, PARTING, Causes, Predictor, ends_of_seconds
from .model import Drive, commanded, compiled, drive_of
from .motion import Course, jumps_of, lay_along, recalibrated, shaken, with_law_force
from .windows import at_samples, averaged

Courses = Sequence[Course]

_GAINS = (("adjusted", "prior"), ("corrected", "prior"), ("corrected", "adjusted"))
_SLOWEST = 1e-5  # speed just above rest, at which stiction is computed [m/s]


def compare_records(
    records: Sequence[Record],
    file: ParameterFile,
    progress: Callable[[str], None] = lambda doing: None,
) -> Compared:
    """Compare the models of a parameter file with records; nothing is fitted to the records.

    Raises
    ------
    BadRecord, BadParameters
        If an input cannot be used; the message says why in one line.
    """
    diagnosed = file.diagnosis
    models = _models(file, diagnosed) if diagnosed else {"model": drive_of(file)}
    first = next(iter(models))
    records, accepts, notes = commanded(records, models[first])
    if diagnosed and accepts.kind != models[first].kind:
        raise BadRecord(
            f"{records[0].name}: the current is its only command; the model was diagnosed with a "
            f"{diagnosed.command} as u"
        )
    models[first] = accepts
    if file.found and not diagnosed:
        notes.append(f"left aside: {', '.join(file.found)} of [found], no part of the plant")
    notes += [TURNS] * file.turns + check_identifiable(records)
    shift = {"command_shift": diagnosed.command_shift if diagnosed else 0.0}
    courses = recalibrated([lay_along(r, accepts) for r in records], shift)
    check_motion(courses, accepts)
    notes += jumps_of(courses)
    found, lowest = {}, "adjusted" if diagnosed else "model"
    for name, model in models.items():
        progress(f"solving the {name} model" if diagnosed else "solving the model")
        causes = diagnosed.causes if diagnosed and name == "corrected" else {}
        found[name] = _found(courses, model, causes, file.path, name == lowest)
        if found[name].why:
            notes.append(f"no position is predicted with the {name} model: {found[name].why}")
    return _compared(
        courses, found, noise_of_readings(courses, models[lowest]).force, diagnosed, notes
    )


@dataclass(frozen=True)
class _Found:
    """Residuals of one model, the records end to end, shape (n,)."""

    force: Vector
    required: Vector
    counted: Mask
    predicted: Vector  # NaN if it cannot be predicted
    noise: Vector  # change of the prediction with another reading of the encoder; perhaps NaN
    why: str


def _found(
    courses: Courses, model: Drive, causes: Causes, path: Path | None, lowest: bool
) -> _Found:
    """Residuals of a model with its causes on the records; `lowest` also has the noise."""
    added, at_rest, built = _causes_along(courses, model, causes, path)
    required = [_required(c, model, u) for c, u in zip(courses, added.command, strict=True)]
    left = residual(courses, model, added)
    beyond = [
        _beyond_stiction(c, model, *forces)
        for c, *forces in zip(courses, required, at_rest, strict=True)
    ]
    rests = np.concatenate([c.rests for c in courses])
    force = np.where(rests, np.concatenate(beyond), left.force)
    random, why = np.random.default_rng(0), ""
    predicted, again = np.full((2, len(force)), np.nan)
    readings = [(predicted, courses)]
    if lowest:
        readings.append((again, [shaken(c, random) for c in courses]))
    try:
        predictor = Predictor(model, built)
        for out, them in readings:
            along = zip(them, added.command, strict=True)
            out[:] = np.concatenate([predictor(c, u) for c, u in along])
    except NOT_PREDICTED as error:
        why = str(error)
    noise = again - predicted
    return _Found(force, np.concatenate(required), left.telling, predicted, noise, why)


def _compared(
    courses: Courses,
    found: Mapping[str, _Found],
    noise: Vector,
    diagnosed: Diagnosed | None,
    notes: Sequence[str],
) -> Compared:
    first, lowest = next(iter(found.values())), found["adjusted" if diagnosed else "model"]
    x = np.concatenate([c.x for c in courses])
    ends = ends_of_seconds(courses)
    squares = Blocks(ends)
    parts = [motion_parts(c.step, c.v, c.mean_a, c.rests) for c in courses]
    masks = {ALL: np.ones(len(x), dtype=bool)}
    masks |= {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    counted = {n: m & first.counted for n, m in masks.items()}
    counted[REST] = np.concatenate([_well_within_rest(c) for c in courses])

    def root(values: Vector, mask: Mask) -> Estimate | None:
        known = mask.any() and not np.isnan(values).any()
        return squares.rms(values, mask) if known else None

    def left(f: _Found) -> dict[str, Left]:
        off = f.predicted - x
        there = {n: mask for n, mask in masks.items() if mask.any()}
        return {n: Left(root(f.force, counted[n]), root(off, m)) for n, m in there.items()}

    def gain(model: str, over: str) -> Gain:
        one, other = found[model], found[over]
        before, after = other.predicted - x, one.predicted - x
        position = None if one.why or other.why else squares.gain(before, after)
        return Gain(squares.gain(other.force, one.force, counted[ALL]), position, model, over)

    starts = np.zeros(len(x), dtype=bool)
    starts[ends[:-1]] = True
    begins = np.cumsum([0.0, *(len(c.x) * c.step for c in courses)])
    return Compared(
        records=tuple(c.record.name for c in courses),
        diagnosed=diagnosed.records if diagnosed else (),
        causes=tuple(diagnosed.causes) if diagnosed else (),
        seconds=float(begins[-1]),
        friction=rms(first.required[first.counted]),
        shares={n: float(m.mean()) for n, m in masks.items() if n != ALL and m.any()},
        models={name: left(f) for name, f in found.items()},
        floor=Left(root(noise, counted[ALL]), root(lowest.noise, masks[ALL])),
        gains=tuple(gain(*pair) for pair in _GAINS) if diagnosed else (),
        notes=tuple(notes),
        traces=Traces(
            time=np.concatenate([c.time + t for c, t in zip(courses, begins, strict=False)]),
            x=x,
            v=np.concatenate([c.v for c in courses]),
            required=first.required,
            rests=masks[REST],
            counted=first.counted,
            starts=starts,
            left={name: f.force for name, f in found.items()},
            predicted={n: f.predicted for n, f in found.items() if not f.why},
        ),
    )


# -- along one record ------------------------------------------------------------------------


def _required(course: Course, model: Drive, command: Vector) -> Vector:
    """Force of the command less mass times acceleration, shape (n,) [N]."""
    nothing, viscous = np.zeros(len(course.x)), model.linear_friction * course.moved_v
    left = balance(course, model, nothing, -viscous, command)
    return at_samples(left[:, 0], len(course.x), course.width)


def _well_within_rest(course: Course) -> Mask:
    """Samples at rest that are not near a motion; the counterpart of `moving`."""
    moves = averaged((~course.rests).astype(float), course.width) > 0.0
    near = np.convolve(moves, np.ones(2 * AROUND_REST + 1), mode="same")
    return np.asarray(course.rests & (at_samples(near, len(course.x), course.width) == 0.0))


def _beyond_stiction(course: Course, model: Drive, required: Vector, force: Vector) -> Vector:
    """Required force beyond what friction can hold at rest, shape (n,) [N].

    Friction at rest can hold as much as the law's friction in sliding at a speed just above rest.
    """
    scale = course.per_command / model.linear.per_command  # as in `balance`
    asked = required - scale * (force + model.values.get("offset", 0.0))
    names, steady = compiled(claims(model.law).steady_state)
    sides = ({**model.values, "v": v} for v in (-_SLOWEST, _SLOWEST))
    backwards, forwards = (scale * float(steady(*(v[n] for n in names))) for v in sides)
    return np.asarray(asked - np.clip(asked, backwards, forwards))


# -- the models of a diagnosis ---------------------------------------------------------------


def _models(file: ParameterFile, diagnosed: Diagnosed) -> dict[str, Drive]:
    """The three models, by name, without forces of causes."""

    def model(where: str, values: Mapping[str, Value | float]) -> Drive:
        missing = [n for n in diagnosed.prior if n not in values]
        if missing:
            raise BadParameters(f"{file.path}: [{where}] has no {missing[0]!r}")
        own = {n: v if isinstance(v := values[n], Value) else Value(v) for n in diagnosed.prior}
        drive = drive_of(replace(file, law=diagnosed.law, plant=own, found={}, tolerance={}))
        return drive if drive.has_motor else replace(drive, command=diagnosed.command)

    return {
        "prior": model("diagnosis.prior", diagnosed.prior),
        "adjusted": model("diagnosis.adjusted", diagnosed.adjusted),
        "corrected": model("plant", file.plant),
    }


def _causes_along(
    courses: Courses, model: Drive, causes: Causes, path: Path | None
) -> tuple[Added, list[Vector], Causes]:
    """Signals of causes along the records, their forces at rest, and causes to have in the plant.

    Causes that are values are already in the model. Causes in the command are known along a record,
    also at the start of each second, so they are not included in the plant. The force of a joint
    does not act on a body at rest.
    """
    forces, commands, at_rest = [], [], []
    built: dict[str, Mapping[str, float]] = {}
    for course in courses:
        alone = [with_law_force(course, model)]
        added = resting = Added.nothing(alone)
        for name, values in causes.items():
            where = f"{path}: [diagnosis.causes"
            if name not in CAUSES:
                raise BadParameters(f"{where}] there is no {name!r}; there are {', '.join(CAUSES)}")
            if "warming" in values and "temperature" not in course.record.signals:
                raise BadRecord(
                    f"{course.record.name}: has no column 'temperature', with which {name} changes"
                )
            try:
                shape = CAUSES[name].at(alone, model, values)
                sizes = [1.0 if shape.sure is not None else values[n] for n in shape.amplitudes]
            except KeyError as error:
                raise BadParameters(f"{where}.{name}] has no {error.args[0]!r}") from error
            if shape.command is None:
                built[name] = values
            if not shape.freed:
                added = added.more(shape, np.array(sizes))
            if not shape.freed and name not in PARTING:
                resting = resting.more(shape, np.array(sizes))
        forces += added.force
        commands += added.command
        at_rest += resting.force
    return Added(forces, commands), at_rest, built
