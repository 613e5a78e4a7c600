"""Residuals on held-out blocks of a study."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...solver.arrays import Vector
from .balance import Added
from .blocks import ends_of_seconds
from .causes.cause import Form
from .diagnosis import Level
from .drive import Drive
from .modelled_record import ModelledRecord, shaken
from .predicted import NotPredicted, Predictor
from .residuals import Residual, residual, rms
from .rule import Explained, built, own_amplitudes
from .study import Study

_LAPS = range(3, 7)  # numbers of laps of one motion for which repetition is used
_SAME = 1e-3  # largest difference of laps, as a share of the motion's mean square
_SHORTEST_LAP = 1.0  # s


@dataclass(frozen=True)
class HeldOut:
    """Residuals on held-out data: of the prior model, with fitted values, with the causes built in.

    `positions` are errors of the predicted position of "prior", "none" and "all", and of "noise",
    its change with another reading of the encoder, shape (n,) [m]; NaN if it cannot be predicted.
    """

    parts: str  # what was held out, one at a time
    prior: Residual
    none: Residual
    all: Residual
    positions: dict[str, Vector]
    why: str  # why a position cannot be predicted

    def position(self, name: str) -> float | None:
        """Root mean square error of a predicted position [m]; None if it is not known."""
        error = rms(self.positions[name])
        return error if math.isfinite(error) else None

    def level(self, name: str) -> Level:
        """Residual of one of the models "prior", "none" and "all"."""
        found: Residual = getattr(self, name)
        return Level(found.force_rms, self.position(name))


def held_out(found: Explained) -> HeldOut:
    """Fit without each block in turn, and return the residuals on the held-out blocks."""
    study, forms = found.study, found.forms
    none = left_on_blocks(found, [])
    as_read = [replace(c, calibration=dict.fromkeys(c.calibration, 0.0)) for c in study.courses]
    positions, why = _positions(found, as_read)
    return HeldOut(
        f"{len(study.bands.parts)} parts",
        residual(as_read, study.prior_model, Added.nothing(as_read)),
        none,
        left_on_blocks(found, forms) if forms else none,
        positions,
        why,
    )


def left_on_blocks(found: Explained, forms: Sequence[Form]) -> Residual:
    """Residual of each block with these forms, fitted without the block."""
    study = found.study
    fit = found.catalogue.without(forms)
    starts = np.cumsum([0, *(len(c.x) for c in study.courses)])
    force, between = np.zeros((2, starts[-1]))
    whole = Residual(force, between, np.zeros(starts[-1], dtype=bool))
    for ways, (record, begin, end) in zip(fit.ways, _samples(study), strict=True):
        one = residual(*built(study, forms, ways[0]))
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


def _positions(
    found: Explained, as_read: Sequence[ModelledRecord]
) -> tuple[dict[str, Vector], str]:
    """Errors of predicted positions, see `HeldOut`, and why one cannot be predicted."""
    study, forms, why = found.study, found.forms, ""
    out = dict.fromkeys(
        ("prior", "none", "all", "noise"), np.full(len(_end_to_end(as_read)), np.nan)
    )
    try:
        predictor = Predictor(study.prior_model, {})
        prior = [predictor(c, np.zeros(len(c.x))) for c in as_read]
        out["prior"] = np.concatenate(prior) - _end_to_end(as_read)
        out["none"], out["noise"] = _ahead_on_blocks(found, [])
        out["all"] = out["none"]
        if forms:
            out["all"], out["noise"] = _ahead_on_blocks(found, forms)
    except NotPredicted as error:
        why = str(error)
        if forms:
            out["all"] = out["noise"] = np.full_like(out["all"], np.nan)
    return out, why


def _end_to_end(courses: Sequence[ModelledRecord]) -> Vector:
    return np.concatenate([c.x for c in courses])


def _ahead_on_blocks(found: Explained, forms: Sequence[Form]) -> tuple[Vector, Vector]:
    """Error of the position in each second, and its change with another reading of the encoder.

    A second is predicted without the block in which it begins. States that are not recorded begin
    as in the fit to all blocks.
    """
    study = found.study
    fit = found.catalogue.without(forms)

    def predictor(
        model: Drive, amplitude: Vector, record: int, like: Predictor | None = None
    ) -> Predictor:
        return Predictor(model, _in_plant(study, forms, amplitude, record), like)

    courses, model, added = built(study, forms, fit.amplitude[0])
    whole = [predictor(model, fit.amplitude[0], r) for r in range(len(courses))]
    inner = [p.states(c, u) for p, c, u in zip(whole, courses, added.command, strict=True)]
    random = np.random.default_rng(0)
    again = [shaken(c, random) for c in courses]
    once, twice = ([np.full(len(c.x), np.nan) for c in courses] for _ in range(2))
    for ways, (record, begin, end) in zip(fit.ways, _samples(study), strict=True):
        courses, model, added = built(study, forms, ways[0])
        course, change = courses[record], added.command[record]
        other = replace(course, x=again[record].x, v=again[record].v)
        own = predictor(model, ways[0], record, whole[record])
        seconds = itertools.pairwise(ends_of_seconds([course]))
        some = [(first, last) for first, last in seconds if begin <= first < end]
        for out, read in ((once, course), (twice, other)):
            position = own(read, change, some, inner[record])
            out[record] = np.where(np.isnan(position), out[record], position)
    first = np.concatenate(once)
    return first - _end_to_end(study.courses), np.concatenate(twice) - first


def _in_plant(
    study: Study, forms: Sequence[Form], amplitude: Vector, record: int
) -> dict[str, dict[str, float]]:
    """The causes that are forces, with their values in a record."""
    out = {}
    for form, mine in own_amplitudes(study, forms, amplitude):
        if form.force is None:
            continue
        if form.command is not None:
            raise NotPredicted(f"the recorded position itself is corrected by {form.name}")
        own = dict(form.values)
        for name, size in zip(form.amplitudes, mine.tolist(), strict=True):
            name, _, number = name.partition(".")
            if form.sure is None and number in ("", str(record + 1)):
                own[name] = size
        out[form.name] = own
    return out


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


def laps_of(courses: Sequence[ModelledRecord]) -> list[float]:
    """Period of each record's laps [s]; empty if a record has no laps."""
    laps = [lap(c.x, c.step) for c in courses]
    return laps if all(laps) else []
