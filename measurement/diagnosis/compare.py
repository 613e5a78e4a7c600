"""Errors of models on a record: of the force, and of the predicted position."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...orchestration.loop.parameter_file import (
    TURNS,
    Diagnosed,
    ParameterFile,
    Value,
    read_parameters,
)
from ...plant.law import claims
from ...solver.arrays import Mask, Vector
from ...solver.errors import BadParameters, BadRecord
from ..identification.motion_parts import PARTS, REST, motion_parts
from ..records.examine import check_identifiable
from ..records.reading import read_drive_records
from ..records.record import CURRENT, TORQUE, Record
from .balance import Added, balance
from .bands import AROUND_REST
from .blocks import Blocks, Estimate, ends_of_seconds
from .causes import CAUSES
from .commanded import by_current, by_torque, commanded
from .compared import ADJUSTED, ALL, CORRECTED, MODEL, PRIOR, Compared, Gain, Left, Traces
from .diagnosis_pictures import binned
from .drive import Drive, compiled, drive_of
from .modelled_record import ModelledRecord, jumps_of, lay_along, shaken, with_law_force
from .predicted import NotPredicted, Predictor
from .residuals import at_samples, check_motion, floor, residual, rms
from .weak_form import averaged
from .with_causes import PARTING

Causes = Mapping[str, Mapping[str, float]]

_GAINS = ((ADJUSTED, PRIOR), (CORRECTED, PRIOR), (CORRECTED, ADJUSTED))
_SLOWEST = 1e-5  # speed just above rest, at which stiction is computed [m/s]
_SPEEDS = 200  # points of a curve in each direction


def compare(
    data: Sequence[Path | str],
    params: Path | str,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
    progress: Callable[[str], None] = lambda doing: None,
) -> Compared:
    """Compare the models of a parameter file with records; see `ballscrew.compare`."""
    progress("reading")
    file = read_parameters(params).with_lead(lead)
    lead = lead or file.lead
    return compare_records(read_drive_records(data, mapping, units, lead), file, progress)


def compare_records(
    records: Sequence[Record],
    file: ParameterFile,
    progress: Callable[[str], None] = lambda doing: None,
) -> Compared:
    """Like `compare`, for records and a parameter file in memory; nothing is fitted to the records.

    Raises
    ------
    BadRecord, BadParameters
        If an input cannot be used; the message says why in one line.
    """
    told = file.diagnosis
    if told is None:
        records, drive, notes = commanded(records, drive_of(file))
        models = {MODEL: drive}
        if file.found:
            notes.append(f"left aside: {', '.join(file.found)} of [found], no part of the plant")
    else:
        models = _models(file, told)
        known = [_commanded(r, told) for r in records]
        records, _, notes = commanded(known, models[PRIOR])
    notes += [TURNS] * file.turns + check_identifiable(records)
    first = next(iter(models.values()))
    shift = told.command_shift if told else 0.0
    courses = [_laid(r, first, shift) for r in records]
    check_motion(courses, first)
    notes += jumps_of(courses)
    nothing = Added.nothing(courses)
    extras = {name: _Extra(nothing, nothing.force, {}, False) for name in models}
    if told is not None:
        extras[CORRECTED] = _causes_along(courses, models[CORRECTED], file, told)
    found = {}
    for name, model in models.items():
        progress(f"solving the {name} model" if told else "solving the model")
        found[name] = _along(courses, model, extras[name])
        if found[name].why:
            notes.append(f"no position is predicted with the {name} model: {found[name].why}")
    return _compared(courses, models, found, told, notes)


@dataclass(frozen=True)
class _Extra:
    """What is added to a model's equations: signals along the records, and causes in its plant.

    Forces in `at_rest` also act on a body at rest; the force of a joint does not.
    """

    added: Added
    at_rest: list[Vector]
    built: Causes
    caused: bool


@dataclass(frozen=True)
class _Found:
    """Residuals of one model, the records end to end, shape (n,); a prediction may be missing."""

    force: Vector
    required: Vector
    counted: Mask
    predict: Callable[[Sequence[ModelledRecord]], Vector]
    predicted: Vector | None
    why: str
    curve: tuple[Vector, Vector]


def _along(courses: Sequence[ModelledRecord], model: Drive, extra: _Extra) -> _Found:
    """Residuals of a model on the records."""
    added = extra.added
    required = [_required(c, model, u) for c, u in zip(courses, added.command, strict=True)]
    left = residual(courses, model, added)
    beyond = [
        _beyond_stiction(c, model, *forces)
        for c, *forces in zip(courses, required, extra.at_rest, strict=True)
    ]
    rests = np.concatenate([c.rests for c in courses])
    force = np.where(rests, np.concatenate(beyond), left.force)
    predictor = Predictor(model, extra.built)

    def predict(them: Sequence[ModelledRecord]) -> Vector:
        return np.concatenate([predictor(c, u) for c, u in zip(them, added.command, strict=True)])

    predicted, why = None, ""
    try:
        predicted = predict(courses)
    except NotPredicted as error:
        why = str(error)
    whole = np.concatenate(required)
    curve = _curve(model, courses)
    if extra.caused:
        v = np.concatenate([c.v for c in courses])
        curve = binned(v, whole - force, left.telling, alike=True)
    return _Found(force, whole, left.telling, predict, predicted, why, curve)


def _compared(
    courses: Sequence[ModelledRecord],
    models: Mapping[str, Drive],
    found: Mapping[str, _Found],
    told: Diagnosed | None,
    notes: Sequence[str],
) -> Compared:
    first = next(iter(found.values()))
    lowest = next(iter(models)) if told is None else ADJUSTED
    x = np.concatenate([c.x for c in courses])
    ends = ends_of_seconds(courses)
    squares = Blocks(ends)
    parts = [motion_parts(c.step, c.v, c.mean_a, c.rests) for c in courses]
    masks = {ALL: np.ones(len(x), dtype=bool)}
    masks |= {name: np.concatenate([p[name] for p in parts]) for name in PARTS}
    counted = {n: m & first.counted for n, m in masks.items()}
    counted[REST] = np.concatenate([_well_within_rest(c) for c in courses])

    def root(values: Vector, mask: Mask) -> Estimate | None:
        return squares.rms(values, mask) if mask.any() else None

    def left(f: _Found) -> dict[str, Left]:
        return {
            n: Left(
                root(f.force, counted[n]),
                None if f.predicted is None else root(f.predicted - x, mask),
            )
            for n, mask in masks.items()
            if mask.any()
        }

    def gain(model: str, over: str) -> Gain:
        one, other = found[model], found[over]
        known = one.predicted is not None and other.predicted is not None
        return Gain(
            squares.gain(other.force, one.force, counted[ALL]),
            squares.gain(other.predicted - x, one.predicted - x) if known else None,
            model,
            over,
        )

    noise = floor(courses, models[lowest])
    once, shown = found[lowest].predicted, None
    if once is not None:
        random = np.random.default_rng(0)
        shown = squares.rms(found[lowest].predict([shaken(c, random) for c in courses]) - once)
    starts = np.zeros(len(x), dtype=bool)
    starts[ends[:-1]] = True
    return Compared(
        records=tuple(c.record.name for c in courses),
        diagnosed=told.records if told else (),
        causes=tuple(told.causes) if told else (),
        seconds=float(sum(len(c.x) * c.step for c in courses)),
        friction=rms(first.required[first.counted]),
        shares={n: float(m.mean()) for n, m in masks.items() if n != ALL and m.any()},
        models={name: left(f) for name, f in found.items()},
        floor=Left(root(noise.force, counted[ALL]), shown),
        gains=tuple(gain(*pair) for pair in _GAINS) if told else (),
        notes=tuple(notes),
        traces=Traces(
            time=_end_to_end(courses),
            x=x,
            v=np.concatenate([c.v for c in courses]),
            required=first.required,
            rests=masks[REST],
            counted=first.counted,
            starts=starts,
            left={name: f.force for name, f in found.items()},
            predicted={n: f.predicted for n, f in found.items() if f.predicted is not None},
            curves={name: f.curve for name, f in found.items()},
        ),
    )


# -- along one record ------------------------------------------------------------------------


def _laid(record: Record, model: Drive, shift: float) -> ModelledRecord:
    """The record with its motion; the command is shifted in time as in the diagnosis."""
    course = lay_along(record, model)
    return replace(course, calibration={**course.calibration, "command_shift": shift})


def _required(course: ModelledRecord, model: Drive, command: Vector) -> Vector:
    """Force of the command less mass times acceleration, shape (n,) [N]."""
    nothing = np.zeros(len(course.x))
    less_viscous = balance(course, model, nothing, nothing, command)[:, 0]
    viscous = _scale(course, model) * model.linear_friction * averaged(course.moved_v, course.width)
    return at_samples(course, less_viscous + viscous)


def _well_within_rest(course: ModelledRecord) -> Mask:
    """Samples at rest that are not near a motion; the counterpart of `moving`."""
    moves = averaged((~course.rests).astype(float), course.width) > 0.0
    near = np.convolve(moves, np.ones(2 * AROUND_REST + 1), mode="same")
    return np.asarray(course.rests & (at_samples(course, near) == 0.0))


def _beyond_stiction(
    course: ModelledRecord, model: Drive, required: Vector, force: Vector
) -> Vector:
    """Required force beyond what friction can hold at rest, shape (n,) [N].

    Friction at rest can hold as much as the law's friction at a speed just above rest.
    """
    scale = _scale(course, model)
    asked = required - scale * (force + model.values.get("offset", 0.0))
    backwards, forwards = scale * _sliding(model, np.array([-_SLOWEST, _SLOWEST]))
    return np.asarray(asked - np.clip(asked, backwards, forwards))


def _scale(course: ModelledRecord, model: Drive) -> float:
    """Scale of forces: the first model's force per unit of the command, see `balance`."""
    return course.per_command / model.per_command


