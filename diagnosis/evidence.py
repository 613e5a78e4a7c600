"""Weighing explanations of one signal in white noise: linear models, by their evidence.

An explanation is a group of columns whose amplitudes have a normal prior: a known mean and spread,
or mean zero and the spread under which the data are most likely. Everything needed of the data are
the products of columns over stretches of the record, so that a comparison on some stretches, or on
all but some, costs no more than one on all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dpotrs
from scipy.optimize import lsq_linear

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_LEAST = 0.1  # of the largest norm, by which amplitudes are measured
_SIZES = 2.0 ** np.arange(1.0, 9.0)  # of a group's part in the signal, in standard deviations


@dataclass(frozen=True)
class Columns:
    """The signal, column 0, and all others, with their products over stretches of the record.

    Attributes
    ----------
    blocks : tuple of ndarray, shape (n, columns of the block)
    edges : tuple of int
        Ends of the stretches.
    """

    blocks: tuple[Matrix, ...]
    edges: tuple[int, ...]

    @cached_property
    def begins(self) -> npt.NDArray[np.int64]:
        """First column of each block, and behind the last the number of all."""
        return np.cumsum([0, *(b.shape[1] for b in self.blocks)])

    @property
    def stretches(self) -> int:
        return len(self.edges) - 1

    @property
    def count(self) -> int:
        return int(self.begins[-1])

    @cached_property
    def _whole(self) -> Matrix:
        return _products(self.blocks, self.blocks)

    def products(self) -> Matrix:
        """Products of all over all stretches, shape (count, count); not to be changed."""
        return self._whole

    def of(self, columns: npt.NDArray[np.int64]) -> Matrix:
        """Some of them, side by side, shape (n, columns)."""
        block = np.searchsorted(self.begins, columns, side="right") - 1
        parts = [self.blocks[b][:, c - self.begins[b]] for b, c in zip(block, columns, strict=True)]
        return np.column_stack(parts)

    def by_stretch(self, columns: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Products of some of them over each stretch, shape (stretches, columns, columns)."""
        some = self.of(columns)
        return np.array([some[a:b].T @ some[a:b] for a, b in pairwise(self.edges)])

    def exchanged(self, first: int, block: Matrix) -> Columns:
        """With another block at the column where one begins."""
        at = int(np.searchsorted(self.begins, first))
        other = Columns((*self.blocks[:at], block, *self.blocks[at + 1 :]), self.edges)
        here = slice(first, first + block.shape[1])
        whole = self.products().copy()
        whole[here] = _products((block,), other.blocks)
        whole[:, here] = whole[here].T
        other.__dict__["_whole"] = whole  # the rest is as it was
        return other


def _products(left: Sequence[Matrix], right: Sequence[Matrix]) -> Matrix:
    """Products of columns in blocks with columns in blocks."""
    whole = np.concatenate(right, axis=1)
    if left is right:
        return np.asarray(whole.T @ whole)
    return np.asarray(np.concatenate(left, axis=1).T @ whole)


@dataclass(frozen=True)
class Prior:
    """The prior of a group's amplitudes.

    Attributes
    ----------
    columns : ndarray of int
        In the products; never 0.
    mean, spread : ndarray
        Of each amplitude; an infinite spread is not allowed.
    """

    columns: npt.NDArray[np.int64]
    mean: Vector
    spread: Vector


@dataclass(frozen=True)
class Fitted:
    """Most likely amplitudes of all groups together.

    Attributes
    ----------
    columns : ndarray of int
    amplitude : ndarray
    covariance : ndarray
    """

    columns: npt.NDArray[np.int64]
    amplitude: Vector
    covariance: Matrix


def _cholesky(inner: Matrix, scale: Vector) -> Matrix:
    """The lower factor of a system of products, in units of its prior; not to be read above.

    Systems are small and many: what SciPy checks of each would take longer than to solve it.
    """
    system = np.eye(len(scale)) + scale[:, None] * inner * scale
    factor, failed = dpotrf(system, lower=True, clean=False)
    if failed:
        raise np.linalg.LinAlgError("a system of products is not positive definite")
    return np.asarray(factor)


