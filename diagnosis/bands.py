"""Balances of a study as spectra of blocks: products of columns, by block and by band.

A record is cut into blocks, which are held out one at a time. Within a block a balance is tapered
and transformed; in a band of frequencies its noise is taken for white, of a variance of the band's
own (P. Whittle, "Estimation and information in stationary time series", Ark. Mat. 2, 1953). So an
effect slower than the noise's memory counts as what it is.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.fft import rfft
from scipy.ndimage import binary_opening
from scipy.signal.windows import tukey

from ..identification.fitted_law import BRISTLES
from .balance import EXACT, Added, leftovers
from .drive import Drive
from .modelled_record import ModelledRecord, carried, read_anew
from .weak_form import averaged, windows

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

BLOCKS = 5
"""Held out one at a time; as many as there are records, if those are more."""

EDGES = (0.0, 0.5, 2.0, 8.0, 32.0, 128.0, 512.0, np.inf)
"""Of the bands [Hz]: two octaves each, as noise of machines is much the same within that."""

TAPER = 0.1
"""Of a block, that the cosines of a Tukey window take."""

AROUND_REST = 3
"""Windows beside a rest, and half of those at the start, that a bell or the winding reaches."""

OF_CARRIED = 0.35
"""Of the frequency from which on a filtered position has nothing, up to which it is not bent."""

WITHIN_INTERVAL = 1.0 / math.sqrt(3.0)
"""Standard deviation of an instant that is anywhere within a sampling interval to either side."""

NOISE_OF_MOTION = 0.1
"""Share of the power of mass times acceleration, from which on the encoder's noise hides it."""


@dataclass(frozen=True)
class Bands:
    """How the balances of a study are cut.

    Attributes
    ----------
    parts : list of (record, first, last)
        Windows of each block.
    weights : list of ndarray, shape (windows, channels)
        Of each block: taper, times zero where the drive rests, times the doubt in the law's force.
    used : ndarray of bool, shape (channels * bands,)
    counts : ndarray, shape (blocks, channels * bands)
        Of independent real numbers.
    steps : list of float
        Between windows, of each block [s].
    top : float
        Frequency up to which a filtered position is not bent [Hz].
    """

    parts: list[tuple[int, int, int]]
    weights: list[Matrix]
    used: npt.NDArray[np.bool_]
    counts: Matrix
    steps: list[float]
    top: float

    def lines(self, columns: Sequence[Matrix]) -> list[list[Matrix]]:
        """Spectra of columns: for each block and each channel's bands, shape (numbers, columns).

        White noise has its variance in each of the numbers. Bands that are not used are empty.

        Parameters
        ----------
        columns : sequence of ndarray, shape (windows, channels, columns)
            Of each record [N].
        """
        out = []
        for (record, first, last), weights, step in zip(
            self.parts, self.weights, self.steps, strict=True
        ):
            part = columns[record][first:last]
            count, channels, _ = part.shape
            block = []
            for c in range(channels):
                size = float(np.sum(weights[:, c] ** 2))
                # where little of a block is seen, its lines say the same several times
                scale = math.sqrt(2.0 / max(size, 1e-300) * _seen(weights)[c])
                each = np.ascontiguousarray((part[:, c] * (scale * weights[:, c, None])).T)
                spectrum = rfft(each, axis=1)
                spectrum[:, 0] *= math.sqrt(0.5)
                for b, rows in enumerate(_rows(count, step, self.top)):
                    if not self.used[c * (len(EDGES) - 1) + b]:
                        rows = slice(0, 0)
                    some = spectrum[:, rows]
                    block.append(np.concatenate([some.real, some.imag], axis=1).T)
            out.append(block)
        return out


def products(left: list[list[Matrix]], right: list[list[Matrix]]) -> npt.NDArray[np.float64]:
    """Inner products of columns, shape (blocks, channels * bands, columns, columns)."""
    return np.array(
        [
            [a.T @ b for a, b in zip(one, other, strict=True)]
            for one, other in zip(left, right, strict=True)
        ]
    )


def _rows(count: int, step: float, top: float) -> list[slice]:
    """Lines of a block's spectrum that are in each band."""
    edges = np.minimum([*EDGES[1:-1], np.inf], top)
    ends = [0, *np.searchsorted(np.fft.rfftfreq(count, step), edges).tolist()]
    return [slice(a, b) for a, b in itertools.pairwise(ends)]


