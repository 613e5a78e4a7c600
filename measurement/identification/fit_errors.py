"""Standard errors and intervals of a fit, from pieces of the records."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from ...solver.arrays import Matrix, Vector
from .fitted_law import OFFSET, without_direction
from .identifiability import blurred_elements, hardly_slides, peak_unseen
from .intervals import CONFIDENCE, NARROW, Fit, Interval, is_narrow
from .law_along_record import with_backlash
from .likelihood import OWN, Climb, Pieces

PIECE = 1.0  # length of pieces taken as independent [s]
# Smallest standard error of a logarithm: errors by counts and by smoothing between samples have
# this size on records of the closed-loop rig, and more data do not reduce them.
FLOOR = 2e-3
# The same of a delay, in sampling intervals: friction at a reversal depends on the time in it.
LATE_FLOOR = 0.25
# Parameters whose relative error is at most that of the presliding distance
_ELASTIC = ("sigma0", "sigma", "alpha", "eps_f", "k1", "k2", "k3", "k4")
_FROM_PIECES = "maximum likelihood, errors from pieces of the records"


def sum_up(climb: Climb, fixed: Mapping[str, float]) -> Fit:
    """The fit at the point that was reached, with its errors; `fixed` are the held values."""
    problem, course = climb.problem, climb.problem.course
    pieces = climb.normal()
    q, p = len(pieces.columns), problem.size  # parameters and delays; parameters
    clocks = np.arange(p, q)
    inverse = _inverse(pieces.information)
    blind = pieces.information.copy()
    blind[clocks, clocks] -= _told_of_delays(climb, pieces)
    cautious = _inverse(blind)
    doubt = np.maximum(np.diag(cautious) - np.diag(inverse), 0.0)[:q]
    covariance, freedom = _robust(climb, pieces, inverse, climb.prior_std, doubt)
    floor = np.full(p, FLOOR)
    floor[problem.logarithms :] *= course.level
    covariance[np.diag_indices(p)] += floor**2 + _of_sensors(climb)
    predicted, u = climb.force(), climb.point
    fit = Fit(
        law=problem.law,
        coordinates=u.coordinates,
        delays=u.delays,
        late=_late(climb, pieces),
        noise=math.exp(u.noise),
        information=_inverse(cautious[:q, :q]),  # unknowns of records and noise are eliminated
        covariance=covariance[:p, :p],
        freedom=freedom[:p],
        predicted=np.where(problem.spoken, predicted, course.force),
        held_out=_held_out(climb, pieces, inverse, predicted),
        spoken=problem.spoken,
        hidden=problem.unseen(predicted) + np.mean(climb.errors**2, axis=0),
    )
    return replace(fit, intervals=_intervals(fit, climb, fixed))


class _Piece(NamedTuple):
    """A piece of a record, with what it tells of the unknowns at the places `at`."""

    at: npt.NDArray[np.int64]
    part: slice  # its samples
    local: Matrix  # derivatives of the force by all of these unknowns but the noise
    block: Matrix  # information
    said: Vector  # score


def _inverse(matrix: Matrix) -> Matrix:
    """Inverse of an information, of unknowns of very different sizes."""
    size = np.sqrt(np.diag(matrix))
    both = np.outer(size, size)
    return np.asarray(np.linalg.inv(matrix / both) / both, dtype=float)


def _of_record(climb: Climb, r: int) -> npt.NDArray[np.int64]:
    """Places of the parameters and delays, and of one record's own unknowns."""
    q, records = climb.problem.size + climb.problem.course.clocks, climb.problem.course.records
    return np.append(np.arange(q), q + r + records * np.arange(OWN))


