"""What is left on held-out blocks of a study, what noise alone leaves, and the verdict."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from ...solver.arrays import Vector
from ...solver.errors import ContractError
from .balance import Residual, noise_of_readings, residual, rms
from .bands import EDGES, Block
from .causes import OUTSIDE
from .causes.cause import Form
from .corrected import NOT_PREDICTED, Causes, Predictor, ends_of_seconds
from .fit import Study
from .model import Drive
from .motion import Course, opposing, shaken
from .rule import Explained, built, own_amplitudes
from .windows import at_samples

Verdict = Literal["none", "explained", "partly", "unexplained", "undecided"]

AT_FLOOR = 2.0  # a residual above this multiple of the noise has more than noise in it
TELLS = 0.2  # share of the friction: records that hide a larger fault decide nothing
MOST = 0.5  # share of the squares that, if it certainly goes, explains in part without a name
_LAPS = range(3, 7)  # numbers of laps of one motion for which repetition is used
_SAME = 1e-3  # largest difference of laps, as a share of the motion's mean square


@dataclass(frozen=True)
class Level:
    """A residual in the two domains, root mean square."""

    force: float  # at frequencies at which the record gives forces [N]
    position: float | None  # of the prediction from the start of each second, if known [m]

    def to_dict(self) -> dict[str, float | None]:
        """Its content in `diagnosis.json`."""
        return {"force_N": self.force, "position_m": self.position}


def holds(gain_interval: tuple[float, float], before: Level, after: Level) -> bool:
    """Whether the corrected model is certainly better on held-out data than the one before.

    The lower end of the removed share of the mean square in force is above zero, and the residual
    in position does not grow.
    """
    better = gain_interval[0] > 0.0
    if before.position is None or after.position is None:
        return better
    return better and after.position <= before.position


class NoiseFloor(NamedTuple):
    """Root mean square residuals due to noise, as in `Residual`."""

    force: float  # [N]
    by_current: float  # [N]
    repeated: bool  # whether it is computed from laps of one motion


@dataclass(frozen=True)
class HeldOut:
    """Residuals on held-out data: of the prior model, with fitted values, with the causes built in.

    `positions` are errors of the predicted position of "prior", "none" and "all", and of "noise",
    its change with another reading of the encoder, shape (n,) [m]; NaN if it cannot be predicted.
    The verdict rests on these.
    """

    found: Explained
    prior: Residual
    none: Residual
    all: Residual
    positions: dict[str, Vector]
    why: str  # why a position cannot be predicted
    floor: NoiseFloor

    def level(self, name: str) -> Level:
        """Residual of "prior", "none", "all" or "noise"."""
        error = rms(self.positions[name])
        force = self.floor.force if name == "noise" else getattr(self, name).force_rms
        return Level(force, error if math.isfinite(error) else None)

    @cached_property
    def friction(self) -> float:
        """Root mean square of the law's force where forces are known [N]."""
        study = self.found.study
        along = np.concatenate([opposing(c, study.model) for c in study.courses])
        return max(rms(along[self.all.telling]), 1e-300)

    @property
    def gain_interval(self) -> tuple[float, float]:
        """That of the share of the squares that the causes remove, 90 %."""
        return self.found.gain([]).interval if self.found.built else (0.0, 0.0)

    @property
    def contradicts(self) -> bool:
        """Whether voltage and current differ by more than noise."""
        return self.all.by_current_rms > AT_FLOOR * self.floor.by_current

    @property
    def unrepeated(self) -> bool:
        """Whether laps of one motion differ by less than what is left."""
        return self.floor.repeated and self.all.force_rms > AT_FLOOR * self.floor.force

    @property
    def something(self) -> bool:
        """Whether more than noise is left."""
        return bool(self.found.sets[-1]) or self.contradicts or self.unrepeated

    @property
    def unseen(self) -> float:
        """Largest fault that these records would not show, as a share of the friction."""
        return max(AT_FLOOR * self.floor.force, self.all.force_rms) / self.friction

    @property
    def better(self) -> bool:
        """Whether the model is better with the causes, see `holds`."""
        return holds(self.gain_interval, self.level("none"), self.level("all"))

    @property
    def settled(self) -> bool:
        """Whether the model is better, and only noise is left."""
        return self.better and not self.something and self.unseen < TELLS

    @property
    def alternatives(self) -> dict[str, tuple[str, ...]]:
        """Suspects that explain as much as a cause built in, if only noise is left with either."""
        return self.found.alternatives if self.settled else {}

    @property
    def verdict(self) -> Verdict:
        """Verdict from what is left, and from whether the causes are certain.

        A cause with one alternative explains the error, too.
        """
        causes, others = self.found.built, sum(self.alternatives.values(), ())
        certain = any(c.certain for c in causes)
        if causes and self.settled:
            if len(others) <= 1 and OUTSIDE not in others:
                return "explained"
            return "partly" if certain else "undecided"
        if certain or self.gain_interval[0] >= MOST:
            return "partly"
        if self.something or (causes and not self.better):
            return "unexplained"
        return "undecided" if self.unseen >= TELLS or self.found.doubtful else "none"