def _seen(weights: Matrix) -> Vector:
    """Share of a block that counts, shape (channels,)."""
    return np.asarray(np.mean(weights**2, axis=0))


def cut(courses: Sequence[ModelledRecord], model: Drive) -> Bands:
    """The blocks and bands of a study, and what of them the instruments hide."""
    exact = EXACT * model.friction_scale
    per = -(-BLOCKS // len(courses))
    top = min(_top(c) for c in courses)
    parts, weights, counts, steps = [], [], [], []
    for r, c in enumerate(courses):
        n = windows(len(c.x), c.width)
        ends = [n * k // per for k in range(per + 1)]
        moves = moving(c, model)
        doubt = _doubt(c, model, exact, moves)
        for first, last in itertools.pairwise(ends):
            taper = tukey(last - first, TAPER) * moves[first:last]
            block = np.column_stack([taper * doubt[first:last], *[taper] * (len(c.channels) - 1)])
            parts.append((r, first, last))
            weights.append(block)
            steps.append(c.width * c.step)
            lines = [rows.stop - rows.start for rows in _rows(last - first, steps[-1], top)]
            real = 2.0 * np.array(lines)
            real[0] -= 1.0
            counts.append(np.outer(_seen(block), real).ravel())
    all_ = np.ones(len(counts[0]), dtype=bool)
    bands = Bands(parts, weights, all_, np.array(counts), steps, top)
    return Bands(parts, weights, _clear(courses, model, bands), bands.counts, steps, top)


def moving(course: ModelledRecord, model: Drive) -> Vector:
    """Windows that tell of forces, shape (windows,): none of a rest, around one, or at the start.

    A law without bristles has no force at rest, as soon as that is longer than a reversal. What
    went on in the winding before the start is not known.
    """
    slow = course.rests
    if model.law not in BRISTLES:
        still = np.abs(course.v) < course.slowest
        slow = slow | binary_opening(still, np.ones(2 * course.width, dtype=bool))
    rests = averaged(slow.astype(float), course.width) > 0.0
    near = np.convolve(rests, np.ones(2 * AROUND_REST + 1), mode="same") > 0.0
    near[: 2 * AROUND_REST] = True
    if model.law not in BRISTLES:  # which way it brakes there is not known
        near |= averaged((np.abs(course.v) < course.slowest).astype(float), course.width) > 0.0
    return np.asarray(1.0 - near)


def _top(course: ModelledRecord) -> float:
    """Up to which frequency a position tells all of the motion [Hz]."""
    known = carried(course.record)
    return OF_CARRIED * known if known < 0.49 / course.step else math.inf


def _doubt(course: ModelledRecord, model: Drive, exact: float, moves: Vector) -> Vector:
    """Weight of the balance of forces by what the motion's error makes of the law, (windows,)."""
    left = leftovers([course], model, Added.nothing([course]))[0][moves > 0.0, 0]
    left = left if len(left) else np.zeros(1)
    size = max(1.48 * float(np.median(np.abs(left - np.median(left)))), exact)
    # when the law's force jumps, a sample does not tell when within its interval
    jumps = np.diff(course.bristle, append=course.bristle[-1:])
    timing = WITHIN_INTERVAL * averaged(jumps, course.width)
    return np.asarray(1.0 / np.sqrt(1.0 + (course.force_variance + timing**2) / size**2))


def _clear(courses: Sequence[ModelledRecord], model: Drive, bands: Bands) -> npt.NDArray[np.bool_]:
    """Bands in which the instruments' noise leaves the motion to be seen."""
    random = np.random.default_rng(0)
    both = []
    for c in courses:
        again = read_anew(c, model, random)
        noise = model.inertia * (again.measured_a - c.measured_a)
        whole = model.inertia * c.measured_a
        one = np.stack([np.column_stack([noise, whole])] * len(c.channels), axis=1)
        both.append(one)
    lines = bands.lines(both)
    power = products(lines, lines).sum(axis=0)
    hidden = power[:, 0, 0] > NOISE_OF_MOTION * np.maximum(power[:, 1, 1] - power[:, 0, 0], 0.0)
    enough = bands.counts.sum(axis=0) > 2.0 * len(bands.parts)
    band = np.tile(np.arange(len(EDGES) - 1), len(courses[0].channels))
    clear = np.asarray((~hidden | (band < 2)) & enough)
    # short and slow: friction shows there, and no mass
    return clear if clear.any() else np.asarray(enough & (band < 4))