def _sliding(model: Drive, v: Vector) -> Vector:
    """Friction in steady sliding at these velocities, shape (n,) [N]."""
    names, steady = compiled(claims(model.law).steady_state)
    numbers = {**model.values, "v": v}
    return np.broadcast_to(np.asarray(steady(*(numbers[n] for n in names)), dtype=float), v.shape)


def _curve(model: Drive, courses: Sequence[ModelledRecord]) -> tuple[Vector, Vector]:
    """Friction over velocity, within the records' speeds: [m/s] and [N]."""
    fastest = max(float(np.abs(c.v).max()) for c in courses)
    speeds = np.linspace(0.0, 1.0, _SPEEDS) ** 3 * fastest + _SLOWEST
    v = np.concatenate([-speeds[::-1], speeds])
    return v, _sliding(model, v) + model.values.get("offset", 0.0)


def _end_to_end(courses: Sequence[ModelledRecord]) -> Vector:
    lasting = np.cumsum([0.0, *(len(c.x) * c.step for c in courses)])
    return np.concatenate([c.time + begin for c, begin in zip(courses, lasting[:-1], strict=True)])


# -- the models of a diagnosis ---------------------------------------------------------------


def _models(file: ParameterFile, told: Diagnosed) -> dict[str, Drive]:
    """The three models, by name, without forces of causes."""

    def model(where: str, values: Mapping[str, Value]) -> Drive:
        missing = [n for n in told.prior if n not in values]
        if missing:
            raise BadParameters(f"{file.path}: [{where}] has no {missing[0]!r}")
        own = {n: values[n] for n in told.prior}
        return drive_of(replace(file, law=told.law, plant=own, found={}, tolerance={}))

    def plain(values: Mapping[str, float]) -> dict[str, Value]:
        return {n: Value(v) for n, v in values.items()}

    return {
        PRIOR: model("diagnosis.prior", plain(told.prior)),
        ADJUSTED: model("diagnosis.adjusted", plain(told.adjusted)),
        CORRECTED: model("plant", file.plant),
    }