def _robust(
    climb: Climb, pieces: Pieces, inverse: Matrix, prior_std: Vector, doubt: Vector
) -> tuple[Matrix, Vector]:
    """Covariance of parameters and delays, and degrees of freedom of each.

    `inverse` is that of the information with this `prior_std`, both of all unknowns; `doubt` are
    least variances of parameters and delays in addition to those of noise and motion.
    """
    problem, course = climb.problem, climb.problem.course
    q, prior = len(pieces.columns), prior_std**-2
    rows = inverse[:q]
    meat, shares = np.diag(prior), []  # outer products of the pieces' scores; each one's share
    for piece in _each_piece(climb, pieces, inverse):
        meat[np.ix_(piece.at, piece.at)] += np.outer(piece.said, piece.said)
        arms = rows[:, piece.at]
        shares.append(np.einsum("ij,jk,ik->i", arms, piece.block, arms))
    robust, share = rows @ meat @ rows.T, np.array(shares)
    spread = climb.spread(climb.point.noise) ** 2 + course.resolution**2 / 12
    white = (spread - climb.hidden) / spread

    def moved(error: Vector) -> Vector:
        return rows @ climb.pull(pieces.columns, pieces.own, problem.weight[0] * error)

    of_motion = np.mean(np.square([moved(e) for e in climb.errors]), axis=0)
    whole = rows**2 @ prior
    short = with_backlash(course.x, course.starts, course.backlash)
    more = climb.force(np.stack([short, course.v, course.inertial])) - climb.force()
    least = _of_noise(climb, pieces, inverse, white, prior) + of_motion + doubt
    for r, part in enumerate(course.parts()):  # each entire record as one piece
        local = np.vstack([pieces.columns[:, part], pieces.own[:, part]])
        whole += (rows[:, _of_record(climb, r)] @ (local @ problem.gradient[0, part])) ** 2
    scale = np.sqrt(np.maximum(np.maximum(least, whole) / np.diag(robust), 1.0))
    covariance = robust * np.outer(scale, scale)
    covariance[np.diag_indices(q)] += moved(more) ** 2
    # Satterthwaite's degrees of freedom; prior information counts as certain
    known = np.einsum("ij,j,ij->i", rows, prior, rows)
    squares = np.maximum((share**2).sum(axis=0), 1e-300)
    return covariance, np.maximum((share.sum(axis=0) + known) ** 2 / squares, 2.0)


def _late(climb: Climb, pieces: Pieces) -> tuple[Interval, ...]:
    """Delays by the records alone: one step of the fit, without what was known before [s]."""
    problem, course = climb.problem, climb.problem.course
    clocks = np.arange(problem.size, len(pieces.columns))
    step = course.step[np.unique(course.clock, return_index=True)[1]]
    wide = climb.prior_std.copy()
    wide[clocks] = 25.0 * step  # nothing is known
    less = wide[clocks] ** -2 - problem.clock_std**-2
    free = pieces.information.copy()
    free[clocks, clocks] += less
    inverse = _inverse(free)
    known = climb.point.delays
    delays = known - inverse[np.ix_(clocks, clocks)] @ (less * known)
    covariance, freedom = _robust(climb, pieces, inverse, wide, np.zeros(len(pieces.columns)))
    errors = np.sqrt(np.diag(covariance)[clocks] + (LATE_FLOOR * step) ** 2)
    reach = student.ppf(0.5 + CONFIDENCE / 2, freedom[clocks]) * errors
    return tuple(
        Interval(float(d), "s", float(e), float(d - r), float(d + r), _FROM_PIECES, True)
        for d, e, r in zip(delays, errors, reach, strict=True)
    )


def _each_piece(climb: Climb, pieces: Pieces, inverse: Matrix) -> Iterator[_Piece]:
    """What each piece tells, of the global unknowns and of those of its record."""
    problem, course = climb.problem, climb.problem.course
    for r, whole in enumerate(course.parts()):
        length = max(10, round(PIECE / course.step[r]))
        at = np.append(_of_record(climb, r), len(inverse) - 1)
        for first in range(whole.start, whole.stop, length):
            part = slice(first, min(first + length, whole.stop))
            weight, gradient = problem.weight[:, part], problem.gradient[:, part]
            noisy = pieces.noisy[part]
            local = np.vstack([pieces.columns[:, part], pieces.own[:, part]])
            block = np.empty((len(at), len(at)))
            block[:-1, :-1] = (local * weight[0]) @ local.T
            block[:-1, -1] = block[-1, :-1] = local @ (weight[1] * noisy)
            block[-1, -1] = weight[2] @ noisy**2
            said = np.append(local @ gradient[0], gradient[1] @ noisy)
            # leverage: the score of the piece if it had not been used in the fit
            said = np.linalg.solve(np.eye(len(at)) - block @ inverse[np.ix_(at, at)], said)
            yield _Piece(at, part, local, block, said)


def _held_out(climb: Climb, pieces: Pieces, inverse: Matrix, predicted: Vector) -> Vector:
    """Force of each piece by the parameters of a fit without it, to first order [N]."""
    without = predicted.copy()
    for piece in _each_piece(climb, pieces, inverse):
        moved = inverse[np.ix_(piece.at, piece.at)] @ piece.said
        without[piece.part] -= moved[:-1] @ piece.local
    return without


def _of_sensors(climb: Climb) -> Vector:
    """Variances that more records of the same sensors do not reduce, by coordinate.

    The presliding distance has errors of the reconstruction at corners and of the calibration of
    scales, which are the same in all records. Its relative error is that of the stiffness, and is
    larger for stiffer contacts.
    """
    problem, course, coordinates = climb.problem, climb.problem.course, climb.point.coordinates
    law = problem.law
    found = law.values_at(coordinates)
    values = {n: float(v) for n, v in zip(law.names, found, strict=False)}
    variances = np.zeros(problem.size)
    for j, name in enumerate(law.names):
        bare = law.parameters[j % len(law.parameters)]
        if bare in _ELASTIC:
            way = law.presliding_way(values, name[len(bare) :])
            variances[j] = float(np.mean((course.backlash / way) ** 2 + course.gain_std**2))
        elif bare == "sigma1":
            sigma0, sigma1 = np.exp(coordinates[j - 1 : j + 1])
            variances[j] = (float(problem.clock_std.min()) * sigma0 / sigma1) ** 2
    return variances


