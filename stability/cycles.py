"""Motions that return: cycles, tori and chaos, by their returns to a plane and their exponents."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..solver.arrays import Matrix, Vector
from ..solver.kernel import Model
from ..solver.spectrum import Returns, Spectrum, follow_returns, follow_tangents
from .attractor import (
    CLOSED,
    LONGER_RUN,
    Attractor,
    Kind,
    ended,
    listed_rates,
    over_nominal,
    ranges,
)
from .equilibria import is_driven, unchanged

Plane = tuple[int, float]
"""A state and its level at the returns."""

LONGEST_CYCLE, LONGEST_OF_MANY = 8, 100  # largest numbers of returns in one period
NOISE = 3e3  # times the tolerance: states one period apart count as equal
ZERO = 1e-3  # nats in a period: less is no growth of a cycle
GROWING = 0.05  # nats in a period: with more growth there is no cycle, even if states close
MANY = 400  # returns needed to distinguish a torus from a long cycle
WIDE = 2.0  # nats over a run: with a larger error, a sum of exponents is not called zero
TINY = 1e-6  # nats over a run: round-off
STEADY_RETURNS = 1.03  # largest change of distances between returns that count as constant
BLOCKS = 240  # parts of a run over which exponents are averaged
CERTAIN = 4.0  # standard errors
STUDENT = 2.07  # standard errors of 24 blocks in half of a 95 % interval
ASIDE = 0.37  # of a period after a return: away from it and from half a period, where events are
SLOWEST = 1.0 - 1e-3  # share of a distance that is left after a period: more is no shrinking
SHARPER = 0.01  # of the tolerance, for the exponents of a cycle


def closings(
    states: Matrix, size: Vector, noise: float, longest: int = LONGEST_CYCLE
) -> Iterator[tuple[int, float]]:
    """Yield each number of returns after which states close, and their distance over the size.

    Parameters
    ----------
    states : ndarray, shape (returns, n)
    size : ndarray, shape (n,)
        Ranges of the motion.
    noise : float
        Largest difference of equal states, as a share of these ranges.
    longest : int
        Largest number of returns in one period.
    """
    count = len(states)
    for lag in range(1, longest + 1):
        if count < 3 * lag + 1:
            return
        same_phase = states[count - 1 - 3 * lag :: lag] / size
        new, old, older = np.abs(np.diff(same_phase, axis=0)).max(axis=1)[::-1]
        if new > noise:
            # the sum of all later distances, if they continue to shrink by this share
            share = new / old
            shrinking = share < 1.0 and old < older
            if new > CLOSED or not shrinking or new * share / (1.0 - share) > CLOSED:
                continue
        yield lag, float(new)


def cycle_of(
    model: Model, passes: Returns, plane: Plane, exponents: bool, longest: int = LONGEST_CYCLE
) -> Attractor | None:
    """A cycle, if states one period apart approach each other faster than the motion decays.

    If there is none, the model is not changed.
    """
    size = passes.high - passes.low
    size[size <= model.atol] = np.inf  # at rest, or a decay without end
    if np.isinf(size).all():
        return None
    kept = model.x.copy(), model.u.copy(), model.info.copy()
    for lag, error in closings(passes.states, size, NOISE * model.tolerance, longest):
        period = float(passes.time[-1] - passes.time[-1 - lag])
        once = follow_returns(model, passes.end, passes.end + 1.5 * period, 0, np.inf, 1)
        wide = once.high - once.low
        share = np.abs(wide - size)[np.isfinite(size)] / size[np.isfinite(size)]
        if not once.failure and np.max(share) <= 0.5:  # else its size has changed since
            closed = _closed(model, once, plane, lag, period, error, exponents)
            if closed is not None:
                return closed
        model.x[:], model.u[:], model.info[:] = kept
        if once.failure:
            return None
    return None


def _closed(
    model: Model,
    once: Returns,
    plane: Plane,
    lag: int,
    period: float,
    error: float,
    exponents: bool,
) -> Attractor | None:
    """The cycle with its numbers; None if its exponents show that it closed by chance."""
    amplitude = ranges(model, once)
    over = over_nominal(model, amplitude)
    wide = max(over, key=over.__getitem__)
    text = (
        f"states {period:.6g} s apart ({lag} return{'s' if lag > 1 else ''}) differ by {error:.2g} "
        f"of the motion's size, {wide} swings by {amplitude[wide]:.4g} to either side"
    )
    cycle = Attractor(Kind.CYCLE, text, period=period, amplitude=amplitude, return_error=error)
    if not exponents:
        return cycle
    # a period of many returns is long: fewer periods are sufficient
    periods = 12 if lag <= LONGEST_CYCLE else 4
    count = 2 * periods + 1
    most = once.end + 2.0 * count * period
    grid, apart = _starts_of_periods(model, once.end, most, plane, lag, count)
    if not len(grid):
        return None
    limit, limit_error = _over_periods(model, grid)
    order = np.argsort(-limit)
    limit, limit_error = limit[order], limit_error[order]
    if not limit[0] * period <= GROWING:  # also if the exponents are not known (NaN)
        return None
    alone = _always_zero(model, float(grid[-1]), period)
    others = np.delete(limit, np.argmin(np.abs(limit))) if alone else limit
    left = np.exp(others.max(initial=-np.inf) * period)  # share of a distance after a period
    if error > NOISE * model.tolerance and not error * left < CLOSED * (1.0 - left):
        return None  # states are close by chance: they do not become equal
    # halves differ by less than what is left, if the distance shrinks slowly
    limit_error = limit_error / (1.0 - min(left, SLOWEST) ** (periods // 2)) + apart / period
    zero = ZERO / period
    nearest = np.abs(limit).min()
    if alone and nearest <= zero:  # along the orbit it is zero: what it is not is an error of all
        limit_error = np.maximum(limit_error, nearest)
    zeros = int(np.sum(np.abs(limit) <= np.maximum(limit_error, zero)))
    text += f"; over whole periods the exponents are {listed_rates(limit, 'nats/s')}"
    kind, would = Kind.CYCLE, ""
    if zeros < alone:
        kind, would = Kind.UNDECIDED, LONGER_RUN
        text += "; none of them is zero, as one along the orbit has to be: it is not reached yet"
    elif zeros > alone and limit[0] <= zero:
        kind, would = Kind.UNDECIDED, "whether a disturbed motion returns to the same orbit"
        text += f"; {zeros} cannot be distinguished from zero: the orbit is closed but may be one "
        text += "of a family"
    found = replace(cycle, kind=kind, evidence=text, would_decide=would)
    return replace(found, limit=limit, limit_error=limit_error)


def _starts_of_periods(
    model: Model, start: float, most: float, plane: Plane, lag: int, count: int
) -> tuple[Vector, float]:
    """Times of one phase, away from events; distance of states between the first two, over size.

    A period is from return to return: with a period that is hardly wrong, all phases drift, and
    exponents change where rates change fast. The model is moved on to the first of the times.
    """
    with unchanged(model):
        seen = follow_returns(model, start, most, *plane, count * lag)
    if seen.failure or len(seen.time) < count * lag:
        return np.empty(0), np.inf
    grid = seen.time[::lag] + ASIDE * (seen.time[lag] - seen.time[0])
    size = seen.high - seen.low
    size[size == 0.0] = np.inf
    follow_returns(model, start, float(grid[0]), 0, np.inf, 0)
    return grid, float(np.max(np.abs(seen.states[lag] - seen.states[0]) / size))


def _over_periods(model: Model, grid: Vector) -> tuple[Vector, Vector]:
    """Exponents over the second half of some whole periods, and the difference of its halves."""
    # with a law that changes very fast, exponents need a smaller tolerance than the motion
    usual = model.tolerance, model.atol
    model.tolerance, model.atol = SHARPER * usual[0], SHARPER * usual[1]
    periods = len(grid) // 2
    frame = _along(model, float(grid[0]))
    settle = follow_tangents(model, grid[: periods + 1], frame=frame)
    again = follow_tangents(model, grid[periods:], frame=settle.frame)
    model.tolerance, model.atol = usual
    half = periods // 2
    growth, time = again.growth, again.time - again.time[0]
    if len(time) <= periods:
        none = np.full(growth.shape[1], np.nan)
        return none, none
    # a direction that has vanished has minus infinity everywhere
    first = growth[half] / time[half]
    with np.errstate(invalid="ignore"):
        second = (growth[-1] - growth[half]) / (time[-1] - time[half])
        error = np.where(np.isfinite(first + second), np.abs(first - second), 0.0)
    return np.asarray(growth[-1] / time[-1]), error


def _along(model: Model, time: float) -> Matrix:
    """A frame whose first tangent is the direction of the motion; the others are random.

    The first one neither grows nor shrinks over a period. An axis of the states may be a shrinking
    direction, such as the position when the velocity changes its sign. It would stay the first
    tangent until round-off turns it, possibly during the measured periods.
    """
    nominal = model.kernel.nominal
    directions = np.random.default_rng(1).normal(size=(len(nominal), len(nominal) + 1))
    directions *= nominal[:, None]
    rate = model.derivatives(time, model.x)
    if np.any(rate) and np.isfinite(rate).all():
        directions[:, 0] = rate
    return np.ascontiguousarray(np.linalg.qr(directions)[0].T)


def unclosed(model: Model, passes: Returns, plane: Plane) -> tuple[Attractor, float, bool]:
    """The verdict on returns without a short period: a long cycle, a torus, or chaos.

    Periods of up to a hundred returns are tried. Exponents alone do not show a torus: the distances
    between returns must also be constant, for each number of returns between them. If a motion
    approaches a cycle they change, even while its slow exponent still looks like zero.

    Returns
    -------
    Attractor, the end of the checked time [s], and whether distances shrink or grow
    """
    between = float(np.mean(np.diff(passes.time)))

    def many_from(start: float) -> Returns:
        return follow_returns(model, start, start + 2.0 * MANY * between, *plane, MANY)

    def too_few(seen: Returns, before: float) -> tuple[Attractor, float, bool]:
        """If the motion cannot be followed, or returns no more: it may come to rest."""
        if seen.failure:
            return ended(seen.failure, seen.diverged, seen.end), seen.end, False
        text = f"its returns end at t = {seen.time[-1] if seen.time.size else before:.4g} s"
        undecided = Attractor(Kind.UNDECIDED, text, LONGER_RUN, amplitude=ranges(model, seen))
        return undecided, seen.end, True

    more = many_from(passes.end)
    cycle = None if more.failure else cycle_of(model, more, plane, True, LONGEST_OF_MANY)
    if cycle is not None:
        return cycle, more.end, False
    if len(more.time) < MANY:
        return too_few(more, passes.end)
    grid = more.end + between * (20.0 + MANY * np.arange(BLOCKS + 1) / BLOCKS)
    settle = follow_tangents(model, np.array([more.end, grid[0]]))
    run = follow_tangents(model, grid, frame=settle.frame)
    end = float(run.time[-1])
    if run.failure:
        return ended(run.failure, run.diverged, end), end, False
    again = many_from(end)
    if len(again.time) < MANY:
        return too_few(again, end)
    change, drifts = _change(more, again)
    limit, error, scatter = _limits(run)
    small = 1.0 / (run.time[-1] - run.time[0])  # one nat over the run
    chaotic = limit[0] > max(CERTAIN * scatter[0], 5.0 * small)
    bars = np.maximum(STUDENT * scatter if chaotic else error, small)
    values = ", ".join(f"{a:.4g} +- {b:.2g}" for a, b in zip(limit, bars, strict=True))
    text = (
        f"{MANY} returns, of which none up to {LONGEST_OF_MANY} apart close; distances between "
        f"them change by a factor of up to {change:.4g} until {2 * MANY} returns later; over "
        f"another {MANY} of them the exponents are {values} nats/s"
    )
    common = {"amplitude": ranges(model, more), "limit": limit, "limit_error": bars}
    if chaotic:
        return Attractor(Kind.CHAOS, text, **common), again.end, False
    moving = drifts or change > STEADY_RETURNS
    neutral, unsure = _neutral(run)
    would = LONGER_RUN
    if moving:
        if drifts:
            text += "; returns that are whole periods apart move in the same direction"
        would = "a longer run, in which the returns have converged"
    elif unsure:
        would = "more accurate exponents: the number of zero exponents is not certain"
    elif model.sample_time and neutral == 1 and len(limit) > 1:
        # A map between samples has no direction of time: its only zero is the cycle's phase.
        between = float(np.mean(np.diff(more.time)))
        text += (
            f"; it is a cycle whose period, {between:.6g} s on average, no sampling period divides"
        )
        return Attractor(Kind.CYCLE, text, period=between, **common), again.end, False
    elif _always_zero(model, end, between) < neutral < len(limit):
        text += f"; the first {neutral} add up to zero"
        return Attractor(Kind.TORUS, text, **common), again.end, False
    return Attractor(Kind.UNDECIDED, text, would, **common), again.end, moving


def _always_zero(model: Model, time: float, period: float) -> int:
    """Number of exponents that are always zero: 1 for the direction of time, 0 if driven."""
    return int(model.sample_time == 0.0 and not is_driven(model, time, period))


def _rates(run: Spectrum) -> tuple[Matrix, npt.NDArray[np.intp]]:
    """Growth rates of the blocks, and the order of their means, largest first."""
    with np.errstate(invalid="ignore"):
        rates = np.diff(run.growth, axis=0) / np.diff(run.time)[:, None]
    return rates, np.argsort(-_weighted(rates)[0])


def _weighted(rates: Matrix) -> tuple[Vector, Vector]:
    """Means over time, and the difference of both halves; minus infinity for vanished directions.

    The means are weighted by a bump function, which removes the random effect of the ends: for a
    motion with a few frequencies they converge faster than any power of time (S. Das, Y. Saiki,
    E. Sander, J. A. Yorke, Nonlinearity 30, 4111 (2017)).
    """

    def mean(part: Matrix) -> Vector:
        place = (np.arange(len(part)) + 0.5) / len(part)
        weight = np.exp(-1.0 / (place * (1.0 - place)))
        return np.asarray(weight @ part / weight.sum())

    known = np.isfinite(rates).all(axis=0)
    rates = np.where(known, rates, 0.0)
    half = len(rates) // 2
    apart = np.abs(mean(rates[:half]) - mean(rates[half:]))
    return np.where(known, mean(rates), -np.inf), np.where(known, apart, 0.0)


def _limits(run: Spectrum) -> tuple[Vector, Vector, Vector]:
    """Limits of exponents, largest first; differences of both halves; standard errors.

    Chaos stays random: standard errors are from the scatter of 24 blocks.
    """
    rates, order = _rates(run)
    limit, error = _weighted(rates)
    known = np.where(np.isfinite(rates).all(axis=0), rates, 0.0)[:, order]
    blocks = known.reshape(24, -1, len(order)).mean(axis=1)
    return limit[order], error[order], blocks.std(axis=0, ddof=1) / np.sqrt(24)


def _neutral(run: Spectrum) -> tuple[int, bool]:
    """Number of exponents that are zero, and whether this is uncertain.

    Sums of the first exponents are tested: volumes turn with the motion less than lengths, so that
    their growth is known better. A sum is zero if it is within its own error and this is small.
    """
    span = float(run.time[-1] - run.time[0])
    rates, order = _rates(run)
    sums = _weighted(np.cumsum(rates[:, order], axis=1))
    total, error = (span * part for part in sums)
    for count, (nats, off) in enumerate(zip(total, error, strict=True)):
        if abs(nats) > CERTAIN * off + TINY:
            return count, False
        if CERTAIN * off > WIDE:
            return count, True
    return len(total), False


def _change(first: Returns, second: Returns) -> tuple[float, bool]:
    """Factor by which distances between returns change, and whether returns drift one way.

    The factor is the largest of the medians for each number of returns between a pair. On a torus,
    later returns fill the same curve; on the way to a cycle, pairs that are whole periods apart
    come closer. In a sampled loop, some returns come one sample later: this hardly affects medians.
    """
    size = first.high - first.low
    size[size == 0.0] = np.inf
    before, after = first.states / size, second.states / size
    widest = int(np.argmax(np.ptp(before, axis=0)))
    largest = 1.0
    for lag in range(1, LONGEST_OF_MANY + 1):
        near, far = (
            float(np.median(np.linalg.norm(s[lag:] - s[:-lag], axis=1))) for s in (before, after)
        )
        if near > 0.0 and far > 0.0:
            largest = max(largest, near / far, far / near)
        elif near != far:
            largest = np.inf
        if 10 * lag <= len(before):  # all pairs: on a closed curve, some move back
            signs = np.sign(before[lag:, widest] - before[:-lag, widest])
            if all(np.all(signs[k::lag] * signs[k] > 0.0) for k in range(lag)):
                return largest, True
    return largest, False
