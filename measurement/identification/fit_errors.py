"""Standard errors and intervals of a fit, from pieces of the records."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from .fit_result import DRAWN, Fit, draw_coordinates, fitted_names, without_direction
from .fitted_law import BRISTLES, OFFSET
from .intervals import CONFIDENCE, NARROW, Interval, is_narrow
from .law_along_record import with_backlash
from .optimizer import OWN, Climb, Pieces
from .unseen_parameters import blurred_elements, hardly_slides, peak_unseen, presliding_way

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

PIECE = 1.0  # length of pieces taken as independent [s]
_NO_BOUND = 20.0  # half-width in logarithms beyond which an interval is unbounded
# Smallest standard error of a logarithm: errors by counts and by smoothing between samples have
# this size on records of the closed-loop rig, and more data do not reduce them.
FLOOR = 2e-3
# The same of a delay, in sampling intervals: friction at a reversal depends on the time in it.
LATE_FLOOR = 0.25
_LATEST = 25.0  # prior standard deviation of a delay of which nothing is known, in the same
# Parameters whose relative error is at most that of the presliding distance
_ELASTIC = ("sigma0", "sigma", "alpha", "eps_f", "k1", "k2", "k3", "k4")
_FROM_PIECES = "maximum likelihood, errors from pieces of the records"


def sum_up(climb: Climb, cost: float) -> Fit:
    problem, point = climb.problem, climb.point
    course = problem.course
    pieces = climb.normal(point)
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
    # unknowns of single records and the noise are eliminated
    kept = _inverse(cautious[:q, :q])
    names, units = fitted_names(problem.law, problem.tied)
    return Fit(
        law=problem.law,
        tied=problem.tied,
        names=names,
        units=units,
        coordinates=point.coordinates,
        delays=point.delays,
        late=_late(climb, pieces),
        shifts=point.shifts,
        noise=math.exp(point.noise),
        cost=cost,
        information=kept,
        covariance=covariance[:p, :p],
        freedom=freedom[:p],
        predicted=np.where(problem.spoken, climb.force(point), course.force),
        spoken=problem.spoken,
        hidden=problem.unseen(climb.force(point)) + np.mean(climb.errors**2, axis=0),
    )


def _inverse(matrix: Matrix) -> Matrix:
    """Inverse of an information, of unknowns of very different sizes."""
    size = np.sqrt(np.diag(matrix))
    both = np.outer(size, size)
    return np.asarray(np.linalg.inv(matrix / both) / both, dtype=float)


def _robust(
    climb: Climb, pieces: Pieces, inverse: Matrix, prior_std: Vector, doubt: Vector
) -> tuple[Matrix, Vector]:
    """Covariance of parameters and delays, and degrees of freedom of each.

    Parameters
    ----------
    climb : Climb
    pieces : Pieces
    inverse : ndarray, shape (unknowns, unknowns)
        Of the information.
    prior_std : ndarray, shape (unknowns,)
        Contained in the information.
    doubt : ndarray, shape (parameters and delays,)
        Least variances in addition to those of noise and motion.
    """
    problem, course = climb.problem, climb.problem.course
    q, prior = len(pieces.columns), prior_std**-2
    rows = inverse[:q]
    meat, share = _from_pieces(climb, pieces, inverse, prior)
    robust = rows @ meat @ rows.T
    rounding = course.resolution**2 / 12
    spread = climb.spread(climb.point) ** 2 + rounding
    white = (spread - climb.hidden) / spread
    moved = [rows @ climb.pull(pieces, problem.weight[0] * e) for e in climb.errors]
    of_motion = np.mean(np.square(moved), axis=0)
    whole = rows**2 @ prior
    short = with_backlash(course.x, course.starts, course.backlash)
    more = climb.force_on(np.stack([short, course.v, course.inertial])) - climb.force(climb.point)
    rounded = (rows @ climb.pull(pieces, problem.weight[0] * more)) ** 2
    least = _of_noise(climb, pieces, inverse, white, prior) + of_motion + doubt
    for r in range(course.records):  # each entire record as one piece
        part = slice(course.starts[r], course.starts[r + 1])
        own_places = q + r + course.records * np.arange(OWN)
        at = np.concatenate([np.arange(q), own_places])
        local = np.vstack([pieces.columns[:, part], pieces.own[:, part]])
        whole += (rows[:, at] @ (local @ problem.gradient[0, part])) ** 2
    scale = np.sqrt(np.maximum(np.maximum(least, whole) / np.diag(robust), 1.0))
    covariance = robust * np.outer(scale, scale)
    covariance[np.diag_indices(q)] += rounded
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
    wide[clocks] = _LATEST * step
    less = wide[clocks] ** -2 - problem.clock_std**-2
    free = pieces.information.copy()
    free[clocks, clocks] += less
    inverse = _inverse(free)
    delays = climb.point.delays - inverse[np.ix_(clocks, clocks)] @ (less * climb.point.delays)
    covariance, freedom = _robust(climb, pieces, inverse, wide, np.zeros(len(pieces.columns)))
    errors = np.sqrt(np.diag(covariance)[clocks] + (LATE_FLOOR * step) ** 2)
    reach = student.ppf(0.5 + CONFIDENCE / 2, freedom[clocks]) * errors
    return tuple(
        Interval(float(d), "s", float(e), float(d - r), float(d + r), _FROM_PIECES, True)
        for d, e, r in zip(delays, errors, reach, strict=True)
    )


def _from_pieces(
    climb: Climb, pieces: Pieces, inverse: Matrix, prior: Vector
) -> tuple[Matrix, Matrix]:
    """Sum of the outer products of the pieces' scores, and each piece's share.

    The score of a piece depends on the global unknowns and on those of one record.
    """
    problem = climb.problem
    course = problem.course
    columns, own, noisy = pieces.columns, pieces.own, pieces.noisy
    q = len(columns)
    meat = np.diag(prior)
    shares: list[Vector] = []
    for r in range(course.records):
        begin, end = int(course.starts[r]), int(course.starts[r + 1])
        length = max(10, round(PIECE / course.step[r]))
        own_places = q + r + course.records * np.arange(OWN)
        at = np.concatenate([np.arange(q), own_places, [len(inverse) - 1]])
        for first in range(begin, end, length):
            part = slice(first, min(first + length, end))
            weight, gradient = problem.weight[:, part], problem.gradient[:, part]
            local = np.vstack([columns[:, part], own[:, part]])
            block = np.empty((len(at), len(at)))
            block[:-1, :-1] = (local * weight[0]) @ local.T
            block[:-1, -1] = block[-1, :-1] = local @ (weight[1] * noisy[part])
            block[-1, -1] = weight[2] @ noisy[part] ** 2
            said = np.append(local @ gradient[0], gradient[1] @ noisy[part])
            # leverage: the score of the piece if it had not been used in the fit
            said = np.linalg.solve(np.eye(len(at)) - block @ inverse[np.ix_(at, at)], said)
            meat[np.ix_(at, at)] += np.outer(said, said)
            arms = inverse[:q][:, at]
            shares.append(np.einsum("ij,jk,ik->i", arms, block, arms))
    return meat, np.array(shares)


def _of_sensors(climb: Climb) -> Vector:
    """Variances that more records of the same sensors do not reduce, by coordinate.

    The presliding distance has errors of the reconstruction at corners and of the calibration of
    scales, which are the same in all records. Its relative error is that of the stiffness, and is
    larger for stiffer contacts.
    """
    problem, course = climb.problem, climb.problem.course
    law = problem.law
    fitted, _ = fitted_names(law, problem.tied)
    found = law.values_at(climb.point.coordinates)
    values = {n: float(v) for n, v in zip(fitted, found, strict=True)}
    variances = np.zeros(problem.size)
    for j, name in enumerate(fitted[: problem.of_law]):
        bare = law.parameters[j % len(law.parameters)]
        if bare in _ELASTIC:
            way = presliding_way(law, values, name[len(bare) :])
            variances[j] = float(np.mean((course.backlash / way) ** 2 + course.gain_std**2))
        elif bare == "sigma1" and law.name in BRISTLES:
            sigma0, sigma1 = np.exp(climb.point.coordinates[j - 1 : j + 1])
            variances[j] = (float(problem.clock_std.min()) * sigma0 / sigma1) ** 2
    return variances


def _of_noise(
    climb: Climb, pieces: Pieces, inverse: Matrix, white: Vector, prior: Vector
) -> Vector:
    """Variances of coordinates and delays due to force noise and prior spreads."""
    problem = climb.problem
    q = len(pieces.columns)
    owner, records = problem.owner, problem.course.records
    weight = problem.weight[0] * white
    variances = np.empty(q)
    for j in range(q):
        arm = inverse[j]
        own = arm[q : q + OWN * records].reshape(OWN, records)
        along = arm[:q] @ pieces.columns
        for k in range(OWN):
            along += own[k][owner] * pieces.own[k]
        variances[j] = weight @ along**2 + prior @ arm**2
    return variances


def _told_of_delays(climb: Climb, pieces: Pieces) -> Vector:
    """Information on each delay from its own records, all parameters free, shape (clocks,).

    It is not used for standard errors: it comes from millinewtons of hysteresis along thousands of
    samples, and no sensor and no law is that accurate.
    """
    problem = climb.problem
    course, p = problem.course, problem.size
    told = np.zeros(course.clocks)
    for c in range(course.clocks):
        at = np.append(np.arange(p), p + c)
        claimed = np.diag(np.append(climb.prior_std[:p] ** -2, 0.0))
        for r in np.flatnonzero(course.clock == c):
            part = slice(course.starts[r], course.starts[r + 1])
            local, own = pieces.columns[at, part], pieces.own[:, part]
            weighted = own * problem.weight[0, part]
            alone = weighted @ own.T
            first = p + course.clocks + r
            places = first + course.records * np.arange(OWN)
            alone[np.diag_indices(OWN)] += climb.prior_std[places] ** -2
            cross = weighted @ local.T
            claimed += (local * problem.weight[0, part]) @ local.T
            claimed -= cross.T @ np.linalg.solve(alone, cross)
        told[c] = claimed[p, p] - claimed[p, :p] @ np.linalg.solve(claimed[:p, :p], claimed[:p, p])
    return told


def intervals_of(fit: Fit, climb: Climb, fixed: Mapping[str, float]) -> dict[str, Interval]:
    values = fit.law.values_at(fit.coordinates)
    quantile = student.ppf(0.5 + CONFIDENCE / 2, fit.freedom)
    variances = np.diag(fit.covariance)  # may be negative by rounding, if a coordinate is unknown
    errors = np.sqrt(np.where(variances >= 0, variances, np.inf))
    drawn = draw_coordinates(fit) if fit.law.name in DRAWN else None
    blurred = blurred_elements(fit, climb.problem.course.resolution)
    intervals = {}
    for j, name in enumerate(fit.names):
        value, error = float(values[j]), float(errors[j])
        reach = float(quantile[j]) * error
        low: float | None
        high: float | None
        if j in climb.held:
            given = fixed[name] if name in fixed else fixed[without_direction(name)]
            held = Interval(given, fit.units[j], 0.0, given, given, "given, held", True)
            intervals[name] = held
            continue
        if name == OFFSET:
            intervals[name] = Interval(
                value,
                fit.units[j],
                error,
                value - reach,
                value + reach,
                _FROM_PIECES,
                reach <= NARROW * max(abs(value), climb.problem.course.level),
            )
            continue
        if hardly_slides(fit, climb.problem.course, name):
            low, high, error = None, None, math.inf
            method = "none: a parameter of sliding, but the records have almost no sliding"
        elif peak_unseen(fit, climb.problem.course, name):
            low, high, error = None, None, math.inf
            method = "none: a parameter of break-away, but the records show no break-away"
        elif name in blurred:
            low, high, error = None, None, math.inf
            method = "none: this element cannot be distinguished from its neighbours"
        elif drawn is not None:
            tail = 50 * (1 - CONFIDENCE)
            low, high = (float(b) for b in np.percentile(drawn[:, j], [tail, 100 - tail]))
            error = float(np.subtract(*np.percentile(drawn[:, j], [84.13, 15.87]))) / 2 / value
            method = _FROM_PIECES + ", drawn"
        else:
            known = reach < _NO_BOUND
            low, high = (value * math.exp(s * reach) if known else None for s in (-1, 1))
            method = _FROM_PIECES
        intervals[name] = Interval(
            value=value,
            unit=fit.units[j],
            standard_error=value * error if error < 1.0 else None,
            low=low,
            high=high,
            method=method,
            identified=is_narrow(value, low, high),
        )
    return intervals
