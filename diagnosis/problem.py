"""What is compared in a diagnosis, linear in its amplitudes: candidates, noise, priors."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .balance import Added, calibrated
from .causes import CAUSES
from .causes.cause import Shape
from .drive_model import DriveModel
from .evidence import Columns, Prior, conditioned, fit
from .modelled_record import ModelledRecord
from .nonparametric import nonparametric_alternatives
from .regression import (
    Noise,
    edges,
    filters,
    fitted_noise,
    leftovers,
    responses,
    sensitivities,
    whitened,
)

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

BESIDE = 0.02  # of the largest name's evidence, that a further one has to bring
KEPT = 4  # sets of each size that are grown
LOOKED_AT = 40  # sets of each size that are looked at closely
_BESIDE_NOISE = 3  # causes that noise is sought beside
FREE_RANGE = (0.3, 3.0)  # of a value that may be wrong, to the prior one
_ANY = 1.0  # relative spread of values that take all they can, where noise is sought
_MUCH = 0.1  # of what is left, that one more cause has to explain there


@dataclass(frozen=True)
class Candidate:
    """A shape of a cause, or of a rival, as columns of the problem."""

    name: str
    shape: Shape
    columns: npt.NDArray[np.int64]
    is_rival: bool = False


@dataclass(frozen=True)
class Problem:
    """Everything that is compared, linear in its amplitudes.

    Attributes
    ----------
    columns : Columns
        The signal (column 0), the adjustable values (next), the calibrations and the candidates.
    model : DriveModel
        Around which it is linear.
    names : tuple of str
        Adjustable values.
    prior : Prior
        Of their relative changes from those of `model`, and of the calibrations.
    low, high : ndarray
        How far these may change: tolerances are hard.
    free : ndarray
        Spreads of values that may be anything.
    candidates : list of Candidate
    prior_model : DriveModel
    noise : Noise
        That makes the columns white.
    """

    columns: Columns
    model: DriveModel
    names: tuple[str, ...]
    prior: Prior
    low: Vector
    high: Vector
    free: Vector
    candidates: list[Candidate]
    prior_model: DriveModel
    noise: Noise


def state_problem(
    courses: Sequence[ModelledRecord],
    model: DriveModel,
    prior_model: DriveModel,
    noise: Noise,
    found: Sequence[Candidate] | None = None,
) -> Problem:
    """The problem around a model's values, whose prior is that of `prior_model`.

    What was `found` before is tried again with the values it had, beside the points of the grids.
    Where nothing is known of that, noise is sought beside all that the candidates can explain.
    """
    names = model.adjustable
    nothing = Added.nothing(courses)
    left = leftovers(courses, model, nothing)
    parts = [[y[:, :, None] for y in left], sensitivities(courses, model, nothing)]
    asked = [
        (cause, values)
        for cause in CAUSES.values()
        if not cause.beyond(courses, model)
        for values in cause.grid(courses, model)
    ]
    before = [(CAUSES[c.name], c.shape.values) for c in found or () if not c.shape.freed]
    asked += [one for one in before if one not in asked]
    shapes = [cause.at(courses, model, values) for cause, values in asked]
    named = [
        (cause.name, s, False)
        for (cause, _), s in zip(asked, shapes, strict=True)
        if set(s.freed) <= set(names)  # a value that is certain is no cause
    ]
    named += [
        (r.name, shape, True)
        for r in nonparametric_alternatives(courses, model)
        for shape in r.shapes
    ]
    shown = [None if s.freed else responses(courses, model, s) for _, s, _ in named]
    candidates = []
    at = 1 + len(names) + len(calibrated(courses))
    for (name, shape, is_rival), part in zip(named, shown, strict=True):
        if part is None:
            columns_of = [1 + names.index(n) for n in shape.freed]
            candidates.append(Candidate(name, shape, np.array(columns_of)))
            continue
        count = len(shape.amplitudes)
        parts.append(part)
        candidates.append(Candidate(name, shape, np.arange(at, at + count), is_rival))
        at += count
    prior = _prior(courses, model, prior_model)
    if found is None:
        own = [c for c in candidates if not (c.is_rival or c.shape.freed)]
        last = max((int(c.columns[-1]) for c in own), default=len(prior.mean))
        count = int(np.searchsorted(np.cumsum([p[0].shape[2] for p in parts]), last + 1)) + 1
        noise = _least_noise(courses, model, noise, parts[:count], prior, own)
    made = filters(courses, noise)
    blocks = tuple(whitened(made, part) for part in parts)
    return Problem(
        Columns(blocks, tuple(edges(courses))),
        model,
        names,
        prior,
        *bounds(prior_model, model, (), courses),
        free_spreads(model),
        candidates,
        prior_model,
        noise,
    )


def driven_by(noise: Noise) -> Noise:
    """What drives a noise alone, as if nothing were predicted."""
    return replace(noise, weights=np.zeros_like(noise.weights))


def values_alone(
    problem: Problem, courses: Sequence[ModelledRecord], model: DriveModel, noise: Noise
) -> Problem:
    """The problem of a model's own values, without candidates, around other values of it."""
    nothing = Added.nothing(courses)
    left = [y[:, :, None] for y in leftovers(courses, model, nothing)]
    made = filters(courses, noise)
    parts = [left, sensitivities(courses, model, nothing)]
    low, high = bounds(problem.prior_model, model, (), courses)
    return replace(
        problem,
        columns=Columns(tuple(whitened(made, part) for part in parts), tuple(edges(courses))),
        model=model,
        prior=_prior(courses, model, problem.prior_model),
        low=low,
        high=high,
        candidates=[],
        noise=noise,
    )