def _solved(factor: Matrix, right: Matrix) -> Matrix:
    """The solution of a system that `_cholesky` took apart, of the same shape."""
    return np.asarray(dpotrs(factor, right, lower=True)[0]).reshape(right.shape)


def fit(products: Matrix, priors: Sequence[Prior]) -> Fitted:
    """Amplitudes of a model made of groups.

    Parameters
    ----------
    products : ndarray, shape (columns, columns)
    priors : sequence of Prior
    """
    columns, amplitude, scale, factor = _most_likely(products, priors)
    covariance = scale[:, None] * _solved(factor, np.diag(scale))
    return Fitted(columns, amplitude, covariance)


def _most_likely(
    products: Matrix, priors: Sequence[Prior]
) -> tuple[npt.NDArray[np.int64], Vector, Vector, Matrix]:
    """Columns, their amplitudes, and by what these were scaled in the system that was solved."""
    columns = np.concatenate([p.columns for p in priors]).astype(np.int64)
    mean = np.concatenate([p.mean for p in priors])
    precision = np.concatenate([p.spread for p in priors]) ** -2.0
    inner = products[np.ix_(columns, columns)]
    wanted = products[columns, 0] + precision * mean
    # scaled by the prior: precisions differ by many powers of ten
    scale = 1.0 / np.sqrt(precision)
    factor = _cholesky(inner, scale)
    return columns, scale * _solved(factor, scale * wanted), scale, factor


def fit_within(products: Matrix, priors: Sequence[Prior], low: Vector, high: Vector) -> Vector:
    """Most likely amplitudes of the first group, each within its bounds, beside other groups.

    Parameters
    ----------
    low, high : ndarray, shape (columns of the first group,)
    """
    count = len(low)
    columns, amplitude, _, _ = _most_likely(products, priors)
    if np.all((amplitude[:count] >= low) & (amplitude[:count] <= high)):
        return np.asarray(amplitude[:count])
    mean = np.concatenate([p.mean for p in priors])
    scale = np.concatenate([p.spread for p in priors])
    system = np.eye(len(columns)) + scale[:, None] * products[np.ix_(columns, columns)] * scale
    wanted = scale * products[columns, 0] + mean / scale
    factor = np.linalg.cholesky(system)
    goal = solve_triangular(factor, wanted, lower=True)
    open_ends = np.full(len(columns) - count, np.inf)
    bounds = (np.append(low, -open_ends) / scale, np.append(high, open_ends) / scale)
    found = lsq_linear(factor.T, goal, bounds, method="bvls")
    inside = np.clip(found.x[:count] * scale[:count], low, high)
    # what is scaled back may be a last digit off the bound at which it stands
    side = found.active_mask[:count]
    return np.asarray(np.where(side < 0, low, np.where(side > 0, high, inside)))


@dataclass(frozen=True)
class Conditioned:
    """What is left to explain, and with what, once a model's groups are projected out.

    Attributes
    ----------
    products : ndarray, shape (columns, columns)
        Before.
    signal : ndarray, shape (columns,)
        Products with the signal less what the priors' means say of it.
    cross, solved : ndarray, shape (groups' columns, columns)
        What projects.
    evidence : float
        Of the model that was projected out.
    """

    products: Matrix
    signal: Vector
    cross: Matrix
    solved: Matrix
    evidence: float

    def of(self, columns: npt.NDArray[np.int64]) -> tuple[Matrix, Vector]:
        """Products of columns with each other, and with the signal, as they are left."""
        cross = self.cross[:, columns].T
        inner = self.products[np.ix_(columns, columns)] - cross @ self.solved[:, columns]
        return inner, self.signal[columns] - cross @ self.solved[:, 0]

    @property
    def squares(self) -> float:
        """Of the signal, as they are left."""
        return float(self.signal[0] - self.cross[:, 0] @ self.solved[:, 0])


