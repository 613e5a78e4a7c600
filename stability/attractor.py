"""Long-term motion: rest, a cycle, a torus, chaos, or divergence; with the evidence.

A verdict is based on the motion and on its exponents, never on one of them alone: a
spectrum with a zero may be a line of equilibria, a cycle, or a run that was too short.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from ..solver.core import EVENTS
from ..solver.kernel import IntegrationError, Model
from ..solver.spectrum import Returns, Spectrum, follow_returns, follow_tangents
from .equilibria import (
    Equilibrium,
    equilibrium_near,
    is_driven,
    sample_after,
    stands,
    with_round_off,
)

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

SETTLED = 1e-7  # nominal magnitudes: a smaller distance from an equilibrium counts as zero
RESOLVED = 100.0  # tolerances: a smaller distance from an equilibrium has no certain direction
NEAR = 100.0  # nominal magnitudes: largest distance of an equilibrium that a motion may fall to
PATIENCE = 20_000  # steps of the solver for the approach to it
ROUNDS = 8
MOST_SAMPLES = 100_000  # of a sampled loop, which cannot take longer steps at rest
LONGER = 4.0  # ratio of the lengths of two successive rounds
LONGEST_CYCLE, LONGEST_OF_MANY = 8, 100  # largest numbers of returns in one period
FEW, CROSSINGS = 12, 64
CLOSED = 1e-3  # share of the size of a motion: a smaller remaining distance counts as closed
NOISE = 3e3  # times the tolerance: states one period apart count as equal
BORDER = 1e-2  # share of an event's indicator: below it, the event is near
ZERO = 1e-3  # nats in a period: less is no growth of a cycle
GROWING = 0.05  # nats in a period: with more growth there is no cycle, even if states close
LISTED = 14  # most listed states and eigenvalues
MANY = 400  # returns needed to distinguish a torus from a long cycle
WIDE = 2.0  # nats over a run: with a larger error, a sum of exponents is not called zero
TINY = 1e-6  # nats over a run: round-off
STEADY_RETURNS = 1.03  # largest change of distances between returns that count as constant
BLOCKS = 240  # parts of a run over which exponents are averaged
PATIENT = 3  # most checks of many returns whose distances still shrink or grow
CREEP = 0.7  # largest share of the range of a creep in the first sixteenth of the time
ONE_WAY = 0.99  # share of its range that a state has to move, if it moves in one direction
STEADY = 1.5  # largest ratio of the later swing of a bounded motion to the earlier one
CERTAIN = 4.0  # standard errors
STUDENT = 2.07  # standard errors of 24 blocks in half of a 95 % interval
ASIDE = 0.37  # of a period after a return: away from it and from half a period, where events are
SLOWEST = 1.0 - 1e-3  # share of a distance that is left after a period: more is no shrinking
SHARPER = 0.01  # of the tolerance, for the exponents of a cycle


# values of `would_decide`
LONGER_RUN, EXPONENTS = "a longer run", "the exponents"
OTHER_SOLVER = "a solver that can continue beyond this point"


class Kind(StrEnum):
    """Long-term motion."""

    FIXED_POINT = "isolated fixed point"
    LINE = "stuck on a line of equilibria"
    REST = "at rest"
    CYCLE = "limit cycle"
    TORUS = "torus"
    CHAOS = "chaos"
    DIVERGES = "diverges"
    CREEPING = "creeping along equilibria"
    BOUNDED = "bounded motion of a quantized loop"
    UNDECIDED = "undecided"
    WINDING = "stuck while an integral winds up"


@dataclass(frozen=True)
class Attractor:
    """A verdict on a motion.

    Attributes
    ----------
    kind : Kind
    evidence : str
        One or two sentences with the numbers on which the verdict is based.
    would_decide : str
        If undecided: what would allow a decision.
    equilibrium : Equilibrium or None
        The equilibrium at rest.
    period : float or None
        Of a cycle [s].
    amplitude : dict of str to float
        Half the range of each state in the cycle, or in the last part of the motion.
    return_error : float or None
        Distance between states one period apart, over the motion's size.
    since : float or None
        Time of the divergence [s].
    limit : ndarray, shape (count,), or None
        The exponents' limits [nats/s], largest first.
    limit_error : ndarray, shape (count,), or None
        Half of a 95 % interval for each [nats/s]: of eigenvalues from round-off in the Jacobian,
        over whole periods of a cycle from two halves and the distance to the orbit, in chaos from
        the scatter of blocks; and three times the change by a tenth of the tolerance, if larger.
    """

    kind: Kind
    evidence: str
    would_decide: str = ""
    equilibrium: Equilibrium | None = None
    period: float | None = None
    amplitude: dict[str, float] = field(default_factory=dict)
    return_error: float | None = None
    since: float | None = None
    limit: Vector | None = None
    limit_error: Vector | None = None


def classify_attractor(
    model: Model,
    time: float,
    span: float,
    exponents: bool = True,
    rounds: int = ROUNDS,
    earlier: Vector | None = None,
) -> Attractor:
    """Continue a model from its present state and classify its long-term motion.

    Parameters
    ----------
    model : Model
        Its state and mode are changed.
    time : float
        The present [s].
    span : float
        Duration of the motion so far; cycles are searched over the same time again [s].
    exponents : bool
        Whether to compute also the limits of the exponents. Without them a torus and chaos cannot
        be distinguished and are undecided.
    rounds : int
        Number of further checks for rest or a cycle, each `LONGER` times as long.
    earlier : ndarray, shape (n,), optional
        A state of the motion before: the side from which it comes to a rest that it has reached.
    """
    aligned = sample_after(model, time)
    if aligned > time:
        seen = follow_returns(model, time, aligned, 0, np.inf, 0)
        if seen.failure:
            return _run_away(seen) if seen.diverged else _broken(seen)
        time = aligned
    until = time + MOST_SAMPLES * model.sample_time if model.sample_time else np.inf
    span = min(span, (until - time) / 4.25)
    so_far: Attractor | None = None
    looks = 0
    for _ in range(rounds):
        resting = _resting(model, time, until, span, exponents, earlier)
        if resting is not None:
            return resting
        coordinate, level, seen = _plane(model, time, 0.25 * span)
        if seen.failure:
            return _ended(seen, so_far)
        end = min(seen.end + 4.0 * span, until)
        start = seen.end
        for most in (FEW, CROSSINGS):  # a cycle that closes early needs few returns
            events = model.info[EVENTS]
            passes = follow_returns(model, start, end, coordinate, level, most)
            if passes.failure:
                return _ended(passes, so_far)
            cycle = _cycle(model, passes, (coordinate, level), exponents)
            if cycle is not None:
                return cycle
            if len(passes.time) < most:
                break
            start = passes.end
        time = passes.end
        if len(passes.time) == CROSSINGS and not _one_way(passes):
            if not exponents:
                return _without_exponents(model, passes)
            looks += 1
            so_far, time, moving = _unclosed(model, passes, coordinate, level)
            if not moving or looks == PATIENT:
                return so_far
        else:
            slides = int(model.info[EVENTS] - events)
            so_far = _restless(model, time, seen, passes, slides, so_far)
        span = min(LONGER * span, (until - time) / 4.25)
        if time >= until - 10.0 * model.sample_time:
            break
    return _resting(model, time, until, span, exponents, earlier) or so_far or _broken(seen)


def _ended(passes: Returns, so_far: Attractor | None) -> Attractor:
    """The verdict if the solver cannot continue: divergence, or the result until then."""
    if passes.diverged:
        return _run_away(passes)
    if so_far is None:
        return _broken(passes)
    return replace(so_far, evidence=f"{so_far.evidence}; beyond that, {passes.failure}")


def _restless(
    model: Model,
    time: float,
    seen: Returns,
    passes: Returns,
    events: int,
    before: Attractor | None,
) -> Attractor:
    """The verdict without rest or a cycle: creep, sticking with integrator windup, or undecided.

    A creep needs all of the time for its range, a cycle does not. A motion that was found to creep
    still creeps when it hardly moves any more. A model with modes sticks, it does not creep.

    Parameters
    ----------
    seen, passes : Returns
        Of a sixteenth of the checked time, and of the rest.
    events : int
        Number of events during `passes`.
    before : Attractor or None
        The previous verdict, over a quarter of the time.
    """
    amplitude = _ranges(model, passes)
    nominal = model.kernel.nominal
    way = (passes.high - passes.low) / nominal
    text = f"no rest and {len(passes.time)} returns, none of them periodic, until t = {time:.4g} s"
    undecided = Attractor(Kind.UNDECIDED, text, LONGER_RUN, amplitude=amplitude)
    if len(passes.time) >= FEW:
        return undecided
    if model.kernel.modes:
        winding = _winding(model, time, (passes.end - seen.end) / 16.0) if events < FEW else ""
        text = f"{winding}; in total there were {events} events; {text}"
        return replace(undecided, kind=Kind.WINDING, evidence=text) if winding else undecided
    share = float(way.max())
    early = float(((seen.high - seen.low) / nominal)[np.argmax(way)])
    slower = False
    if before is not None and before.kind is Kind.CREEPING:
        slower = share <= 2.0 * max(a / _nominal(model, n) for n, a in before.amplitude.items())
    creeping = share < 1.0 and (early < CREEP * share or slower)
    if not creeping or equilibrium_near(model, time) is None:
        return undecided
    text += (
        f"; during this time it stays near equilibria and moves by {share:.2g} nominal magnitudes "
        "at "
        f"most, by {early:.2g} in the first sixteenth of the time"
    )
    return replace(undecided, kind=Kind.CREEPING, evidence=text)


def _winding(model: Model, time: float, span: float) -> str:
    """Text on states that are constant over `span` while another moves in one direction, or empty.

    The model is not changed.
    """
    state, held, info = model.x.copy(), model.u.copy(), model.info.copy()
    onward = follow_returns(model, time, sample_after(model, time + span), 0, np.inf, 0)
    moved, mode, quiet = model.x - state, model.mode, model.info[EVENTS] == info[EVENTS]
    model.x[:], model.u[:], model.info[:] = state, held, info
    range_ = onward.high - onward.low
    widest = int(np.argmax(range_ / model.kernel.nominal))
    one_way = abs(moved[widest]) > ONE_WAY * range_[widest] > 0.0
    names = np.array([s.name for s in model.kernel.states])
    still = names[range_ == 0.0]
    goes = names[(range_ > 0.0) & (np.abs(moved) > ONE_WAY * range_)]
    if onward.failure or not quiet or not len(still) or not one_way:
        return ""
    rate = moved[widest] / (onward.end - time)
    return (
        f"at t = {time:.4g} s it is in mode {mode!r}: {', '.join(still)} are constant, while "
        f"{', '.join(goes)} move in one direction, {names[widest]} by {rate:.3g} per second"
    )


def _one_way(passes: Returns) -> bool:
    """Whether the state that differs most between the returns moves in one direction only.

    It does while a swing approaches or leaves a cycle or rest, even slowly. On a torus or in chaos
    it moves in both directions. Finite-time exponents are not needed to distinguish the two cases.
    """
    size = passes.high - passes.low
    size[size == 0.0] = np.inf
    most = int(np.argmax(np.ptp(passes.states, axis=0) / size))
    steps = np.diff(passes.states[:, most])
    return bool(np.all(steps > 0.0) or np.all(steps < 0.0))


def _without_exponents(model: Model, passes: Returns) -> Attractor:
    text = f"{len(passes.time)} returns until t = {passes.end:.4g} s that do not close"
    amplitude = _ranges(model, passes)
    if not model.kernel.quantized:
        return Attractor(Kind.UNDECIDED, text, EXPONENTS, amplitude=amplitude)
    # Exponents do not help for quantized loops: only the size of the motion is known.
    longer = LONGER * (passes.end - float(passes.time[0]))
    onward = follow_returns(model, passes.end, passes.end + longer, 0, np.inf, 0)
    if onward.failure:
        return _run_away(onward) if onward.diverged else _broken(onward)
    after = _ranges(model, onward)
    wide = max(after, key=lambda n: after[n] / _nominal(model, n))
    share = after[wide] / amplitude[wide] if amplitude[wide] else np.inf
    text += (
        f"; over {LONGER:g} times as long again {wide} swings by {after[wide]:.4g} to either side, "
        f"{share:.3g} times as large as before"
    )
    kind = Kind.BOUNDED if share <= STEADY else Kind.UNDECIDED
    return Attractor(kind, text, "" if kind is Kind.BOUNDED else LONGER_RUN, amplitude=after)


def _resting(
    model: Model,
    time: float,
    until: float,
    span: float,
    exponents: bool,
    earlier: Vector | None,
) -> Attractor | None:
    """Rest, if the motion is near an equilibrium and falls towards it as expected; else None.

    Over three time constants of the slowest eigenvalue, the distance has to shrink to a fifth, or
    to round-off if the mode ends at the equilibrium. The equilibrium must not move by more than
    that distance in future; along a line it moves less and less, as the distance shrinks.
    Neutral directions must not drift by more than that distance over `span`. The time must not move
    the equilibrium either: a mass that sticks until its force swings back is in motion.
    """
    nominal = model.kernel.nominal
    before = equilibrium_near(model, time)
    if before is None or before.slowest > 0.0:
        return None
    if before.slowest == 0.0 and before.neutral < len(nominal):
        return None  # it neither falls nor grows: the linear part is not sufficient
    distance = float(np.max(np.abs(model.x - before.state) / nominal))
    wait = 3.0 / -before.slowest if before.slowest < 0.0 else 1.0
    if model.sample_time:  # states that vanish in few samples need up to one sample per state
        wait = max(wait, len(nominal) * model.sample_time)
        wait = sample_after(model, time + wait) - time
    if distance > NEAR or time + wait > until:
        return None
    state, held, events = model.x.copy(), model.u.copy(), model.info[EVENTS]
    moved = _moved(model, time, wait) and model.info[EVENTS] == events
    found = equilibrium_near(model, time + wait) if moved else None
    if found is not None and found.slowest <= 0.0:
        left = float(np.max(np.abs(model.x - found.state) / nominal))
        shift = float(np.max(np.abs(found.state - before.state) / nominal))
        stays = found.drift * span <= max(left, SETTLED)
        falls = left <= 0.2 * distance and not _ends_there(model, time + wait, found.state)
        near = falls or left <= SETTLED
        within = 2.0 * max(distance, SETTLED)
        share = left / distance if left < distance else 1.0
        quiet = near and stays and (shift <= within or shift * share <= within * (1.0 - share))
        if quiet and stands(model, time + wait, span, found.state, within):
            if exponents:  # not in maps, which have many cells
                side = None if distance > RESOLVED * model.tolerance else earlier
                found = with_round_off(model, time + wait, found, side)
            return _rest(model, found, time + wait, wait, distance, left)
    model.x[:], model.u[:] = state, held
    return None


def _ends_there(model: Model, time: float, state: Vector) -> bool:
    """Whether the present mode ends at the state that the motion approaches.

    The motion may then not reach it: a body that slides towards a place where its friction would
    hold it turns back or sticks before.
    """
    there, here = np.zeros(model.kernel.events), np.zeros(model.kernel.events)
    model.system.indicate(time, state, model.u, model.p, there)
    model.system.indicate(time, model.x, model.u, model.p, here)
    return bool(np.any(np.abs(there) < BORDER * np.abs(here)))


def _moved(model: Model, time: float, wait: float) -> bool:
    """Move the model on by `wait`; return whether this was possible."""
    if model.sample_time:
        return not follow_returns(model, time, time + wait, 0, np.inf, 0).failure
    try:
        model.advance(time, time + wait, PATIENCE)
    except IntegrationError:
        return False
    return True


def _rest(
    model: Model, found: Equilibrium, time: float, wait: float, distance: float, left: float
) -> Attractor:
    names = [s.name for s in model.kernel.states]
    line = found.neutral > 0
    where = _listed([f"{n} = {v:.6g}" for n, v in zip(names, found.state, strict=True)])
    text = (
        f"at t = {time:.4g} s it is {left:.2g} nominal magnitudes from the equilibrium {where}, "
        f"after {distance:.2g} of them {wait:.3g} s before; the eigenvalues there are "
        + _listed([_complex(v) for v in found.eigenvalues])
        + " 1/s"
    )
    if line:
        some = "direction is" if found.neutral == 1 else "directions are"
        text += f"; {found.neutral} {some} neutral: every point along it is an equilibrium"
    return Attractor(
        Kind.LINE if line else Kind.FIXED_POINT,
        text,
        equilibrium=found,
        limit=found.eigenvalues.real.copy(),
        limit_error=np.zeros(len(names)) if found.error is None else found.error,
    )


def _listed(texts: list[str]) -> str:
    """The first `LISTED` texts and the number of the others: nodes along delays are many."""
    rest = len(texts) - LISTED
    return ", ".join(texts[:LISTED]) + (f" and {rest} more" if rest > 0 else "")


def _complex(value: complex) -> str:
    whole = np.isfinite(value.real) and value.imag
    return f"{value.real:.4g}" + (f"{value.imag:+.4g}i" if whole else "")


def _plane(model: Model, time: float, span: float) -> tuple[int, float, Returns]:
    """A plane that the motion crosses: the widest state, the middle of its range, the motion."""
    nominal = model.kernel.nominal
    seen = follow_returns(model, time, time + span, 0, np.inf, 0)
    widest = int(np.argmax((seen.high - seen.low) / nominal))
    return widest, float(0.5 * (seen.high + seen.low)[widest]), seen


def _run_away(passes: Returns) -> Attractor:
    return Attractor(Kind.DIVERGES, passes.failure, since=passes.end)


def _broken(passes: Returns) -> Attractor:
    return Attractor(Kind.UNDECIDED, passes.failure, OTHER_SOLVER)


def _ranges(model: Model, passes: Returns) -> dict[str, float]:
    names = [s.name for s in model.kernel.states]
    return dict(zip(names, (0.5 * (passes.high - passes.low)).tolist(), strict=True))


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


def _cycle(
    model: Model,
    passes: Returns,
    plane: tuple[int, float],
    exponents: bool,
    longest: int = LONGEST_CYCLE,
) -> Attractor | None:
    """A cycle, if states one period apart approach each other faster than the motion decays.

    If there is none, the model is not changed. `plane`: coordinate and level of the returns.
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
    plane: tuple[int, float],
    lag: int,
    period: float,
    error: float,
    exponents: bool,
) -> Attractor | None:
    """The cycle with its numbers; None if its exponents show that it closed by chance."""
    amplitude = _ranges(model, once)
    wide = max(amplitude, key=lambda n: amplitude[n] / _nominal(model, n))
    text = (
        f"states {period:.6g} s apart ({lag} return{'s' if lag > 1 else ''}) differ by {error:.2g} "
        f"of the motion's size, {wide} swings by {amplitude[wide]:.4g} to either side"
    )
    if not exponents:
        return Attractor(Kind.CYCLE, text, period=period, amplitude=amplitude, return_error=error)
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
    alone = _alone(model, float(grid[-1]), period)
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
    text += f"; over whole periods the exponents are {', '.join(f'{v:.4g}' for v in limit)} nats/s"
    kind, would = Kind.CYCLE, ""
    if zeros < alone:
        kind, would = Kind.UNDECIDED, LONGER_RUN
        text += "; none of them is zero, as one along the orbit has to be: it is not reached yet"
    elif zeros > alone and limit[0] <= zero:
        kind = Kind.UNDECIDED
        text += (
            f"; {zeros} cannot be distinguished from zero: the orbit is closed but may be one "
            "of a family"
        )
        would = "whether a disturbed motion returns to the same orbit"
    return Attractor(
        kind,
        text,
        would,
        period=period,
        amplitude=amplitude,
        return_error=error,
        limit=limit,
        limit_error=limit_error,
    )


