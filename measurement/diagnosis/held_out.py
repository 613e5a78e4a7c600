"""Residuals on held-out blocks of a study, what noise alone leaves, and whether more is left."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...solver.arrays import Vector
from ...solver.errors import ContractError
from .balance import Residual, noise_of_readings, residual, rms
from .bands import EDGES
from .causes.cause import Form
from .corrected import NOT_PREDICTED, Predictor, ends_of_seconds
from .diagnosis import Level
from .fit import Study
from .model import Drive
from .motion import Course, shaken
from .rule import NOISE, Explained, built, own_amplitudes
from .windows import at_samples

AT_FLOOR = 2.0  # a residual above this multiple of the noise has more than noise in it
TELLS = 0.2  # share of the friction: records that hide a larger fault decide nothing
_LAPS = range(3, 7)  # numbers of laps of one motion for which repetition is used
_SAME = 1e-3  # largest difference of laps, as a share of the motion's mean square
_SHORTEST_LAP = 1.0  # s


@dataclass(frozen=True)
class HeldOut:
    """Residuals on held-out data: of the prior model, with fitted values, with the causes built in.

    `positions` are errors of the predicted position of "prior", "none" and "all", and of "noise",
    its change with another reading of the encoder, shape (n,) [m]; NaN if it cannot be predicted.
    """

    prior: Residual
    none: Residual
    all: Residual
    positions: dict[str, Vector]
    why: str  # why a position cannot be predicted

    def level(self, name: str, force: float | None = None) -> Level:
        """Residual of "prior", "none" or "all"; or of "noise", with its `force` [N]."""
        error = rms(self.positions[name])
        force = getattr(self, name).force_rms if force is None else force
        return Level(force, error if math.isfinite(error) else None)


def held_out(found: Explained) -> HeldOut:
    """Fit without each block in turn, and return the residuals on the held-out blocks."""
    study, forms = found.study, found.forms
    none = _left_on_blocks(found, [])
    as_read = [replace(c, calibration=dict.fromkeys(c.calibration, 0.0)) for c in study.courses]
    return HeldOut(
        residual(as_read, study.prior_model),
        none,
        _left_on_blocks(found, forms) if forms else none,
        *_positions(found, as_read),
    )


def _left_on_blocks(found: Explained, forms: Sequence[Form]) -> Residual:
    """Residual of each block with these forms, fitted without the block."""
    study = found.study
    starts = np.cumsum([0, *(len(c.x) for c in study.courses)])
    force, between = np.zeros((2, starts[-1]))
    whole = Residual(force, between, np.zeros(starts[-1], dtype=bool))
    ways = found.catalogue.without(forms).ways
    for way, (record, begin, end) in zip(ways, _samples(study), strict=True):
        one = residual(*built(study, forms, way[0]))
        test = slice(starts[record] + begin, starts[record] + end)
        for name, values in vars(whole).items():
            values[test] = getattr(one, name)[test]
    return whole


def _samples(study: Study) -> list[tuple[int, int, int]]:
    """Record, and range of samples, of each block."""
    out = []
    for record, first, last in study.bands.parts:
        course = study.courses[record]
        # a record's last windows end before its last samples
        ends = max(p[2] for p in study.bands.parts if p[0] == record)
        end = last * course.width if last < ends else len(course.x)
        out.append((record, first * course.width, end))
    return out


def _positions(found: Explained, as_read: Sequence[Course]) -> tuple[dict[str, Vector], str]:
    """Errors of predicted positions, see `HeldOut`, and why one cannot be predicted."""
    x = np.concatenate([c.x for c in as_read])
    unknown = np.full(len(x), np.nan)
    out = dict.fromkeys(("prior", "none", "all", "noise"), unknown)
    try:
        prior = Predictor(found.study.prior_model, {})
        out["prior"] = np.concatenate([prior(c, np.zeros(len(c.x))) for c in as_read]) - x
        out["none"], noise = _ahead_on_blocks(found, [], prior)
        out["all"], out["noise"] = (
            _ahead_on_blocks(found, found.forms) if found.forms else (out["none"], noise)
        )
    except NOT_PREDICTED as error:
        return out, str(error)
    return out, ""


def _ahead_on_blocks(
    found: Explained, forms: Sequence[Form], like: Predictor | None = None
) -> tuple[Vector, Vector]:
    """Error of the position in each second, and its change with another reading of the encoder.

    A second is predicted without the block in which it begins. States that are not recorded begin
    as in the fit to all blocks. `like` has the same equations.
    """
    study = found.study
    fit = found.catalogue.without(forms)

    def predictor(model: Drive, amplitude: Vector, record: int) -> Predictor:
        return Predictor(model, _in_plant(study, forms, amplitude, record), like)

    courses, model, added = built(study, forms, fit.amplitude[0])
    like = like or predictor(model, fit.amplitude[0], 0)
    inner = [
        predictor(model, fit.amplitude[0], r).states(c, u)
        for r, (c, u) in enumerate(zip(courses, added.command, strict=True))
    ]
    random = np.random.default_rng(0)
    again = [shaken(c, random) for c in courses]
    once, twice = ([np.full(len(c.x), np.nan) for c in courses] for _ in range(2))
    for ways, (record, begin, end) in zip(fit.ways, _samples(study), strict=True):
        courses, model, added = built(study, forms, ways[0])
        course, change = courses[record], added.command[record]
        other = replace(course, x=again[record].x, v=again[record].v)
        own = predictor(model, ways[0], record)
        seconds = itertools.pairwise(ends_of_seconds([course]))
        some = [(first, last) for first, last in seconds if begin <= first < end]
        for out, read in ((once, course), (twice, other)):
            position = own(read, change, some, inner[record])
            out[record] = np.where(np.isnan(position), out[record], position)
    first = np.concatenate(once)
    return first - np.concatenate([c.x for c in study.courses]), np.concatenate(twice) - first


def _in_plant(
    study: Study, forms: Sequence[Form], amplitude: Vector, record: int
) -> dict[str, dict[str, float]]:
    """The causes that are forces, with their values in a record."""
    out = {}
    for form, mine in own_amplitudes(study, forms, amplitude):
        if form.force is None:
            continue
        if form.command is not None:
            raise ContractError(f"the recorded position itself is corrected by {form.name}")
        own = dict(form.values)
        for name, size in zip(form.amplitudes, mine.tolist(), strict=True):
            name, _, number = name.partition(".")
            if form.sure is None and number in ("", str(record + 1)):
                own[name] = size
        out[form.name] = own
    return out


# -- the noise, and whether more is left -------------------------------------------------------


class NoiseFloor(NamedTuple):
    """Root mean square residuals due to noise, as in `Residual`."""

    force: float  # [N]
    by_current: float  # [N]
    repeated: bool  # whether it is computed from laps of one motion


def noise_floor(found: Explained, left: Residual) -> NoiseFloor:
    """Differences between laps of one motion, or the white part of the residual without laps.

    The floor is at least the noise of readings. The error of the law due to the error of the motion
    is added. `left` is the residual of the model with all causes.
    """
    study = found.study
    courses = study.courses
    read = noise_of_readings(courses, study.model)
    along = [at_samples(c.force_variance, len(c.x), c.width) for c in courses]
    known = np.concatenate(along)[left.telling]
    law = math.sqrt(float(known.mean())) if len(known) else 0.0
    # of each balance, if all bands had the noise of the quietest one
    levels = np.sqrt(found.variance)
    channel = np.flatnonzero(study.bands.used) // (len(EDGES) - 1)
    white = [float(levels[channel == c].min()) for c in np.unique(channel)]
    laps = [lap(c.x, c.step) for c in courses]
    # slower noise is not included, because faults are slow too
    own = math.hypot(_repetition(left, courses, laps), study.exact) if all(laps) else white[0]
    forces = max(own, read.force_rms)  # rounding may be the same in every lap
    between = max([study.exact, read.by_current_rms, *white[1:]])
    return NoiseFloor(math.hypot(forces, law), between, all(laps))


def _repetition(found: Residual, courses: Sequence[Course], laps: Sequence[float]) -> float:
    """Root mean square of the part of the residual that does not repeat from lap to lap [N].

    Each lap contributes half of the mean square of the difference.
    """
    squares, at = [], 0
    for c, length in zip(courses, laps, strict=True):
        n, later = len(c.x), round(length / c.step)
        force, keep = found.force[at : at + n], found.telling[at : at + n]
        both = keep[later:] & keep[:-later]
        squares.append(0.5 * (force[later:] - force[:-later])[both] ** 2)
        at += n
    return rms(np.sqrt(np.concatenate(squares)))


def lap(x: Vector, step: float) -> float:
    """Period of a repeated motion, of positions `step` apart [s]; zero without enough laps."""
    n = len(x)
    longest = n // _LAPS[0]
    shortest = max(round(_SHORTEST_LAP / step), -(-n // (_LAPS[-1] + 1)))
    if longest <= shortest:
        return 0.0
    moved = x - x.mean()
    spectrum = np.fft.rfft(moved, 2 * n)
    shared = np.fft.irfft(np.abs(spectrum) ** 2)[: longest + 1]  # sum of x(t) x(t + lag)
    squares = np.concatenate([[0.0], np.cumsum(moved**2)])
    lags = np.arange(shortest, longest + 1)
    both = squares[n - lags] + squares[n] - squares[lags]
    apart = np.divide(both - 2.0 * shared[lags], both, out=np.ones(len(lags)), where=both > 0.0)
    best = int(np.argmin(apart))
    return float(lags[best] * step) if apart[best] < _SAME else 0.0


class Remainder(NamedTuple):
    """What is left on held-out data; all verdicts rest on it.

    More than noise is left if a hypothesis is found, voltage and current contradict each other, or
    laps of one motion differ by less.
    """

    something: bool
    contradicts: bool  # voltage and current differ by more than noise
    unrepeated: bool  # laps of one motion differ by less than what is left
    unseen: float  # largest fault that these records would not show, as a share of the friction
    doubtful: bool  # a score is between noise and what is found, and nothing is built in

    @property
    def hidden(self) -> bool:
        return self.unseen >= TELLS


def remainder(found: Explained, left: Residual, lowest: NoiseFloor, friction: float) -> Remainder:
    """Judge the residual `left` on held-out data, with the causes found in the model."""
    contradicts = left.by_current_rms > AT_FLOOR * lowest.by_current
    unrepeated = lowest.repeated and left.force_rms > AT_FLOOR * lowest.force
    something = bool(found.sets[-1]) or contradicts or unrepeated
    doubtful = found.best is not None and found.best.score > NOISE and not found.built
    unseen = max(AT_FLOOR * lowest.force, left.force_rms) / friction
    return Remainder(something, contradicts, unrepeated, unseen, doubtful)