def conditioned(products: Matrix, priors: Sequence[Prior]) -> Conditioned:
    """What is left to explain, and with what, given a model."""
    columns = np.concatenate([p.columns for p in priors]).astype(np.int64)
    mean = np.concatenate([p.mean for p in priors])
    scale = np.concatenate([p.spread for p in priors])
    inner = products[np.ix_(columns, columns)]
    factor = _cholesky(inner, scale)
    rows = products[columns, :]
    signal = products[0] - mean @ rows
    signal[0] += mean @ inner @ mean - mean @ rows[:, 0]
    cross = scale[:, None] * rows
    cross[:, 0] = scale * signal[columns]
    solved = _solved(factor, cross)
    squares = float(signal[0] - cross[:, 0] @ solved[:, 0])
    evidence = -0.5 * squares - float(np.sum(np.log(np.diag(factor))))
    return Conditioned(products, signal, cross, solved, evidence)


def evidence_of(products: Matrix, priors: Sequence[Prior]) -> float:
    """Evidence of a model, on the scale of `conditioned`."""
    columns = np.concatenate([[0], *(p.columns for p in priors)]).astype(np.int64)
    return conditioned(products[np.ix_(columns, columns)], side_by_side(priors)).evidence


def side_by_side(priors: Sequence[Prior]) -> list[Prior]:
    """The priors of groups whose columns alone follow the signal's, one group after the other."""
    ends = np.cumsum([1, *(len(p.columns) for p in priors)])
    return [
        Prior(np.arange(a, b), p.mean, p.spread)
        for p, (a, b) in zip(priors, pairwise(ends), strict=True)
    ]


def volume(products: Matrix, priors: Sequence[Prior]) -> float:
    """Logarithm of how much the data narrow what was as likely before."""
    columns = np.concatenate([p.columns for p in priors]).astype(np.int64)
    scale = np.concatenate([p.spread for p in priors])
    inner = products[np.ix_(columns, columns)]
    factor = _cholesky(inner, scale)
    return float(np.sum(np.log(np.diag(factor))))


def gain(inner: Matrix, signal: Vector, mean: Vector, spread: Vector) -> float:
    """By how much a further group raises the evidence.

    Parameters
    ----------
    inner, signal : ndarray
        What is left of its products, see `Conditioned.of`.
    mean, spread : ndarray
        Of its prior.
    """
    moved = signal - inner @ mean
    factor = _cholesky(inner, spread)
    scaled = spread * moved
    before = float(2.0 * mean @ signal - mean @ inner @ mean)
    after = float(scaled @ _solved(factor, scaled))
    return 0.5 * (before + after) - float(np.sum(np.log(np.diag(factor))))


@dataclass(frozen=True)
class Weighed:
    """The best spread of a group of which only the directions are known."""

    gain: float
    spread: Vector


def weigh(inner: Matrix, signal: Vector) -> Weighed:
    """Evidence of a group whose size is unknown: the best of many sizes, less what choosing costs.

    Parameters
    ----------
    inner, signal : ndarray
        What is left of its products, see `Conditioned.of`.
    """
    norms = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    # a column that hardly shows has no reason to be larger for it
    relative = 1.0 / np.maximum(norms, _LEAST * norms.max())
    relative = relative / math.sqrt(float(np.sum((relative * norms) ** 2)))
    # in the directions of the scaled products every size is a matter of one number
    strength, directions = np.linalg.eigh(relative[:, None] * inner * relative)
    grown = 1.0 + _SIZES[:, None] ** 2 * np.maximum(strength, 0.0)
    seen = (directions.T @ (relative * signal)) ** 2
    found = 0.5 * ((_SIZES[:, None] ** 2 / grown) @ seen - np.log(grown).sum(axis=1))
    every = float(np.logaddexp.reduce(found)) - math.log(len(_SIZES))  # as likely before
    return Weighed(every, _SIZES[int(np.argmax(found))] * relative)
