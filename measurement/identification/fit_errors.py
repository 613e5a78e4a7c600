"""Standard errors and intervals of a fit, from pieces of the records."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from ...solver.arrays import Matrix, Vector
from .fitted_law import OFFSET, name_and_end
from .identifiability import blurred_elements, hardly_slides, peak_unseen
from .intervals import CONFIDENCE, NARROW, Fit, Interval, is_narrow
from .law_along_record import with_backlash
from .likelihood import OWN, Climb, Told

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
    information, _ = climb.normal()
    p, q = problem.size, problem.shared
    clocks = np.arange(p, q)
    inverse = _inverse(information)
    blind = information.copy()
    blind[clocks, clocks] -= _told_of_delays(climb)
    cautious = _inverse(blind)
    doubt = np.maximum(np.diag(cautious) - np.diag(inverse), 0.0)[:q]
    covariance, freedom = _robust(climb, inverse, climb.prior_std, doubt)
    floor = np.full(p, FLOOR)
    floor[problem.logarithms :] *= course.level
    covariance[np.diag_indices(p)] += floor**2 + _of_sensors(climb)
    predicted = problem.force(climb.vector)
    held_out = predicted.copy()
    for part, told in _each_piece(climb, inverse):  # to first order
        held_out[part] -= (inverse[np.ix_(told.at, told.at)] @ told.slope)[:-1] @ told.local
    fit = Fit(
        law=problem.law,
        coordinates=climb.coordinates,
        delays=climb.delays,
        late=_late(climb, information),
        noise=math.exp(climb.vector[-1]),
        information=_inverse(cautious[:q, :q]),  # unknowns of records and noise are eliminated
        covariance=covariance[:p, :p],
        freedom=freedom[:p],
        predicted=np.where(problem.spoken, predicted, course.force),
        held_out=held_out,
        spoken=problem.spoken,
        hidden=problem.unseen(predicted) + np.mean(climb.errors**2, axis=0),
    )
    return replace(fit, intervals=_intervals(fit, climb, fixed))


def _inverse(matrix: Matrix) -> Matrix:
    """Inverse of an information, of unknowns of very different sizes."""
    size = np.sqrt(np.abs(np.diag(matrix)))  # by rounding, less than nothing may be known
    both = np.outer(size, size)
    return np.asarray(np.linalg.inv(matrix / both) / both, dtype=float)


def _without(matrix: Matrix, kept: int) -> Matrix:
    """Information of the first unknowns if the others are free."""
    cross = matrix[kept:, :kept]
    return np.asarray(matrix[:kept, :kept] - cross.T @ np.linalg.solve(matrix[kept:, kept:], cross))


def _each_piece(climb: Climb, inverse: Matrix) -> Iterator[tuple[slice, Told]]:
    """The samples of each piece, and what it tells if it had not been used in the fit."""
    course = climb.problem.course
    for r, whole in enumerate(course.parts()):
        length = max(10, round(PIECE / course.step[r]))
        for first in range(whole.start, whole.stop, length):
            part = slice(first, min(first + length, whole.stop))
            told = climb.told(r, part)
            used = told.information @ inverse[np.ix_(told.at, told.at)]  # leverage
            slope = np.asarray(np.linalg.solve(np.eye(len(used)) - used, told.slope), dtype=float)
            yield part, told._replace(slope=slope)


def _robust(
    climb: Climb, inverse: Matrix, prior_std: Vector, doubt: Vector
) -> tuple[Matrix, Vector]:
    """Covariance of parameters and delays, and degrees of freedom of each.

    `inverse` is that of the information with this `prior_std`, both of all unknowns; `doubt` are
    least variances of parameters and delays in addition to those of noise and motion.
    """
    problem, course = climb.problem, climb.problem.course
    weight, slope = problem.weight[0], problem.gradient[0]
    q, prior = problem.shared, prior_std**-2
    rows = inverse[:q]
    meat, shares = np.diag(prior), []  # outer products of the pieces' scores; each one's share
    for _, told in _each_piece(climb, inverse):
        meat[np.ix_(told.at, told.at)] += np.outer(told.slope, told.slope)
        arms = rows[:, told.at]
        shares.append(np.einsum("ij,jk,ik->i", arms, told.information, arms))
    robust, share = rows @ meat @ rows.T, np.array(shares)
    effect = np.empty((q, len(course.x)))  # of a sample's weighted error
    whole = rows**2 @ prior
    for r, part in enumerate(course.parts()):  # each entire record as one piece
        effect[:, part] = rows[:, climb.of_record(r)[:-1]] @ climb.columns[:, part]
        whole += (effect[:, part] @ slope[part]) ** 2
    spread = climb.spread(float(climb.vector[-1])) ** 2 + course.resolution**2 / 12
    white = (spread - climb.hidden) / spread
    of_noise = effect**2 @ (weight * white) + rows**2 @ prior
    of_motion = np.mean((effect @ (weight * climb.errors).T) ** 2, axis=1)
    least = of_noise + of_motion + doubt
    scale = np.sqrt(np.maximum(np.maximum(least, whole) / np.diag(robust), 1.0))
    covariance = robust * np.outer(scale, scale)
    short = with_backlash(course.x, course.starts, course.backlash)
    dragged = problem.force(climb.vector, np.stack([short, course.v, course.inertial]))
    covariance[np.diag_indices(q)] += (
        effect @ (weight * (dragged - problem.force(climb.vector)))
    ) ** 2
    # Satterthwaite's degrees of freedom; prior information counts as certain
    known = np.einsum("ij,j,ij->i", rows, prior, rows)
    squares = np.maximum((share**2).sum(axis=0), 1e-300)
    return covariance, np.maximum((share.sum(axis=0) + known) ** 2 / squares, 2.0)


def _late(climb: Climb, information: Matrix) -> tuple[Interval, ...]:
    """Delays by the records alone: one step of the fit, without what was known before [s]."""
    problem, course = climb.problem, climb.problem.course
    clocks = np.arange(problem.size, problem.shared)
    step = course.step[np.unique(course.clock, return_index=True)[1]]
    wide = climb.prior_std.copy()
    wide[clocks] = 25.0 * step  # nothing is known
    less = wide[clocks] ** -2 - problem.clock_std**-2
    free = information.copy()
    free[clocks, clocks] += less
    inverse = _inverse(free)
    delays = climb.delays - inverse[np.ix_(clocks, clocks)] @ (less * climb.delays)
    covariance, freedom = _robust(climb, inverse, wide, np.zeros(problem.shared))
    errors = np.sqrt(np.diag(covariance)[clocks] + (LATE_FLOOR * step) ** 2)
    reach = stdtrit(freedom[clocks], 0.5 + CONFIDENCE / 2) * errors
    return tuple(
        Interval(float(d), "s", float(e), float(d - r), float(d + r), _FROM_PIECES, True)
        for d, e, r in zip(delays, errors, reach, strict=True)
    )


def _of_sensors(climb: Climb) -> Vector:
    """Variances that more records of the same sensors do not reduce, by coordinate.

    The presliding distance has errors of the reconstruction at corners and of the calibration of
    scales, which are the same in all records. Its relative error is that of the stiffness, and is
    larger for stiffer contacts.
    """
    problem, course, law = climb.problem, climb.problem.course, climb.problem.law
    found = law.values_at(climb.coordinates)
    values = {n: float(v) for n, v in zip(law.names, found, strict=False)}
    variances = np.zeros(problem.size)
    for j, name in enumerate(law.names):
        bare, end = name_and_end(name)
        if bare in _ELASTIC:
            way = law.presliding_way(values, end)
            variances[j] = float(np.mean((course.backlash / way) ** 2 + course.gain_std**2))
        elif bare == "sigma1":
            sigma0, sigma1 = np.exp(climb.coordinates[j - 1 : j + 1])
            variances[j] = (float(problem.clock_std.min()) * sigma0 / sigma1) ** 2
    return variances


def _told_of_delays(climb: Climb) -> Vector:
    """Information on each delay from its own records, all parameters free, shape (clocks,).

    It is not used for standard errors: it comes from millinewtons of hysteresis along thousands of
    samples, and no sensor and no law is that accurate.
    """
    course, p, q = climb.problem.course, climb.problem.size, climb.problem.shared
    told = np.zeros(course.clocks)
    for c in range(course.clocks):
        claimed = np.diag(np.append(0.0, climb.prior_std[:p] ** -2))
        at = np.concatenate([[p + c], np.arange(p), q + np.arange(OWN)])
        for r in np.flatnonzero(course.clock == c):
            told_here = climb.told(int(r), course.parts()[r])
            both = told_here.information[np.ix_(at, at)]
            own = np.arange(p + 1, p + 1 + OWN)
            both[own, own] += climb.prior_std[told_here.at[-1 - OWN : -1]] ** -2
            claimed += _without(both, p + 1)
        told[c] = _without(claimed, 1)[0, 0]
    return told


def _intervals(fit: Fit, climb: Climb, fixed: Mapping[str, float]) -> dict[str, Interval]:
    """The interval of each parameter."""
    course = climb.problem.course
    values = fit.law.values_at(fit.coordinates)
    quantile = stdtrit(fit.freedom, 0.5 + CONFIDENCE / 2)
    variances = np.diag(fit.covariance)  # may be negative by rounding, if a coordinate is unknown
    errors = np.sqrt(np.where(variances >= 0, variances, np.inf))
    drawn = fit.draws() if fit.law.together else None
    blurred = blurred_elements(fit, course.resolution)
    intervals = {}
    for j, (name, unit) in enumerate(zip(fit.names, fit.law.fitted_units, strict=True)):
        value, error = float(values[j]), float(errors[j])
        reach = float(quantile[j]) * error
        low: float | None = None
        high: float | None = None
        if j in climb.held:
            given = fixed[name] if name in fixed else fixed[name_and_end(name)[0]]
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
