"""Records beside a model: values fitted within their tolerances, and blocks held out.

Values, amplitudes and the noise of each band are fitted to all blocks but one, and the logarithm of
the likelihood of that one is summed over the blocks (cross-validated predictive likelihood;
S. Geisser and W. Eddy, JASA 74, 1979).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..records.bad_record import BadRecord
from ..records.record import Record
from .balance import EXACT, Added, calibrated, leftovers, recalibrated, sensitivities
from .bands import Bands, cut, products
from .drive_model import DriveModel
from .modelled_record import (
    ModelledRecord,
    driven_by_current,
    lay_along,
    with_law_force,
    with_own_offsets,
)
from .residuals import at_samples, check_motion

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Array = npt.NDArray[np.float64]

FREEDOM = 4.0
"""Degrees of freedom of Student's distribution, as is usual where noise has outliers."""

_WEIGHINGS = 6  # of bands by what is left in them
_WEIGHINGS_MORE = 4  # without one of the blocks
_FLAT = 1e-9  # of a column's own square: an amplitude may be anything
_PINNINGS = 8  # rounds of the active set
_NEARLY = 0.999
_PINNED = 1e14  # precision of a value that stays where it is


@dataclass(frozen=True)
class Study:
    """Records laid along a model, and how they are cut.

    Attributes
    ----------
    model : DriveModel
        Around whose values everything is linear.
    prior_model : DriveModel
    bands : Bands
    """

    courses: list[ModelledRecord]
    model: DriveModel
    prior_model: DriveModel
    bands: Bands

    @property
    def values(self) -> tuple[str, ...]:
        """Names of the columns of values and calibrations."""
        return (*self.model.adjustable, *calibrated(self.courses))

    def prior(self) -> tuple[Vector, Vector]:
        """Mean and spread of the change of each of `values`."""
        names = self.model.adjustable
        ratio = [self.prior_model.values[n] / self.model.values[n] - 1.0 for n in names]
        known = calibrated(self.courses)
        mean = np.array([*ratio, *(-self.courses[0].calibration[n] for n in known)])
        spread = [self.prior_model.tolerance[n] / math.sqrt(3.0) for n in names]
        return mean, np.array([*spread, *(p.spread for p in known.values())])

    def most(self, spread: Vector) -> Vector:
        """By how much each of `values` can change: tolerances, and what instruments can have."""
        known = calibrated(self.courses).values()
        ends = [max(-p.low, p.high) for p in known]
        values = math.sqrt(3.0) * spread[: len(spread) - len(ends)]
        return np.append(values, ends)

    def at_ends(self, amplitude: Vector) -> list[str]:
        """Those of `values` that a fit leaves at the end of what they can be."""
        mean, spread = self.prior()
        off = np.abs(amplitude[: len(mean)] - mean)
        return [
            n for n, at in zip(self.values, off > _NEARLY * self.most(spread), strict=True) if at
        ]


@dataclass(frozen=True)
class Fit:
    """Forms fitted side by side, N of them.

    Attributes
    ----------
    held : ndarray, shape (N, blocks)
        Logarithm of the likelihood of each block that was held out.
    squares : ndarray, shape (N, blocks, channels * bands)
        Of what is left of it [N^2].
    amplitude, error : ndarray, shape (N, columns)
        From all blocks; the standard error from leaving one out (jackknife).
    ways : ndarray, shape (blocks, N, columns)
        Amplitudes from all blocks but one.
    cost : ndarray, shape (N,)
        Of values that are not the prior ones: minus the logarithm of their prior's density.
    """

    held: Matrix
    squares: Array
    amplitude: Matrix
    error: Matrix
    ways: Array
    cost: Vector

    def one(self, k: int) -> Fit:
        """The fit of one of the forms."""
        some = slice(k, k + 1)
        return Fit(
            self.held[some],
            self.squares[some],
            self.amplitude[some],
            self.error[some],
            self.ways[:, some],
            self.cost[some],
        )