def _of_noise(
    climb: Climb, pieces: Pieces, inverse: Matrix, white: Vector, prior: Vector
) -> Vector:
    """Variances of coordinates and delays due to force noise and prior spreads."""
    problem = climb.problem
    q = len(pieces.columns)
    weight = problem.weight[0] * white
    variances = np.empty(q)
    for j, arm in enumerate(inverse[:q]):
        own = arm[q:-1].reshape(OWN, -1)
        along = arm[:q] @ pieces.columns
        for k in range(OWN):
            along += own[k][problem.owner] * pieces.own[k]
        variances[j] = weight @ along**2 + prior @ arm**2
    return variances


def _told_of_delays(climb: Climb, pieces: Pieces) -> Vector:
    """Information on each delay from its own records, all parameters free, shape (clocks,).

    It is not used for standard errors: it comes from millinewtons of hysteresis along thousands of
    samples, and no sensor and no law is that accurate.
    """
    course, p = climb.problem.course, climb.problem.size
    weight = climb.problem.weight[0]
    variance = np.zeros(course.clocks)
    for c in range(course.clocks):
        at = np.append(np.arange(p), p + c)
        claimed = np.diag(np.append(climb.prior_std[:p] ** -2, 0.0))
        for r in np.flatnonzero(course.clock == c):
            part = course.parts()[r]
            local, own = pieces.columns[at, part], pieces.own[:, part]
            weighted = own * weight[part]
            alone = weighted @ own.T
            alone[np.diag_indices(OWN)] += climb.prior_std[_of_record(climb, int(r))[-OWN:]] ** -2
            cross = weighted @ local.T
            claimed += (local * weight[part]) @ local.T
            claimed -= cross.T @ np.linalg.solve(alone, cross)
        variance[c] = claimed[p, p] - claimed[p, :p] @ np.linalg.solve(
            claimed[:p, :p], claimed[:p, p]
        )
    return variance


def _intervals(fit: Fit, climb: Climb, fixed: Mapping[str, float]) -> dict[str, Interval]:
    """The interval of each parameter."""
    course = climb.problem.course
    values = fit.law.values_at(fit.coordinates)
    quantile = student.ppf(0.5 + CONFIDENCE / 2, fit.freedom)
    variances = np.diag(fit.covariance)  # may be negative by rounding, if a coordinate is unknown
    errors = np.sqrt(np.where(variances >= 0, variances, np.inf))
    drawn = fit.draws() if fit.law.together else None
    blurred = blurred_elements(fit, course.resolution)
    units = dict(zip(fit.names, fit.law.fitted_units, strict=True))
    intervals = {}
    for j, name in enumerate(fit.names):
        unit, value, error = units[name], float(values[j]), float(errors[j])
        reach = float(quantile[j]) * error
        low: float | None = None
        high: float | None = None
        if j in climb.held:
            given = fixed[name] if name in fixed else fixed[without_direction(name)]
            intervals[name] = Interval(given, unit, 0.0, given, given, "given, held", True)
            continue
        if name == OFFSET:
            narrow = reach <= NARROW * max(abs(value), course.level)
            ends = value - reach, value + reach
            intervals[name] = Interval(value, unit, error, *ends, _FROM_PIECES, narrow)
            continue
        method = _FROM_PIECES
        if hardly_slides(fit, course, name):
            method = "none: a parameter of sliding, but the records have almost no sliding"
        elif peak_unseen(fit, course, name):
            method = "none: a parameter of break-away, but the records show no break-away"
        elif name in blurred:
            method = "none: this element cannot be distinguished from its neighbours"
        elif drawn is not None:
            tail = 50 * (1 - CONFIDENCE)
            low, high = (float(b) for b in np.percentile(drawn[:, j], [tail, 100 - tail]))
            error = float(np.subtract(*np.percentile(drawn[:, j], [84.13, 15.87]))) / 2 / value
            method += ", drawn"
        elif reach < 20.0:  # in logarithms; beyond, there is no bound
            low, high = (value * math.exp(s * reach) for s in (-1, 1))
        error = math.inf if method.startswith("none") else error
        known = value * error if error < 1.0 else None
        narrow = is_narrow(value, low, high)
        intervals[name] = Interval(value, unit, known, low, high, method, narrow)
    return intervals