def _nominal(model: Model, name: str) -> float:
    return next(s.nominal for s in model.kernel.states if s.name == name)


def _starts_of_periods(
    model: Model, start: float, most: float, plane: tuple[int, float], lag: int, count: int
) -> tuple[Vector, float]:
    """Times of one phase, away from events; distance of states between the first two, over size.

    A period is from return to return: with a period that is hardly wrong, all phases drift, and
    exponents change where rates change fast. The model is moved on to the first of the times.
    """
    kept = model.x.copy(), model.u.copy(), model.info.copy()
    seen = follow_returns(model, start, most, *plane, count * lag)
    model.x[:], model.u[:], model.info[:] = kept
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


def _unclosed(
    model: Model, passes: Returns, coordinate: int, level: float
) -> tuple[Attractor, float, bool]:
    """The verdict on returns without a short period: a long cycle, a torus, or chaos.

    Periods of up to a hundred returns are tried. Exponents alone do not show a torus: the distances
    between returns must also be constant, for each number of returns between them. If a motion
    approaches a cycle they change, even while its slow exponent still looks like zero.

    Returns
    -------
    Attractor, the end of the checked time [s], and whether distances shrink or grow
    """
    between = float(np.mean(np.diff(passes.time)))
    more = follow_returns(
        model, passes.end, passes.end + 2.0 * MANY * between, coordinate, level, MANY
    )
    if more.failure:
        return _ended(more, None), more.end, False
    cycle = _cycle(model, more, (coordinate, level), True, LONGEST_OF_MANY)
    if cycle is not None:
        return cycle, more.end, False
    if len(more.time) < MANY:
        return _no_more_returns(model, more, passes.end)
    amplitude = _ranges(model, more)
    grid = more.end + between * (20.0 + MANY * np.arange(BLOCKS + 1) / BLOCKS)
    settle = follow_tangents(model, np.array([more.end, grid[0]]))
    run = follow_tangents(model, grid, frame=settle.frame)
    end = float(run.time[-1])
    if run.failure:
        kind = Kind.DIVERGES if run.diverged else Kind.UNDECIDED
        would = "" if run.diverged else OTHER_SOLVER
        since = end if run.diverged else None
        return Attractor(kind, run.failure, would, since=since), end, False
    again = follow_returns(model, end, end + 2.0 * MANY * between, coordinate, level, MANY)
    if again.failure:
        return _ended(again, None), again.end, False
    if len(again.time) < MANY:
        return _no_more_returns(model, again, end)
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
    common = {"amplitude": amplitude, "limit": limit, "limit_error": bars}
    if chaotic:
        return Attractor(Kind.CHAOS, text, **common), again.end, False
    moving = drifts or change > STEADY_RETURNS
    neutral, unsure = _neutral(run)
    if moving:
        text += (
            ("; returns that are whole periods apart move in the same direction") if drifts else ""
        )
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
    elif _alone(model, end, between) < neutral < len(limit):
        text += f"; the first {neutral} add up to zero"
        return Attractor(Kind.TORUS, text, **common), again.end, False
    else:
        would = LONGER_RUN
    return Attractor(Kind.UNDECIDED, text, would, **common), again.end, moving


