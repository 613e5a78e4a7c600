"""Weighing explanations of one signal in white noise: linear models, by their evidence.

An explanation is a group of columns whose amplitudes have a normal prior: a known mean and spread,
or mean zero and the spread under which the data are most likely. Everything needed of the data are
the products of columns over stretches of the record, so that a comparison on some stretches, or on
all but some, costs no more than one on all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_LEAST = 0.1  # of the largest norm, by which amplitudes are measured
_SIZES = 2.0 ** np.arange(1.0, 9.0)  # of a group's part in the signal, in standard deviations


@dataclass(frozen=True)
class Columns:
    """The signal, column 0, and all others, with their products over stretches of the record.

    Blocks stay where they were made: there are hundreds of columns, and fresh memory for all of
    them costs more than the products do.

    Attributes
    ----------
    blocks : tuple of ndarray, shape (n, columns of the block)
    edges : tuple of int
        Ends of the stretches.
    """

    blocks: tuple[Matrix, ...]
    edges: tuple[int, ...]
    _known: dict[bytes, Matrix] = field(default_factory=dict)

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

    def products(self, used: npt.NDArray[np.bool_] | None = None) -> Matrix:
        """Products over all stretches, or those used, shape (count, count); not to be changed."""
        used = np.ones(self.stretches, dtype=bool) if used is None else used
        key = used.tobytes()
        if key not in self._known:
            room = np.empty((int(np.diff(self.edges).max()), self.count))
            total = np.zeros((self.count, self.count))
            for (a, b), wanted in zip(pairwise(self.edges), used, strict=True):
                if wanted:
                    part = np.concatenate([c[a:b] for c in self.blocks], axis=1, out=room[: b - a])
                    total += part.T @ part
            self._known[key] = total
        return self._known[key]

    def of(self, columns: npt.NDArray[np.int64]) -> Matrix:
        """Some of them, side by side, shape (n, columns)."""
        block = np.searchsorted(self.begins, columns, side="right") - 1
        parts = [self.blocks[b][:, c - self.begins[b]] for b, c in zip(block, columns, strict=True)]
        return np.column_stack(parts)

    def by_stretch(self, columns: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Products of some of them over each stretch, shape (stretches, columns, columns)."""
        some = self.of(columns)
        return np.stack([some[a:b].T @ some[a:b] for a, b in pairwise(self.edges)])

    def exchanged(self, first: int, block: Matrix) -> Columns:
        """With another block at the column where one begins."""
        at = int(np.searchsorted(self.begins, first))
        blocks = (*self.blocks[:at], block, *self.blocks[at + 1 :])
        cross = np.concatenate([b.T @ block for b in blocks])
        mine = slice(first, first + block.shape[1])
        total = self.products().copy()
        total[:, mine], total[mine, :] = cross, cross.T
        everything = np.ones(self.stretches, dtype=bool)
        return Columns(blocks, self.edges, {everything.tobytes(): total})


@dataclass(frozen=True)
class Prior:
    """What is believed of a group's amplitudes before the data.

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


def fit(products: Matrix, priors: Sequence[Prior]) -> Fitted:
    """Amplitudes of a model made of groups.

    Parameters
    ----------
    products : ndarray, shape (columns, columns)
    priors : sequence of Prior
    """
    columns = np.concatenate([p.columns for p in priors]).astype(np.int64)
    mean = np.concatenate([p.mean for p in priors])
    precision = np.concatenate([p.spread for p in priors]) ** -2.0
    inner = products[np.ix_(columns, columns)]
    wanted = products[columns, 0] + precision * mean
    # scaled by the prior: precisions differ by many powers of ten
    scale = 1.0 / np.sqrt(precision)
    system = np.eye(len(columns)) + scale[:, None] * inner * scale
    factor = cho_factor(system, lower=True)
    amplitude = scale * cho_solve(factor, scale * wanted)
    covariance = scale[:, None] * cho_solve(factor, np.diag(scale))
    return Fitted(columns, amplitude, covariance)


@dataclass(frozen=True)
class Conditioned:
    """Products of columns once a model's groups are projected out with their priors.

    Attributes
    ----------
    products : ndarray, shape (columns, columns)
    evidence : float
        Of the model that was projected out.
    """

    products: Matrix
    evidence: float


def conditioned(products: Matrix, priors: Sequence[Prior]) -> Conditioned:
    """What is left to explain, and with what, given a model."""
    columns = np.concatenate([p.columns for p in priors]).astype(np.int64)
    mean = np.concatenate([p.mean for p in priors])
    scale = np.concatenate([p.spread for p in priors])
    inner = products[np.ix_(columns, columns)]
    factor = cho_factor(np.eye(len(columns)) + scale[:, None] * inner * scale, lower=True)
    # the signal less what the prior's mean already says
    shifted = products.copy()
    shifted[0, :] -= mean @ products[columns, :]
    shifted[:, 0] = shifted[0, :]
    shifted[0, 0] = products[0, 0] - 2 * mean @ products[columns, 0] + mean @ inner @ mean
    cross = scale[:, None] * shifted[columns, :]
    left = shifted - cross.T @ cho_solve(factor, cross)
    evidence = -0.5 * left[0, 0] - float(np.sum(np.log(np.diag(factor[0]))))
    return Conditioned(left, evidence)


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
    factor = cho_factor(np.eye(len(columns)) + scale[:, None] * inner * scale, lower=True)
    return float(np.sum(np.log(np.diag(factor[0]))))


def gain(left: Matrix, columns: npt.NDArray[np.int64], mean: Vector, spread: Vector) -> float:
    """By how much a further group raises the evidence, given conditioned products."""
    inner = left[np.ix_(columns, columns)]
    g = left[columns, 0]
    moved = g - inner @ mean
    system = np.eye(len(columns)) + spread[:, None] * inner * spread
    factor = cho_factor(system, lower=True)
    scaled = spread * moved
    before = float(2 * g @ mean - mean @ inner @ mean)
    return 0.5 * (before + float(scaled @ cho_solve(factor, scaled))) - float(
        np.sum(np.log(np.diag(factor[0])))
    )


@dataclass(frozen=True)
class Weighed:
    """The best spread of a group of which only the directions are known."""

    gain: float
    spread: Vector


def weigh(left: Matrix, columns: npt.NDArray[np.int64]) -> Weighed:
    """Evidence of a group whose size is unknown: the best of many sizes, less what choosing costs.

    Parameters
    ----------
    left : ndarray
        Conditioned products.
    columns : ndarray of int
    """
    norms = np.sqrt(np.maximum(np.diag(left)[columns], 1e-300))
    # a column that hardly shows has no reason to be larger for it
    relative = 1.0 / np.maximum(norms, _LEAST * norms.max())
    relative = relative / math.sqrt(float(np.sum((relative * norms) ** 2)))
    # in the directions of the scaled products every size is a matter of one number
    inner = relative[:, None] * left[np.ix_(columns, columns)] * relative
    strength, directions = np.linalg.eigh(inner)
    strength = np.maximum(strength, 0.0)
    seen = (directions.T @ (relative * left[columns, 0])) ** 2
    grown = 1.0 + _SIZES[:, None] ** 2 * strength
    gains = 0.5 * np.sum(_SIZES[:, None] ** 2 * seen / grown - np.log(grown), axis=1)
    best = int(np.argmax(gains))
    # every size was as likely before
    total = float(np.logaddexp.reduce(gains)) - math.log(len(_SIZES))
    return Weighed(total, _SIZES[best] * relative)