def _commanded(record: Record, told: Diagnosed) -> Record:
    """The record with the command that the models take."""
    record = by_torque(record) if told.command == TORQUE else record
    current = by_current(record) if told.command == CURRENT else None
    if current is not None:
        return current
    if record.current_alone:
        raise BadRecord(
            f"{record.name}: has the current i and no command u; the model was diagnosed with a "
            f"{told.command} as u"
        )
    if record.command != told.command:
        raise BadRecord(
            f"{record.name}: u is a {record.command}, but the model was diagnosed with a "
            f"{told.command} as u; use such a record, or give its unit with unit u=UNIT"
        )
    return record


def _causes_along(
    courses: Sequence[ModelledRecord], model: Drive, file: ParameterFile, told: Diagnosed
) -> _Extra:
    """The named causes: signals along each record, and causes to include in the plant.

    Causes that are values are already in the model. Causes in the command are known along a record,
    also at the start of each second, so they are not included in the plant.
    """
    forces, commands, at_rest = [], [], []
    built: dict[str, Mapping[str, float]] = {}
    for course in courses:
        alone = [with_law_force(course, model)]
        added = resting = Added.nothing(alone)
        for name, values in told.causes.items():
            if name not in CAUSES:
                raise BadParameters(
                    f"{file.path}: [diagnosis.causes] there is no {name!r}; there are "
                    f"{', '.join(CAUSES)}"
                )
            if "warming" in values and "temperature" not in course.record.signals:
                raise BadRecord(
                    f"{course.record.name}: has no column 'temperature', with which {name} changes"
                )
            try:
                shape = CAUSES[name].at(alone, model, values)
                sizes = [1.0 if shape.sure is not None else values[n] for n in shape.amplitudes]
            except KeyError as error:
                raise BadParameters(
                    f"{file.path}: [diagnosis.causes.{name}] has no {error.args[0]!r}"
                ) from error
            if shape.command is None:
                built[name] = values
            if not shape.freed:
                added = added.more(shape, np.array(sizes))
            if not shape.freed and name not in PARTING:
                resting = resting.more(shape, np.array(sizes))
        forces += added.force
        commands += added.command
        at_rest += resting.force
    return _Extra(Added(forces, commands), at_rest, built, bool(told.causes))