def held_out(found: Explained) -> HeldOut:
    """Fit without each block in turn, and return the residuals on the held-out blocks."""
    study, forms = found.study, found.forms
    none = _left_on_blocks(found, [])
    as_read = [replace(c, calibration=dict.fromkeys(c.calibration, 0.0)) for c in study.courses]
    return HeldOut(
        found,
        residual(as_read, study.prior_model),
        none,
        _left_on_blocks(found, forms) if forms else none,
        *_positions(found, as_read),
        _noise_floor(found),
    )


def _without_each(
    found: Explained, forms: Sequence[Form]
) -> Iterator[tuple[Block, Vector, list[Course], Drive]]:
    """Each block, and a fit of these forms without it: amplitudes, courses and model."""
    ways = found.catalogue.without(forms).ways
    for block, (amplitude,) in zip(found.study.bands.blocks, ways, strict=True):
        yield block, amplitude, *built(found.study, forms, amplitude)


def _left_on_blocks(found: Explained, forms: Sequence[Form]) -> Residual:
    """Residual of each block with these forms, fitted without the block."""
    parts = []
    for block, _, courses, model in _without_each(found, forms):
        one = residual([courses[block.record]], model)
        parts.append([values[block.samples] for values in vars(one).values()])
    return Residual(*map(np.concatenate, zip(*parts, strict=True)))


def _positions(found: Explained, as_read: Sequence[Course]) -> tuple[dict[str, Vector], str]:
    """Errors of predicted positions, see `HeldOut`, and why one cannot be predicted."""
    x = np.concatenate([c.x for c in as_read])
    out = dict.fromkeys(("prior", "none", "all", "noise"), np.full(len(x), np.nan))
    try:
        prior = Predictor(found.study.prior_model, {})
        out["prior"] = np.concatenate([prior(c) for c in as_read]) - x
        out["none"], noise = _ahead_on_blocks(found, [], prior)
        with_causes = _ahead_on_blocks(found, found.forms) if found.forms else (out["none"], noise)
        out["all"], out["noise"] = with_causes
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
    study, (whole,) = found.study, found.catalogue.without(forms).amplitude

    def predictor(model: Drive, amplitude: Vector, record: int) -> Predictor:
        return Predictor(model, _in_plant(study, forms, amplitude, record), like)

    courses, model = built(study, forms, whole)
    like = like or predictor(model, whole, 0)
    inner = [predictor(model, whole, r).states(c) for r, c in enumerate(courses)]
    random = np.random.default_rng(0)
    again = [shaken(c, random) for c in courses]
    once, twice = ([np.full(len(c.x), np.nan) for c in courses] for _ in range(2))
    for block, amplitude, courses, model in _without_each(found, forms):
        r, samples = block.record, block.samples
        own = predictor(model, amplitude, r)
        seconds = itertools.pairwise(ends_of_seconds([courses[r]]))
        some = [(first, last) for first, last in seconds if samples.start <= first < samples.stop]
        other = replace(courses[r], x=again[r].x, v=again[r].v)
        for out, read in ((once, courses[r]), (twice, other)):
            position = own(read, some, inner[r])
            out[r] = np.where(np.isnan(position), out[r], position)
    first = np.concatenate(once)
    return first - np.concatenate([c.x for c in study.courses]), np.concatenate(twice) - first


def _in_plant(study: Study, forms: Sequence[Form], amplitude: Vector, record: int) -> Causes:
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


# -- the noise -----------------------------------------------------------------------------------


def _noise_floor(found: Explained) -> NoiseFloor:
    """Differences between laps of one motion, or the white part of the residual without laps.

    The floor is at least the noise of readings. The error of the law due to the error of the motion
    is added. The residual is that of the model with all causes.
    """
    study, courses = found.study, found.study.courses
    left = residual(*found.corrected)
    read = noise_of_readings(courses, study.model)
    along = [at_samples(c.force_variance, len(c.x), c.width) for c in courses]
    law = rms(np.sqrt(np.concatenate(along)[left.telling]))
    # of each balance, if all bands had the noise of the quietest one
    levels = np.sqrt(found.variance)
    channel = np.flatnonzero(study.bands.used) // (len(EDGES) - 1)
    white = [float(levels[channel == c].min()) for c in np.unique(channel)]
    laps = [lap(c.x, c.step) for c in courses]
    # slower noise is not included, because faults are slow too
    quiet = min(white[0], left.force_rms)  # white noise beyond the used bands would be left, too
    own = math.hypot(_repetition(left, courses, laps), study.exact) if all(laps) else quiet
    own = max(own, read.force_rms)  # rounding may be the same in every lap
    between = max([study.exact, read.by_current_rms, *white[1:]])
    return NoiseFloor(math.hypot(own, law), between, all(laps))


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
    shortest = -(-n // (_LAPS[-1] + 1))
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
