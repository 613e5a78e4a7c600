"""Errors of models on a record: of the force, and of the predicted position."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.special import ndtri, stdtrit

from ...orchestration.loop.parameter_file import TURNS, Diagnosed, ParameterFile, Value
from ...orchestration.loop.shown import length
from ...plant.law import claims
from ...solver.arrays import Mask, Vector
from ...solver.errors import BadParameters, BadRecord
from ...solver.files import write_json
from ..identification.motion_parts import REST, motion_parts
from ..records.examine import check_identifiable
from ..records.record import Record
from .balance import AROUND_REST, Courses, balance, check_motion, noise_of_readings, residual, rms
from .causes import CAUSES, SIGNALS
from .corrected import IN_COMMAND, NOT_PREDICTED, PARTING, Causes, Predictor, ends_of_seconds
from .model import SLOWEST, Drive, commanded, compiled, drive_of
from .motion import Course, jumps_of, lay_along, recalibrated, shaken, with_law_force
from .windows import at_samples, averaged

ALL = "all"
_GAINS = (("adjusted", "prior"), ("corrected", "prior"), ("corrected", "adjusted"))
_DRAWS = 2000
_FEWEST = 4  # blocks needed for an interval


@dataclass(frozen=True)
class Estimate:
    """A value and its 95 % interval; None if there are too few blocks for an interval."""

    value: float
    interval: tuple[float, float] | None


@dataclass(frozen=True)
class Left:
    """Rms residuals of a model in a part of the motion; None if not known."""

    force: Estimate | None  # missing in the model [N]; at rest, beyond its stiction
    position: Estimate | None  # error of the prediction from the start of each second [m]

    def to_dict(self, force: str = "_N", position: str = "_m") -> dict[str, Any]:
        """Its content in ``compare.json``, with the units in the names."""
        both = (("force", self.force, force), ("position", self.position, position))
        return {
            name: e and {f"value{unit}": e.value, f"interval{unit}": e.interval and [*e.interval]}
            for name, e, unit in both
        }


@dataclass(frozen=True)
class Gain(Left):
    """Share of the mean square residual of one model that another model removes."""

    model: str
    over: str


@dataclass(frozen=True)
class Trace:
    """A model along the records, end to end, shape (n,)."""

    required: Vector  # force of the command less mass times acceleration [N]
    force: Vector  # missing in the model [N]
    counted: Mask  # samples at which forces are known
    predicted: Vector  # position from each second's start; NaN if it cannot be predicted [m]
    noise: Vector  # change of `predicted` with another reading of the encoder; perhaps NaN [m]
    why: str  # why a position cannot be predicted


@dataclass(frozen=True)
class Compared:
    """Errors of models on records.

    The models are the one ``model`` of a file, or ``prior``, ``adjusted`` and ``corrected`` of a
    diagnosis.
    """

    records: tuple[str, ...]  # their names
    diagnosed: tuple[str, ...]  # if the file comes from a diagnosis: its records
    causes: tuple[str, ...]  # and the causes in ``corrected``
    seconds: float  # length of the records [s]
    friction: float  # rms force required by the motion, where forces are known [N]
    shares: dict[str, float]  # share of time in each part of the motion, see `PARTS`
    models: dict[str, dict[str, Left]]  # by model, and by part of the motion, all of it first
    floor: Left  # due to the noise of the instruments alone
    gains: tuple[Gain, ...]  # of one model over another
    notes: tuple[str, ...]  # warnings
    courses: tuple[Course, ...]  # the records
    traces: dict[str, Trace]  # by model

    @property
    def says(self) -> str:
        """The result in a sentence."""
        *_, (name, parts) = self.models.items()
        whole, who = parts[ALL], "the model" if name == "model" else f"the {name} model"
        words = "no force can be computed"
        if whole.force:
            share = 100 * whole.force.value / self.friction
            words = (
                f"{who} leaves {whole.force.value:.2g} N rms of a friction of "
                f"{self.friction:.3g} N rms ({share:.2g} %)"
            )
        if whole.position:
            words += f"; its position drifts {length(whole.position.value)} rms within a second"
        return words

    def to_dict(self) -> dict[str, Any]:
        """Content of ``compare.json``."""
        return {
            "says": self.says,
            "records": list(self.records),
            "diagnosed": list(self.diagnosed),
            "causes": list(self.causes),
            "seconds": self.seconds,
            "friction_N": self.friction,
            "shares": self.shares,
            "models": {n: {p: e.to_dict() for p, e in of.items()} for n, of in self.models.items()},
            "floor": self.floor.to_dict(),
            "gains": [{"model": g.model, "over": g.over} | g.to_dict("", "") for g in self.gains],
            "notes": list(self.notes),
        }

    def save(self, folder: Path | str) -> None:
        """Write ``compare.json`` into `folder`; raises OSError if it cannot be written."""
        write_json(Path(folder) / "compare.json", self.to_dict())


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
    causes = {n: v for n, v in (diagnosed.causes if diagnosed else {}).items() if n not in SIGNALS}
    if diagnosed and (aside := [n for n in diagnosed.causes if n in SIGNALS]):
        what = "wrong in the records diagnosed, not in the plant: correct it in a record"
        notes.append(f"left aside: {', '.join(aside)}, {what}")
    notes += [TURNS] * file.turns + check_identifiable(records)
    shift = {"command_shift": diagnosed.command_shift if diagnosed else 0.0}
    courses = recalibrated([lay_along(r, accepts) for r in records], shift)
    check_motion(courses, accepts)
    notes += jumps_of(courses)
    traces, lowest = {}, "adjusted" if diagnosed else "model"
    for name, model in models.items():
        progress(f"solving the {name} model" if diagnosed else "solving the model")
        own = causes if name == "corrected" else {}
        traces[name] = _trace(courses, model, own, file.path, name == lowest)
        if why := traces[name].why:
            notes.append(f"no position is predicted with the {name} model: {why}")

    x = np.concatenate([c.x for c in courses])
    squares = Blocks(ends_of_seconds(courses))
    parts = [motion_parts(c.step, c.v, c.mean_a, c.rests) for c in courses]
    masks = {ALL: np.ones(len(x), dtype=bool)}
    masks |= {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    counted = {n: m & traces[first].counted for n, m in masks.items()}
    counted[REST] = np.concatenate([_well_within_rest(c) for c in courses])

    def root(values: Vector, mask: Mask) -> Estimate | None:
        known = mask.any() and not np.isnan(values).any()
        return squares.rms(values, mask) if known else None

    def left(force: Vector, off: Vector, part: str) -> Left:
        return Left(root(force, counted[part]), root(off, masks[part]))

    def gain(model: str, over: str) -> Gain:
        one, other = traces[model], traces[over]
        before, after = other.predicted - x, one.predicted - x
        position = None if one.why or other.why else squares.gain(before, after)
        return Gain(squares.gain(other.force, one.force, counted[ALL]), position, model, over)

    noise = noise_of_readings(courses, models[lowest]).force
    return Compared(
        records=tuple(c.record.name for c in courses),
        diagnosed=diagnosed.records if diagnosed else (),
        causes=tuple(causes),
        seconds=sum(len(c.x) * c.step for c in courses),
        friction=rms(traces[first].required[traces[first].counted]),
        shares={n: float(m.mean()) for n, m in masks.items() if n != ALL and m.any()},
        models={
            name: {n: left(t.force, t.predicted - x, n) for n, m in masks.items() if m.any()}
            for name, t in traces.items()
        },
        floor=left(noise, traces[lowest].noise, ALL),
        gains=tuple(gain(*pair) for pair in _GAINS) if diagnosed else (),
        notes=tuple(notes),
        courses=tuple(courses),
        traces=traces,
    )


# -- a model along the records -------------------------------------------------------------------


def _models(file: ParameterFile, diagnosed: Diagnosed) -> dict[str, Drive]:
    """The three models of a diagnosis, by name, without forces of causes."""

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


def _trace(courses: Courses, model: Drive, causes: Causes, path: Path | None, again: bool) -> Trace:
    """A model with its causes along the records; `again` with another reading of the encoder.

    Causes in the command are known along a record, also at the start of each second, so they are
    not included in the plant. The force of a joint does not act on a body at rest.
    """
    own = [_with_causes(c, model, causes, path) for c in courses]
    required = [_required(c, model) for c in own]
    acting = {name: values for name, values in causes.items() if name not in PARTING}
    resting = [_with_causes(c, model, acting, path).added_force for c in courses]
    beyond = map(_beyond_stiction, courses, [model] * len(courses), required, resting)
    left, rests = residual(own, model), np.concatenate([c.rests for c in courses])
    force = np.where(rests, np.concatenate([*beyond]), left.force)
    random, why = np.random.default_rng(0), ""
    predicted, anew = np.full((2, len(force)), np.nan)
    readings = [(predicted, own)]
    if again:
        readings.append((anew, [shaken(c, random) for c in own]))
    try:
        predictor = Predictor(model, {n: v for n, v in causes.items() if n not in IN_COMMAND})
        for out, read in readings:
            out[:] = np.concatenate([predictor(c) for c in read])
    except NOT_PREDICTED as error:
        why = str(error)
    noise = anew - predicted
    return Trace(np.concatenate(required), force, left.telling, predicted, noise, why)


def _with_causes(course: Course, model: Drive, causes: Causes, path: Path | None) -> Course:
    """A record with the forces and commands of causes; those that are values are in the model."""
    along, out = [with_law_force(course, model)], course
    for name, values in causes.items():
        where = f"{path}: [diagnosis.causes"
        if name not in CAUSES:
            raise BadParameters(f"{where}] there is no {name!r}; there are {', '.join(CAUSES)}")
        if "warming" in values and "temperature" not in course.record.signals:
            raise BadRecord(
                f"{course.record.name}: has no column 'temperature', with which {name} changes"
            )
        try:
            form = CAUSES[name].at(along, model, values)
            sizes = [1.0 if form.sure is not None else values[n] for n in form.amplitudes]
        except KeyError as error:
            raise BadParameters(f"{where}.{name}] has no {error.args[0]!r}") from error
        (out,) = form.added_to([out], np.array(sizes))
    return out


def _required(course: Course, model: Drive) -> Vector:
    """Force of the command less mass times acceleration, shape (n,) [N]."""
    nothing, viscous = np.zeros(len(course.x)), model.linear_friction * course.moved_v
    left = balance(replace(course, added_force=nothing), model, -viscous)
    return at_samples(left[:, 0], len(course.x), course.width)


def _well_within_rest(course: Course) -> Mask:
    """Samples at rest that are not near a motion; the counterpart of `moving`."""
    moves = averaged((~course.rests).astype(float), course.width) > 0.0
    near = maximum_filter1d(moves.astype(float), 2 * AROUND_REST + 1, mode="constant")
    return np.asarray(course.rests & (at_samples(near, len(course.x), course.width) == 0.0))


def _beyond_stiction(course: Course, model: Drive, required: Vector, force: Vector) -> Vector:
    """Required force beyond what friction can hold at rest, shape (n,) [N].

    Friction at rest can hold as much as the law's friction in sliding at a speed just above rest.
    """
    scale = course.per_command / model.linear.per_command  # as in `balance`
    asked = required - scale * (force + model.values.get("offset", 0.0))
    names, steady = compiled(claims(model.law).steady_state)
    sides = ({**model.values, "v": s * float(SLOWEST)} for s in (-1.0, 1.0))
    backwards, forwards = (scale * float(steady(*(v[n] for n in names))) for v in sides)
    return np.asarray(asked - np.clip(asked, backwards, forwards))


# -- intervals -----------------------------------------------------------------------------------


class Blocks:
    """Signals cut into blocks.

    Neighbouring blocks are drawn together, as many as the cube root of the number of blocks,
    because an effect longer than a block is no new evidence. A few blocks scatter less than the
    population, so the interval is widened as in Student's distribution.

    Parameters
    ----------
    ends : sequence of int
        Ends of the blocks among n samples: 0, ..., n.
    """

    def __init__(self, ends: Sequence[int]) -> None:
        self._starts = np.array(ends[:-1])
        blocks = len(self._starts)
        together = max(round(blocks ** (1 / 3)), 1)
        draws = (_DRAWS, -(-blocks // together))
        first = np.random.default_rng(0).integers(0, blocks, draws)
        self._drawn = ((first[:, :, None] + np.arange(together)) % blocks).reshape(_DRAWS, -1)
        independent = blocks / together
        free = max(independent - 1.0, 1.0)
        self._wider = float(stdtrit(free, 0.975) / ndtri(0.975)) * math.sqrt(independent / free)

    def rms(self, values: Vector, counted: Mask | bool = True) -> Estimate:
        """Root mean square of values, shape (n,), over the counted samples."""
        return self._ratio(values**2 * counted, np.ones(len(values)) * counted, math.sqrt)

    def gain(self, before: Vector, after: Vector, counted: Mask | bool = True) -> Estimate:
        """Share by which the mean square falls from `before` to `after`, shape (n,)."""
        return self._ratio(after**2 * counted, before**2 * counted, lambda left: 1.0 - left)

    def _ratio(self, above: Vector, below: Vector, of: Callable[[float], float]) -> Estimate:
        """A monotonic function of the ratio of sums of non-negative values, shape (n,) each."""
        tops, bottoms = (np.add.reduceat(values, self._starts) for values in (above, below))
        top, bottom = float(tops.sum()), float(bottoms.sum())
        if top == 0.0 or bottom == 0.0:
            return Estimate(of(0.0 if bottom else 1.0), None)
        if min(np.count_nonzero(tops), np.count_nonzero(bottoms)) < _FEWEST:
            return Estimate(of(top / bottom), None)
        up, down = (sums[self._drawn].sum(axis=1) for sums in (tops, bottoms))
        kept = (up > 0.0) & (down > 0.0)
        middle = math.log(top / bottom)
        quantiles = np.quantile(np.log(up[kept] / down[kept]), [0.025, 0.975])
        ends = middle + self._wider * (quantiles - middle)
        low, high = sorted(of(math.exp(end)) for end in ends)
        return Estimate(of(top / bottom), (low, high))
