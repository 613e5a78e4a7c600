"""A model fitted to records within the tolerances of its values, with blocks held out.

Values, amplitudes and the noise of each band are fitted to all blocks except one. The
log-likelihood of the held-out block is summed over all blocks (cross-validated predictive
likelihood; S. Geisser and W. Eddy, JASA 74, 1979).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...solver.arrays import Matrix, Vector
from ...solver.errors import BadRecord
from ..records.record import Record
from .balance import EXACT, check_motion, leftovers, sensitivities
from .bands import Bands, cut, products
from .model import Drive
from .motion import Course, calibrations, courses_of, read_anew, recalibrated, with_law_force
from .windows import at_samples

FREEDOM = 4.0  # degrees of freedom of Student's distribution, as usual for noise with outliers

COARSE = 100.0
"""Count of a block's band beyond which more numbers add little information, because a model is not
exact (coarsened posterior; J. Miller and D. Dunson, JASA 114, 2019)."""

COMMANDED = 2e-4  # error of a command over its rms: about one bit of a 12-bit converter

_WEIGHINGS = 4  # iterations of the bands' weights
_TINY = 1e-9  # share of a column's own square for a flat prior, and of a slope that is none
_STEPS = 4  # most steps of the active set per amplitude
_AT_MOST = 0.9  # largest share of noise in a column


class Priors(NamedTuple):
    """Priors of columns, shape (N, columns): mean, one over the variance, and largest change."""

    mean: Matrix
    precision: Matrix
    most: Matrix


@dataclass(frozen=True)
class Study:
    """Records with a model along them, and their blocks and bands."""

    courses: list[Course]
    model: Drive  # its values are the point of linearization
    prior_model: Drive
    bands: Bands

    @property
    def values(self) -> tuple[str, ...]:
        """Names of the columns of values and calibrations."""
        return (*self.model.adjustable, *self.courses[0].calibration)

    @cached_property
    def exact(self) -> float:
        """Smallest noise, because no law and no command is exact [N]."""
        asked = [c.per_command**2 * float(np.mean(c.u**2)) for c in self.courses]
        of_command = COMMANDED * math.sqrt(max(asked))
        return math.hypot(EXACT * self.prior_model.friction_scale, of_command)

    def priors(self, freed: Sequence[str] = ()) -> Priors:
        """Priors of the change of each of `values`; those that are `freed` have no limit."""
        names, known = self.model.adjustable, calibrations(self.courses[0])
        ratio = [self.prior_model.values[n] / self.model.values[n] - 1.0 for n in names]
        mean = np.array([*ratio, *(-self.courses[0].calibration[n] for n in known)])
        spread = [self.prior_model.tolerance[n] / math.sqrt(3.0) for n in names]
        most = [math.sqrt(3.0) * s for s in spread]
        most += [max(-p.low, p.high) for p in known.values()]
        spread += [p.spread for p in known.values()]
        for name in freed:
            k = self.values.index(name)
            spread[k], most[k] = max(self.model.free_spread(name), spread[k]), math.inf
        return Priors(mean, np.array(spread) ** -2.0, np.array(most))

    def at_ends(self, amplitude: Vector) -> list[str]:
        """Those of `values` that are at their limit after a fit."""
        mean, _, most = self.priors()
        full = np.isclose(np.abs(amplitude[: len(mean)] - mean), most)
        return [n for n, at in zip(self.values, full, strict=True) if at]


@dataclass(frozen=True)
class Fit:
    """N forms, each fitted separately; amplitudes have standard errors by a jackknife."""

    held: Matrix  # log-likelihood of each held-out block, shape (N, blocks)
    squares: Vector  # of its residual, shape (N, blocks, used bands) [N^2]
    amplitude: Matrix  # from all blocks, shape (N, columns)
    error: Matrix
    ways: Vector  # amplitudes from all blocks except one, shape (blocks, N, columns)
    cost: Vector  # minus the logarithm of the prior density of the values, shape (N,)

    def one(self, k: int) -> Fit:
        """The fit of one of the forms."""
        some = slice(k, k + 1)
        own = {name: values[some] for name, values in vars(self).items()}
        return Fit(**own | {"ways": self.ways[:, some]})


class Bounded(NamedTuple):
    """Amplitudes, shape (N, columns), and the limit that each has reached: -1, 1, or 0 for none."""

    amplitude: Matrix
    side: Matrix


def trusted(counts: Matrix) -> Matrix:
    """Share of a band's numbers that would give the same information with an exact model."""
    return np.asarray(1.0 / (1.0 + counts / COARSE))


