"""Exact or random permutations of a condition's levels among otherwise equal trials."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

MOST_COUNTED = 10_000_000  # most assignments that are all counted; of more, a random sample is used
_MOST_OF_ONE_STRATUM = 100_000
DRAWS = 99_999
_SEED = 20240229
_ROWS = 2000
_ROUND = 1e-9  # relative difference below which assignments explain the same


@dataclass(frozen=True)
class _Test:
    explained: float
    p_value: float
    smallest_p: float
    assignments: int
    exact: bool


def level_codes(labels: Sequence[str]) -> Indices:
    """Levels numbered in order of appearance, so that equal divisions have equal codes."""
    order: dict[str, int] = {}
    return np.array([order.setdefault(x, len(order)) for x in labels], dtype=np.int64)


def ratio(difference: float, deviation: float) -> float:
    if math.isnan(deviation):
        return math.nan
    return difference / deviation if deviation > 0 else math.inf


def _columns(codes: Indices) -> Vector:
    return np.asarray(codes[:, None] == np.arange(int(codes.max()) + 1), dtype=float)


def _basis(columns: Vector) -> Vector:
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, singular > 1e-9 * singular[0]])


def residual_squares(y: Vector, conditions: Sequence[Indices]) -> tuple[float, int]:
    """Residual sum of squares with all conditions, and its degrees of freedom."""
    basis = _basis(np.hstack([np.ones((len(y), 1)), *map(_columns, conditions)]))
    residual = y - basis @ (basis.T @ y)
    freedom = len(y) - basis.shape[1]
    return float(residual @ residual) if freedom else 0.0, freedom


def permute_levels(y: Vector, codes: Indices, others: Sequence[Indices]) -> _Test:
    """Permute a condition's levels among the trials that are alike in all other conditions."""
    alike = level_codes([",".join(str(int(o[k])) for o in others) for k in range(len(y))])
    strata = [np.flatnonzero(alike == s) for s in range(int(alike.max()) + 1)]
    centred = y.astype(float)
    design = _columns(codes)
    for members in strata:
        centred[members] -= centred[members].mean()
        design[members] -= design[members].mean(0)
    if not np.abs(design).max() > 1e-9:
        return _Test(0.0, 1.0, 1.0, 1, True)
    left, singular, _ = np.linalg.svd(design, full_matrices=False)
    design = left[:, singular > 1e-9 * singular[0]]
    observed = float(((design.T @ centred) ** 2).sum())
    near = _ROUND * float(centred @ centred)
    counts = [_arrangements(codes[m]) for m in strata]
    total = math.prod(counts)
    if total > MOST_COUNTED or max(counts) > _MOST_OF_ONE_STRATUM:
        hits = 0
        for shuffled in _draws(alike):
            explained = (np.einsum("dnk,n->dk", design[shuffled], centred) ** 2).sum(1)
            hits += int((explained >= observed - near).sum())
        smallest = 1 / (DRAWS + 1)
        return _Test(observed, (1 + hits) / (1 + DRAWS), smallest, DRAWS, False)
    # An assignment's sum over the trials is a sum over strata. The sums of the strata are combined
    # in two halves, and every pair of the halves is an assignment.
    halves = [np.zeros((1, design.shape[1]))] * 2
    for members in strata:
        parts = np.array(
            [design[members[list(order)]].T @ centred[members] for order in _orders(codes[members])]
        )
        smaller = 0 if len(halves[0]) <= len(halves[1]) else 1
        sums = halves[smaller][:, None, :] + parts[None, :, :]
        halves[smaller] = sums.reshape(-1, design.shape[1])
    hits, largest, largest_hits = 0, -1.0, 0
    for first in halves[0]:
        explained = ((first + halves[1]) ** 2).sum(1)
        hits += int((explained >= observed - near).sum())
        here = float(explained.max())
        if here > largest + near:
            largest, largest_hits = here, 0
        largest_hits += int((explained >= largest - near).sum())
    return _Test(observed, hits / total, largest_hits / total, total, True)


def _draws(strata: Indices) -> Iterator[Indices]:
    """Random permutations within strata, `DRAWS` in total, in groups of rows."""
    random = np.random.default_rng(_SEED)
    sorted_places = np.argsort(strata, kind="stable")
    for begin in range(0, DRAWS, _ROWS):
        rows = min(_ROWS, DRAWS - begin)
        order = np.argsort(strata + random.random((rows, len(strata))), axis=1)
        shuffled = np.empty_like(order)
        shuffled[:, sorted_places] = order
        yield shuffled


def _arrangements(codes: Indices) -> int:
    _, sizes = np.unique(codes, return_counts=True)
    return math.factorial(len(codes)) // math.prod(math.factorial(int(s)) for s in sizes)


def _orders(codes: Indices) -> Iterator[tuple[int, ...]]:
    """Every different arrangement of the levels, as indices."""
    places = {int(c): [int(k) for k in np.flatnonzero(codes == c)] for c in np.unique(codes)}

    def fill(free: tuple[int, ...], levels: list[int]) -> Iterator[dict[int, int]]:
        if not levels:
            yield {}
            return
        source = places[levels[0]]
        for chosen in itertools.combinations(free, len(source)):
            taken = dict(zip(chosen, source, strict=True))
            rest = tuple(k for k in free if k not in taken)
            for others in fill(rest, levels[1:]):
                yield taken | others

    for order in fill(tuple(range(len(codes))), list(places)):
        yield tuple(order[k] for k in range(len(codes)))


def holm(p_values: Mapping[str, float]) -> dict[str, float]:
    """P-values corrected for their number, after Holm (1979)."""
    corrected: dict[str, float] = {}
    largest = 0.0
    for k, name in enumerate(sorted(p_values, key=lambda n: p_values[n])):
        largest = max(largest, min(1.0, p_values[name] * (len(p_values) - k)))
        corrected[name] = largest
    return corrected