def _prior(courses: Sequence[ModelledRecord], model: DriveModel, prior_model: DriveModel) -> Prior:
    """Of relative changes of values, and of calibrations, around a model."""
    mean = prior_changes(prior_model, model, courses)
    spread = np.array([prior_model.tolerance[n] for n in model.adjustable]) / math.sqrt(3.0)
    spread = np.append(spread, [d.spread for d in calibrated(courses).values()])
    return Prior(np.arange(1, len(mean) + 1), mean, spread)


def _least_noise(
    courses: Sequence[ModelledRecord],
    model: DriveModel,
    noise: Noise,
    parts: Sequence[Sequence[Matrix]],
    prior: Prior,
    causes: Sequence[Candidate],
) -> Noise:
    """The noise beside all that free values and a few causes, taken greedily, can explain.

    An autoregression fitted to an effect predicts it and hides it, a periodic one most of all.

    Parameters
    ----------
    parts : sequence of list of ndarray, shape (windows, channels, m)
        What is left of each record's balances, first; then the columns, in their order.
    causes : sequence of Candidate
        Those with columns of their own.
    """
    plain = filters(courses, driven_by(noise))
    columns = np.column_stack([whitened(plain, part) for part in parts])
    products = columns.T @ columns
    values = len(model.adjustable)
    spread = prior.spread.copy()
    spread[:values] = np.maximum(spread[:values], _ANY)
    taken = [replace(prior, spread=spread)]
    for _ in range(_BESIDE_NOISE):
        left = conditioned(products, taken)
        explained = [_explained(*left.of(c.columns)) for c in causes]
        best = int(np.argmax(explained))
        if explained[best] < _MUCH * left.squares:
            break
        chosen = causes[best].columns
        size = np.sqrt(left.squares / np.maximum(np.diag(left.of(chosen)[0]), 1e-300))
        taken.append(Prior(chosen, np.zeros(len(chosen)), 10.0 * size))
    fitted = fit(products, taken)
    amplitude = np.zeros(columns.shape[1])
    amplitude[0] = -1.0
    amplitude[fitted.columns] = fitted.amplitude
    ends = np.cumsum([p[0].shape[2] for p in parts])
    sizes = np.split(amplitude, ends[:-1])
    rest = [
        -np.sum([part[r] @ size for part, size in zip(parts, sizes, strict=True)], axis=0)
        for r in range(len(courses))
    ]
    return fitted_noise(courses, model, rest)


def _explained(inner: Matrix, signal: Vector) -> float:
    """Squares of the signal that columns take away by least squares, see `Conditioned.of`."""
    ridge = (1e-9 * np.trace(inner) + 1e-300) * np.eye(len(signal))
    return float(signal @ np.linalg.solve(inner + ridge, signal))


def prior_changes(
    prior_model: DriveModel, model: DriveModel, courses: Sequence[ModelledRecord]
) -> Vector:
    """Changes that lead from a model and a calibration back to the prior model."""
    values = [prior_model.values[n] / model.values[n] - 1.0 for n in model.adjustable]
    return np.array([*values, *(-courses[0].calibration[n] for n in calibrated(courses))])


def bounds(
    prior_model: DriveModel,
    model: DriveModel,
    freed: Collection[str],
    courses: Sequence[ModelledRecord],
) -> tuple[Vector, Vector]:
    """How far values and calibrations may still change: to the ends of their prior.

    Tolerances are hard, and a freed value has a range, too.
    """
    low, high = [], []
    for n in model.adjustable:
        tolerance = prior_model.tolerance[n]
        ends = (1.0 - tolerance, 1.0 + tolerance)
        if n in freed:
            ends = free_range(n)
        ratio = prior_model.values[n] / model.values[n]
        low.append(ends[0] * ratio - 1.0)
        high.append(ends[1] * ratio - 1.0)
    for n, prior in calibrated(courses).items():
        now = courses[0].calibration[n]
        low.append(prior.low - now)
        high.append(prior.high - now)
    return np.array(low), np.array(high)


def free_range(name: str) -> tuple[float, float]:
    """Of a value that may be wrong, to the prior one; a mass may be anything."""
    return (0.1, math.inf) if name == "m" else FREE_RANGE


def free_spreads(model: DriveModel) -> Vector:
    """Relative spread of each adjustable value when it may be anything."""
    return np.array([model.free_spread(n) for n in model.adjustable])