def fitted(products: Vector, bands: Bands, prior: Priors, exact: float) -> Fit:
    """Fit to all blocks, and to all blocks except each one in turn; `exact` is the least noise [N].

    `products` of columns, the signal first, have the shape
    (blocks, used bands, N, 1 + columns, 1 + columns).
    """
    counts = bands.counts[:, bands.used]
    trust = trusted(counts)
    counts, products = counts * trust, products * trust[:, :, None, None, None]
    blocks = np.arange(len(products))
    signal = products[:, :, :, 0, 0].sum(axis=0)
    start = (signal / counts.sum(axis=0)[:, None]).T + exact**2
    whole, variance = _with_noise(products, counts, prior, exact, (None, start), _WEIGHINGS)
    amplitude = whole.amplitude
    held, squares, ways = [], [], []
    for q in blocks:
        rest = blocks != q
        found, of_rest = _with_noise(
            products[rest], counts[rest], prior, exact, (whole, variance), _WEIGHINGS
        )
        ways.append(found.amplitude)
        left = _left(products[q : q + 1], found.amplitude)[0]
        each = 0.5 * counts[q] * np.log(of_rest)
        known = _floored(left, counts[q], exact)
        each += 0.5 * (FREEDOM + counts[q]) * np.log1p(known / (FREEDOM * of_rest))
        held.append(-each.sum(axis=1))
        squares.append(left / trust[q])
    each = np.array(ways)
    count = len(blocks)
    error = np.sqrt((count - 1) / count * np.sum((each - each.mean(axis=0)) ** 2, axis=0))
    cost = 0.5 * np.sum(prior.precision * (amplitude - prior.mean) ** 2, axis=1)
    return Fit(np.array(held).T, np.array(squares).transpose(1, 0, 2), amplitude, error, each, cost)


def _with_noise(
    products: Vector,
    counts: Matrix,
    prior: Priors,
    exact: float,
    start: tuple[Bounded | None, Matrix],
    times: int,
) -> tuple[Bounded, Matrix]:
    """Compute amplitudes and variances of the bands, shape (N, channels * bands), alternately.

    The noise varies along a record: the variances of blocks scatter around that of the band
    (Student's distribution; K. Lange, R. Little and J. Taylor, JASA 84, 1989).
    """
    found, variance = start
    each = counts[:, None, :]
    left = _left(products, found.amplitude) if found else products[:, :, :, 0, 0].transpose(0, 2, 1)
    left = _floored(left, each, exact)
    for _ in range(times):
        weight = (FREEDOM + each) / (FREEDOM + left / variance)
        inner = np.einsum("qbnij,qnb->nij", products, weight / variance)
        found = within_most(inner, prior, found)
        left = _floored(_left(products, found.amplitude), each, exact)
        weight = (FREEDOM + each) / (FREEDOM + left / variance)
        variance = np.sum(weight * left, axis=0) / counts.sum(axis=0)
    assert found
    return found, variance


def within_most(inner: Vector, prior: Priors, start: Bounded | None = None) -> Bounded:
    """Least-squares amplitudes within their limits, by an active-set method.

    Each step goes towards the best free amplitudes, and the first one that reaches a limit is fixed
    there. When the others have reached their optimum, a fixed amplitude that would move back inside
    is freed. The residual falls with every step, so that no active set occurs twice (J. Nocedal and
    S. Wright, "Numerical Optimization", 2006, ch. 16.5).
    """
    mean, precision, most = prior
    matrix = inner[:, 1:, 1:].copy()
    at = np.arange(mean.shape[1])
    matrix[:, at, at] += precision + _TINY * (matrix[:, at, at] + 1e-30)
    goal = inner[:, 1:, 0] + precision * mean
    amplitude, side = (part.copy() for part in start or (mean, np.zeros(mean.shape)))
    going = np.arange(len(mean))
    for _ in range(_STEPS * mean.shape[1]):
        now, held, low = matrix[going], side[going] != 0.0, amplitude[going]
        fixed = np.where(held, low, 0.0)
        # a fixed amplitude has a row of the identity matrix
        free = np.where(held[:, :, None] | held[:, None, :], 0.0, now)
        free[:, at, at] += held
        asked = goal[going] - np.matmul(now, fixed[:, :, None])[:, :, 0]
        step = np.linalg.solve(free, np.where(held, low, asked)[:, :, None])[:, :, 0] - low
        end = mean[going] + np.copysign(most[going], step)
        moves = ~held & (step != 0.0)
        room = np.divide(end - low, step, out=np.full(step.shape, np.inf), where=moves)
        first = np.argmin(room, axis=1)
        rows = np.arange(len(going))
        share = np.minimum(room[rows, first], 1.0)
        stops = share < 1.0
        amplitude[going] = np.where(held, low, low + share[:, None] * step)
        some, which = going[stops], first[stops]
        side[some, which] = np.sign(step[stops, which])
        amplitude[some, which] = end[stops, which]
        slope = np.matmul(now, amplitude[going][:, :, None])[:, :, 0] - goal[going]
        back = np.where(held, side[going] * slope, 0.0)
        turns = np.argmax(back, axis=1)
        size = np.abs(goal[going]) + np.abs(slope)
        let_go = ~stops & (back[rows, turns] > _TINY * size[rows, turns])
        side[going[let_go], turns[let_go]] = 0.0
        going = going[stops | let_go]
        if not len(going):
            break
    return Bounded(amplitude, side)


def _floored(left: Vector, counts: Matrix, exact: float) -> Vector:
    """Squares plus those of the smallest noise, so that residuals below it are no gain."""
    return np.hypot(left, counts * exact**2)