class Priors(NamedTuple):
    """Of columns, shape (N, columns): mean, one over the variance, and what no change exceeds."""

    mean: Matrix
    precision: Matrix
    most: Matrix


def fitted(products: Array, bands: Bands, prior: Priors, exact: float) -> Fit:
    """Fit and hold out.

    Parameters
    ----------
    products : ndarray, shape (blocks, used bands, N, 1 + columns, 1 + columns)
        Of columns, the signal first.
    prior : Priors
    exact : float
        Noise that is always there [N].
    """
    counts = bands.counts[:, bands.used]
    blocks = np.arange(len(products))
    whole = products.sum(axis=0)
    start = (whole[:, :, 0, 0] / counts.sum(axis=0)[:, None]).T + exact**2
    amplitude, variance = _with_noise(products, counts, prior, exact, start, _WEIGHINGS)
    held, squares, ways = [], [], []
    for q in blocks:
        rest = blocks != q
        found, of_rest = _with_noise(
            products[rest], counts[rest], prior, exact, variance, _WEIGHINGS_MORE
        )
        ways.append(found)
        left = _left(products[q : q + 1], found)[0]
        each = 0.5 * counts[q] * np.log(of_rest)
        each += 0.5 * (FREEDOM + counts[q]) * np.log1p(left / (FREEDOM * of_rest))
        held.append(-each.sum(axis=1))
        squares.append(left)
    each = np.array(ways)
    count = len(blocks)
    error = np.sqrt((count - 1) / count * np.sum((each - each.mean(axis=0)) ** 2, axis=0))
    cost = 0.5 * np.sum(prior.precision * (amplitude - prior.mean) ** 2, axis=1)
    return Fit(np.array(held).T, np.array(squares).transpose(1, 0, 2), amplitude, error, each, cost)


def _with_noise(
    products: Array,
    counts: Matrix,
    prior: Priors,
    exact: float,
    variance: Matrix,
    times: int,
) -> tuple[Matrix, Matrix]:
    """Amplitudes (N, columns) and variances of the bands (N, channels * bands), in turn.

    Noise is not the same all over a record: a block's variance is one of many around the band's
    (Student's distribution; K. Lange, R. Little and J. Taylor, JASA 84, 1989).
    """
    left = products[:, :, :, 0, 0].transpose(0, 2, 1)
    each = counts[:, None, :]
    for _ in range(times):
        weight = (FREEDOM + each) / (FREEDOM + left / variance)
        inner = np.einsum("qbnij,qnb->nij", products, weight / variance)
        amplitude = _within_most(inner, prior)
        left = _left(products, amplitude)
        weight = (FREEDOM + each) / (FREEDOM + left / variance)
        variance = np.sum(weight * left, axis=0) / counts.sum(axis=0) + exact**2
    return amplitude, variance


def _within_most(inner: Array, prior: Priors) -> Matrix:
    """Amplitudes of least squares that stay within their tolerances, by an active set.

    A value that would leave its tolerance is put to its end, and let go where it would turn back
    (P. Gill, W. Murray and M. Wright, "Practical Optimization", 1981, ch. 5).
    """
    mean, precision, most = prior
    matrix = inner[:, 1:, 1:].copy()
    at = np.arange(mean.shape[1])
    matrix[:, at, at] += precision + _FLAT * (matrix[:, at, at] + 1e-30)
    goal = inner[:, 1:, 0] + precision * mean
    side = np.zeros(mean.shape)
    for _ in range(_PINNINGS):
        pinned = side != 0.0
        ends = mean + np.where(pinned, side * np.where(np.isfinite(most), most, 0.0), 0.0)
        held = matrix.copy()
        held[:, at, at] += np.where(pinned, _PINNED, 0.0)
        asked = goal + np.where(pinned, _PINNED * ends, 0.0)
        amplitude = np.linalg.solve(held, asked[:, :, None])[:, :, 0]
        slope = np.matmul(matrix, np.where(pinned, ends, amplitude)[:, :, None])[:, :, 0] - goal
        turns = pinned & (side * slope > 0.0)
        leaves = ~pinned & (np.abs(amplitude - mean) > 1.001 * most)
        if not (turns.any() or leaves.any()):
            break
        side = np.where(turns, 0.0, np.where(leaves, np.sign(amplitude - mean), side))
    return np.asarray(np.clip(amplitude - mean, -most, most) + mean)


