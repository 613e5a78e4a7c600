"""Balances of a study as spectra of blocks: products of columns, by block and by band.

A record is cut into blocks, which are held out one at a time. Within a block a balance is tapered
and transformed; in each band of frequencies its noise is assumed white, with its own variance (P.
Whittle, "Estimation and information in stationary time series", Ark. Mat. 2, 1953). So a slow
effect is not overrated when the noise is correlated in time.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.fft import rfft

from ...solver.arrays import Mask, Matrix, Vector
from ..records.examine import carried
from .balance import EXACT, leftovers, moving
from .model import Drive
from .motion import Course, read_anew
from .windows import averaged, windows

BLOCKS = 5  # number of blocks, held out one at a time; with more records than this, one per record

# edges of the bands [Hz]: two octaves each; machine noise is nearly constant within that
EDGES = (0.0, *(0.5 * 4.0 ** np.arange(6)), np.inf)

TAPER = 0.1  # share of a block in the cosine ends of a Tukey window

OF_CUT_OFF = 0.35  # share of a filter's cut-off up to which it does not change a position

WITHIN_INTERVAL = 1.0 / math.sqrt(3.0)  # standard deviation of an instant within +-1 interval

NOISE_OF_MOTION = 0.1  # share of encoder noise in mass times acceleration, of a band still used


class Block(NamedTuple):
    """A part of a record, held out as a whole.

    The weights, shape (windows, channels), are a taper, zero at rest, and less where the law's
    force is uncertain.
    """

    record: int
    windows: slice
    samples: slice
    weights: Matrix
    step: float  # time between windows [s]


@dataclass(frozen=True)
class Bands:
    """Blocks and frequency bands of the balances of a study.

    `counts` are numbers of independent real values.
    """

    blocks: list[Block]
    used: Mask  # shape (channels * bands,)
    counts: Matrix  # shape (blocks, channels * bands)
    top: float  # frequency up to which a filter does not change the position [Hz]

    @property
    def of_force(self) -> Mask:
        """Which of the used bands belong to the balance of forces."""
        return np.asarray((np.arange(len(self.used)) < len(EDGES) - 1)[self.used])

    def lines(self, columns: Sequence[Matrix]) -> list[list[Matrix]]:
        """Spectra of columns: for each block and each channel's bands, shape (numbers, columns).

        `columns` are those of each record, shape (windows, channels, columns) [N]. Each number of
        white noise has the variance of the noise. Unused bands are empty.
        """
        out = []
        for block in self.blocks:
            part, lines = columns[block.record][block.windows], []
            for c, weights in enumerate(block.weights.T):
                size = float(np.sum(weights**2))
                # if only a small share of a block counts, its spectral lines are correlated
                scale = math.sqrt(2.0 / max(size, 1e-300) * _seen(block.weights)[c])
                each = np.ascontiguousarray((part[:, c] * (scale * weights[:, None])).T)
                spectrum = rfft(each, axis=1)
                spectrum[:, 0] *= math.sqrt(0.5)
                for b, rows in enumerate(_rows(len(part), block.step, self.top)):
                    if not self.used[c * (len(EDGES) - 1) + b]:
                        rows = slice(0, 0)
                    some = spectrum[:, rows]
                    lines.append(np.concatenate([some.real, some.imag], axis=1).T)
            out.append(lines)
        return out


def products(left: list[list[Matrix]], right: list[list[Matrix]]) -> Vector:
    """Inner products of columns, shape (blocks, channels * bands, columns, columns)."""
    blocks = zip(left, right, strict=True)
    return np.array([[a.T @ b for a, b in zip(*block, strict=True)] for block in blocks])


def _rows(count: int, step: float, top: float) -> list[slice]:
    """Range of spectral lines of a block in each band."""
    edges = np.minimum([*EDGES[1:-1], np.inf], top)
    ends = [0, *np.searchsorted(np.fft.rfftfreq(count, step), edges).tolist()]
    return [slice(a, b) for a, b in itertools.pairwise(ends)]


def _seen(weights: Matrix) -> Vector:
    """Mean square weight of a block, shape (channels,)."""
    return np.asarray(np.mean(weights**2, axis=0))


def cut(courses: Sequence[Course], model: Drive) -> Bands:
    """Return the blocks and bands of a study; bands hidden by instrument noise are not used."""
    exact = EXACT * model.friction_scale
    per = -(-BLOCKS // len(courses))
    top = min(_top(c) for c in courses)
    blocks, counts = [], []
    for r, c in enumerate(courses):
        n = windows(len(c.x), c.width)
        ends = [n * k // per for k in range(per + 1)]
        # the last windows end before the last samples
        samples = itertools.pairwise([*(c.width * end for end in ends[:-1]), len(c.x)])
        moves = moving(c, model)
        doubt = _doubt(c, model, exact, moves)
        for first, last in itertools.pairwise(ends):
            taper = _tapered(last - first) * moves[first:last]
            weights = np.column_stack([taper * doubt[first:last], *[taper] * c.has_current])
            step, own = c.width * c.step, slice(first, last)
            blocks.append(Block(r, own, slice(*next(samples)), weights, step))
            lines = [rows.stop - rows.start for rows in _rows(last - first, step, top)]
            real = 2.0 * np.array(lines)
            real[0] -= 1.0
            counts.append(np.outer(_seen(weights), real).ravel())
    bands = Bands(blocks, np.ones(len(counts[0]), dtype=bool), np.array(counts), top)
    return replace(bands, used=_clear(courses, model, bands))


def _tapered(count: int) -> Vector:
    """Tukey's window, shape (count,); SciPy's own is in a package that takes 0.4 s to load."""
    at = 2.0 * np.arange(count) / TAPER / max(count - 1, 1)
    place = np.minimum(at - 1.0, 0.0) + np.maximum(at + (1.0 - 2.0 / TAPER), 0.0)
    return np.asarray(0.5 * (1.0 + np.cos(np.pi * place)))


def _top(course: Course) -> float:
    """Frequency up to which the recorded position contains the motion unfiltered [Hz]."""
    known = carried(course.record)
    return OF_CUT_OFF * known if known < 0.49 / course.step else math.inf


def _doubt(course: Course, model: Drive, exact: float, moves: Vector) -> Vector:
    """Weight of the balance of forces, by the law's error due to the motion's error, (windows,)."""
    left = leftovers([course], model)[0][moves > 0.0, 0]
    left = left if len(left) else np.zeros(1)
    size = max(1.48 * float(np.median(np.abs(left - np.median(left)))), exact)
    # the instant of a jump of the law's force within a sampling interval is not known
    jumps = np.diff(course.bristle, append=course.bristle[-1:])
    timing = WITHIN_INTERVAL * averaged(jumps, course.width)
    return np.asarray(1.0 / np.sqrt(1.0 + (course.force_variance + timing**2) / size**2))


def _clear(courses: Sequence[Course], model: Drive, bands: Bands) -> Mask:
    """Bands in which the motion is larger than the instruments' noise."""
    random, both = np.random.default_rng(0), []
    for c in courses:
        noise = model.linear.inertia * (read_anew(c, model, random).measured_a - c.measured_a)
        whole = model.linear.inertia * c.measured_a
        both.append(np.stack([np.column_stack([noise, whole])] * (1 + c.has_current), axis=1))
    lines = bands.lines(both)
    power = products(lines, lines).sum(axis=0)
    hidden = power[:, 0, 0] > NOISE_OF_MOTION * np.maximum(power[:, 1, 1] - power[:, 0, 0], 0.0)
    enough = bands.counts.sum(axis=0) > 2.0 * len(bands.blocks)
    band = np.tile(np.arange(len(EDGES) - 1), 1 + courses[0].has_current)
    clear = np.asarray((~hidden | (band < 2)) & enough)
    # a short, slow record: friction is visible there, mass is not
    return clear if clear.any() else np.asarray(enough & (band < 4))