def _no_more_returns(model: Model, passes: Returns, before: float) -> tuple[Attractor, float, bool]:
    """The result for a motion without further returns, see `_unclosed`; it may come to rest."""
    text = f"its returns end at t = {passes.time[-1] if passes.time.size else before:.4g} s"
    undecided = Attractor(Kind.UNDECIDED, text, LONGER_RUN, amplitude=_ranges(model, passes))
    return undecided, passes.end, True


def _alone(model: Model, time: float, period: float) -> int:
    """Number of exponents that are always zero: 1 for the direction of time, 0 if driven."""
    return int(model.sample_time == 0.0 and not is_driven(model, time, period))


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
    rates = _rates(run)
    limit, error = _weighted(rates)
    order = np.argsort(-limit)
    known = np.where(np.isfinite(rates).all(axis=0), rates, 0.0)[:, order]
    blocks = known.reshape(24, -1, len(order)).mean(axis=1)
    return limit[order], error[order], blocks.std(axis=0, ddof=1) / np.sqrt(24)


def _rates(run: Spectrum) -> Matrix:
    with np.errstate(invalid="ignore"):
        return np.asarray(np.diff(run.growth, axis=0) / np.diff(run.time)[:, None])


def _neutral(run: Spectrum) -> tuple[int, bool]:
    """Number of exponents that are zero, and whether this is uncertain.

    Sums of the first exponents are tested: volumes turn with the motion less than lengths, so that
    their growth is known better. A sum is zero if it is within its own error and this is small.
    """
    span = float(run.time[-1] - run.time[0])
    rates = _rates(run)
    rates = rates[:, np.argsort(-_weighted(rates)[0])]
    total, error = (span * part for part in _weighted(np.cumsum(rates, axis=1)))
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