def _left(products: Array, amplitude: Matrix) -> Array:
    """Squares of what amplitudes leave, shape (blocks, N, channels * bands)."""
    signed = np.concatenate([np.ones((len(amplitude), 1)), -amplitude], axis=1)[:, :, None]
    half = np.matmul(products, signed)
    return np.asarray(np.maximum(np.sum(half * signed, axis=(3, 4)), 0.0).transpose(0, 2, 1))


def study_of(records: Sequence[Record], prior_model: DriveModel) -> Study:
    """Records laid along the model, with its values adjusted within their tolerances.

    The motor's force is taken from the current or from the voltage, whichever leaves less.

    Raises
    ------
    BadRecord
        If records show next to no motion.
    """
    courses = with_own_offsets([lay_along(r, prior_model) for r in records], prior_model)
    check_motion(courses, prior_model)
    studies = [_adjusted(courses, prior_model)]
    if all(c.has_current for c in courses):
        studies.append(_adjusted([driven_by_current(c) for c in courses], prior_model))
    likely = [float(s[1].held.sum()) for s in studies]
    return studies[int(np.argmax(likely))][0]


def _adjusted(courses: list[ModelledRecord], prior_model: DriveModel) -> tuple[Study, Fit]:
    bands = cut(courses, prior_model)
    if not bands.used.any() or bands.counts[:, bands.used].sum() < 30.0:
        names = ", ".join(c.record.name for c in courses)
        raise BadRecord(f"{names}: next to no motion is shown: x rests, jumps or is noise")
    study = Study(courses, prior_model, prior_model, bands)
    for _ in range(2):  # Gauss-Newton
        study, fit = _moved(study)
    return study, fit


def base_fit(study: Study, columns: Sequence[Matrix]) -> Fit:
    """The model's own values alone; `columns` are those of `base_columns`."""
    mean, spread = study.prior()
    lines = study.bands.lines(columns)
    own = products(lines, lines)[:, study.bands.used][:, :, None]
    exact = EXACT * study.prior_model.friction_scale
    prior = Priors(mean[None], spread[None] ** -2.0, study.most(spread)[None])
    return fitted(own, study.bands, prior, exact)


def base_columns(study: Study) -> list[Matrix]:
    """The signal and the columns of values, (windows, channels, 1 + columns) of each record."""
    nothing = Added.nothing(study.courses)
    left = leftovers(study.courses, study.model, nothing)
    columns = sensitivities(study.courses, study.model, nothing)
    return [np.concatenate([y[:, :, None], s], axis=2) for y, s in zip(left, columns, strict=True)]


def _within(tolerance: float, change: float) -> float:
    """A change that is no larger than the tolerance: shapes are taken around values that can be."""
    return min(max(change, -tolerance), tolerance)


def _moved(study: Study) -> tuple[Study, Fit]:
    """The study around values that fit better, and the fit."""
    columns = base_columns(study)
    fit = base_fit(study, columns)
    change = dict(zip(study.values, fit.amplitude[0].tolist(), strict=True))
    names, prior = study.model.adjustable, study.prior_model
    fitted_values = {n: study.model.values[n] * (1.0 + change[n]) for n in names}
    off = {
        n: _within(prior.tolerance[n], v / prior.values[n] - 1.0) for n, v in fitted_values.items()
    }
    model = study.model.changed({n: prior.values[n] * (1.0 + off[n]) for n in names})
    moved = recalibrated(study.courses, {n: c for n, c in change.items() if n not in names})
    courses = [with_law_force(c, model) for c in moved]
    left = leftovers(courses, model, Added.nothing(courses))
    courses = [
        replace(c, unknown=at_samples(c, y[:, 0])) for c, y in zip(courses, left, strict=True)
    ]
    return replace(study, courses=courses, model=model), fit