def _left(products: Vector, amplitude: Matrix) -> Vector:
    """Squares of the residual with these amplitudes, shape (blocks, N, channels * bands)."""
    signed = np.concatenate([np.ones((len(amplitude), 1)), -amplitude], axis=1)[:, :, None]
    half = np.matmul(products, signed)
    return np.asarray(np.maximum(np.sum(half * signed, axis=(3, 4)), 0.0).transpose(0, 2, 1))


def study_of(records: Sequence[Record], prior_model: Drive) -> Study:
    """Return records with the model along them, its values adjusted within their tolerances.

    The motor's force is computed from the current or from the voltage, whichever gives the higher
    likelihood of held-out blocks. Raises `BadRecord` if records show almost no motion.
    """
    courses = courses_of(records, prior_model)
    check_motion(courses, prior_model)
    studies = [_adjusted(courses, prior_model)]
    if all(c.has_current for c in courses):
        studies.append(_adjusted([replace(c, by_current=True) for c in courses], prior_model))
    return max(studies, key=lambda s: float(s[1].held.sum()))[0]


def _adjusted(courses: list[Course], prior_model: Drive) -> tuple[Study, Fit]:
    bands = cut(courses, prior_model)
    if not bands.used.any() or bands.counts[:, bands.used].sum() < 30.0:
        names = ", ".join(c.record.name for c in courses)
        raise BadRecord(f"{names}: almost no motion: x is constant, jumps or is noise")
    study = Study(courses, prior_model, prior_model, bands)
    for _ in range(2):  # Gauss-Newton
        study, fit = _moved(study)
    return study, fit


def base_fit(study: Study, columns: Sequence[Matrix], noise: Vector) -> Fit:
    """Fit of the model's own values alone, by `base_columns` and `noise_of`."""
    lines = study.bands.lines(columns)
    own = less_noise(products(lines, lines)[:, study.bands.used], noise)[:, :, None]
    prior = Priors(*(values[None] for values in study.priors()))
    return fitted(own, study.bands, prior, study.exact)


def base_columns(study: Study, of_law: bool = True) -> list[Matrix]:
    """The signal and the columns of values, (windows, channels, 1 + columns) for each record."""
    offset = study.model.values.get("offset", 0.0)
    usual = [c.bristle + offset for c in study.courses]
    left = leftovers(study.courses, study.model, usual)
    columns = sensitivities(study.courses, study.model, usual, of_law)
    return [np.concatenate([y[:, :, None], s], axis=2) for y, s in zip(left, columns, strict=True)]


def noise_of(study: Study, columns: Sequence[Matrix]) -> Vector:
    """Contribution of instrument noise to products of `base_columns`, of the same shape.

    The signal and the columns have the same noise, so a fit would reduce a mass or a current only
    to reduce its noise (errors in variables; W. Fuller, "Measurement Error Models", 1987). This
    bias is avoided by subtracting the contribution.
    """
    random, model = np.random.default_rng(0), study.model
    again = [read_anew(c, model, random) for c in study.courses]
    read = base_columns(replace(study, courses=again), of_law=False)
    of_law = [1 + study.values.index(n) for n in model.adjustable if n in model.law_parameters]
    changes = [after - before for after, before in zip(read, columns, strict=True)]
    for change in changes:
        change[:, :, of_law] = 0.0  # computed along the smoothed motion, which does not change
    lines = study.bands.lines(changes)
    return products(lines, lines)[:, study.bands.used]


def less_noise(own: Vector, noise: Vector) -> Vector:
    """Products less at most `_AT_MOST` of them for noise; the signal's square stays."""
    most = _AT_MOST * np.diagonal(own, axis1=2, axis2=3)
    size = np.diagonal(noise, axis1=2, axis2=3)
    room = np.divide(most, size, out=np.ones(size.shape), where=size > most)
    noise = np.array(noise)
    noise *= np.min(room[:, :, 1:], axis=2)[:, :, None, None]
    noise[:, :, 0, 0] = 0.0
    return np.asarray(own - noise)


def _moved(study: Study) -> tuple[Study, Fit]:
    """The study with better fitting values, and the fit."""
    columns = base_columns(study)
    fit = base_fit(study, columns, noise_of(study, columns))
    change = dict(zip(study.values, fit.amplitude[0].tolist(), strict=True))
    names, prior = study.model.adjustable, study.prior_model
    values = {}
    for n in names:  # within tolerances, because forms are computed around possible values
        off = study.model.values[n] * (1.0 + change[n]) / prior.values[n] - 1.0
        values[n] = prior.values[n] * (1.0 + min(max(off, -prior.tolerance[n]), prior.tolerance[n]))
    model = study.model.changed(values)
    moved = recalibrated(study.courses, {n: c for n, c in change.items() if n not in names})
    courses = [with_law_force(c, model) for c in moved]
    left = leftovers(courses, model)
    courses = [
        replace(c, unknown=at_samples(y[:, 0], len(c.x), c.width))
        for c, y in zip(courses, left, strict=True)
    ]
    return replace(study, courses=courses, model=model), fit
