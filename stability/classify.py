"""The one rule by which a motion is classified, for single loops and for the cells of maps.

A verdict is based on the motion and on its exponents, never on one of them alone: a spectrum with
a zero may be a line of equilibria, a cycle, or a run that was too short.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..solver.arrays import Vector
from ..solver.core import ACCEPTED, EVENTS, REACHED
from ..solver.kernel import IntegrationError, Model
from ..solver.spectrum import Returns, follow_returns
from .attractor import (
    EXPONENTS,
    LONGER_RUN,
    Attractor,
    Kind,
    ended,
    listed,
    listed_rates,
    over_nominal,
    ranges,
)
from .cycles import cycle_of, unclosed
from .equilibria import (
    Equilibrium,
    equilibrium_near,
    sample_after,
    stands,
    unchanged,
    with_round_off,
)

SETTLED = 1e-7  # nominal magnitudes: a smaller distance from an equilibrium counts as zero
RESOLVED = 100.0  # tolerances: a smaller distance from an equilibrium has no certain direction
NEAR = 100.0  # nominal magnitudes: largest distance of an equilibrium that a motion may fall to
PATIENCE = 20_000  # most steps of the solver for the approach to it
BRIEF, RADIAN = 2000, 100  # of them in a map: so many, and for each radian by which it turns
ROUNDS = 8
LONGER = 4.0  # ratio of the lengths of two successive rounds
FOLLOWED, CREPT = 90.0, 22.0  # longest times of undecided and creeping motions in a map, in runs
MOST_STEPS = 500_000  # of the solver; after them, a cell is not followed any longer
BUDGET = (
    f"budget of a cell: its motion is continued for {FOLLOWED:g} run lengths ({CREPT:g} if it "
    f"creeps), or until its solver has taken {MOST_STEPS} steps"
)
MOST_SAMPLES = 100_000  # of a sampled loop, which cannot take longer steps at rest
FEW, CROSSINGS = 12, 64  # returns: a cycle that closes early needs few
BORDER = 1e-2  # share of an event's indicator: below it, the event is near
PATIENT = 3  # most checks of many returns whose distances still shrink or grow
CREEP = 0.7  # largest share of the range of a creep in the first sixteenth of the time
ONE_WAY = 0.99  # share of its range that a state has to move, if it moves in one direction
STEADY = 1.5  # largest ratio of the later swing of a bounded motion to the earlier one


def classify_attractor(
    model: Model,
    time: float,
    span: float,
    exponents: bool = True,
    rounds: int = ROUNDS,
    earlier: Vector | None = None,
    brief: bool = False,
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
        Number of checks for rest or a cycle, each `LONGER` times as long as the one before.
    earlier : ndarray, shape (n,), optional
        A state of the motion before: the side from which it comes to a rest that it has reached.
    brief : bool
        Whether to end with the `BUDGET` of a cell, which computes exponents only where returns do
        not close.
    """
    run, aligned = span, sample_after(model, time)
    if aligned > time:
        seen = follow_returns(model, time, aligned, 0, np.inf, 0)
        if seen.failure:
            return ended(seen.failure, seen.diverged, seen.end)
        time = aligned
    so_far: Attractor | None = None
    looks, limits = 0, exponents
    for number in range(rounds + 1):
        until = time + MOST_SAMPLES * model.sample_time if model.sample_time else np.inf
        span = min(span, (until - time) / 4.25)
        resting = _resting(model, time, until, span, limits, earlier)
        if resting is not None:
            return resting
        if so_far and (number == rounds or (brief and _spent(model, time, run, so_far))):
            return so_far
        # the plane that it crosses: the widest state, the middle of its range
        seen = follow_returns(model, time, time + 0.25 * span, 0, np.inf, 0)
        if seen.failure:
            return ended(seen.failure, seen.diverged, seen.end, so_far)
        coordinate = int(np.argmax((seen.high - seen.low) / model.kernel.nominal))
        plane = coordinate, float(0.5 * (seen.high + seen.low)[coordinate])
        start, end = seen.end, min(seen.end + 4.0 * span, until)
        for most in (FEW, CROSSINGS):
            events = model.info[EVENTS]
            passes = follow_returns(model, start, end, *plane, most)
            if passes.failure:
                return ended(passes.failure, passes.diverged, passes.end, so_far)
            cycle = cycle_of(model, passes, plane, limits)
            if cycle is not None:
                return cycle
            if len(passes.time) < most:
                break
            start = passes.end
        time = passes.end
        if len(passes.time) < CROSSINGS or _one_way(passes):
            slides = int(model.info[EVENTS] - events)
            before, so_far = so_far, _restless(model, time, seen, passes, slides, so_far)
            if before and before.kind is Kind.CREEPING and so_far.kind is Kind.UNDECIDED:
                so_far = before  # a creep stays one unless it becomes something else
        elif limits:
            looks += 1
            so_far, time, moving = unclosed(model, passes, plane)
            if not moving or looks == PATIENT:
                return so_far
        else:
            so_far = _without_exponents(model, passes)
            if not brief or so_far.kind is not Kind.UNDECIDED:
                return so_far
            time = float(model.info[REACHED])
        limits = exponents or so_far.would_decide == EXPONENTS
        span *= LONGER
    raise AssertionError("a round ends with a verdict")


def _spent(model: Model, time: float, run: float, so_far: Attractor) -> bool:
    """Whether the budget of a cell with runs of this length is used up."""
    runs = CREPT if so_far.kind is Kind.CREEPING else FOLLOWED
    return bool(time >= runs * run or model.info[ACCEPTED] >= MOST_STEPS)


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
    still creeps when it hardly moves any more. A model with modes sticks, it does not creep. `seen`
    is a sixteenth of the checked time, `passes` the rest with its number of `events`; `before` is
    the previous verdict, over a quarter of the time.
    """
    amplitude = ranges(model, passes)
    text = f"no rest and {len(passes.time)} returns, none of them periodic, until t = {time:.4g} s"
    undecided = Attractor(Kind.UNDECIDED, text, LONGER_RUN, amplitude=amplitude)
    if len(passes.time) >= FEW:
        return undecided
    if model.kernel.modes:
        winding = _winding(model, time, (passes.end - seen.end) / 16.0) if events < FEW else ""
        text = f"{winding}; in total there were {events} events; {text}"
        return replace(undecided, kind=Kind.WINDING, evidence=text) if winding else undecided
    nominal = model.kernel.nominal
    way = (passes.high - passes.low) / nominal
    share = float(way.max())
    early = float(((seen.high - seen.low) / nominal)[np.argmax(way)])
    slower = False
    if before is not None and before.kind is Kind.CREEPING:
        slower = share <= 2.0 * max(over_nominal(model, before.amplitude).values())
    creeping = share < 1.0 and (early < CREEP * share or slower)
    if not creeping or equilibrium_near(model, time) is None:
        return undecided
    text += (
        f"; during this time it stays near equilibria and moves by {share:.2g} nominal magnitudes "
        f"at most, by {early:.2g} in the first sixteenth of the time"
    )
    return replace(undecided, kind=Kind.CREEPING, evidence=text)


def _winding(model: Model, time: float, span: float) -> str:
    """Text on states that are constant over `span` while another moves in one direction, or empty.

    The model is not changed.
    """
    state, mode, events = model.x.copy(), model.mode, model.info[EVENTS]
    with unchanged(model):
        onward = follow_returns(model, time, sample_after(model, time + span), 0, np.inf, 0)
        moved, quiet = model.x - state, model.info[EVENTS] == events
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
    """The verdict on returns that do not close; exponents do not help for quantized loops."""
    text = f"{len(passes.time)} returns until t = {passes.end:.4g} s that do not close"
    amplitude = ranges(model, passes)
    if not model.kernel.quantized:
        return Attractor(Kind.UNDECIDED, text, EXPONENTS, amplitude=amplitude)
    longer = LONGER * (passes.end - float(passes.time[0]))
    onward = follow_returns(model, passes.end, passes.end + longer, 0, np.inf, 0)
    if onward.failure:
        return ended(onward.failure, onward.diverged, onward.end)
    after = ranges(model, onward)
    over = over_nominal(model, after)
    wide = max(over, key=over.__getitem__)
    share = after[wide] / amplitude[wide] if amplitude[wide] else np.inf
    text += (
        f"; over {LONGER:g} times as long again {wide} swings by {after[wide]:.4g} to either side, "
        f"{share:.3g} times as large as before"
    )
    if share <= STEADY:
        return Attractor(Kind.BOUNDED, text, amplitude=after)
    return Attractor(Kind.UNDECIDED, text, LONGER_RUN, amplitude=after)


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
    turns = float(np.abs(before.eigenvalues.imag).max()) * wait
    patience = PATIENCE if exponents else int(min(PATIENCE, BRIEF + RADIAN * turns))
    moved = _moved(model, time, wait, patience) and model.info[EVENTS] == events
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


def _moved(model: Model, time: float, wait: float, patience: int) -> bool:
    """Move the model on by `wait`; return whether this was possible."""
    if model.sample_time:
        return not follow_returns(model, time, time + wait, 0, np.inf, 0).failure
    try:
        model.advance(time, time + wait, patience)
    except IntegrationError:
        return False
    return True


def _rest(
    model: Model, found: Equilibrium, time: float, wait: float, distance: float, left: float
) -> Attractor:
    names = [s.name for s in model.kernel.states]
    where = listed([f"{n} = {v:.6g}" for n, v in zip(names, found.state, strict=True)])
    text = (
        f"at t = {time:.4g} s it is {left:.2g} nominal magnitudes from the equilibrium {where}, "
        f"after {distance:.2g} of them {wait:.3g} s before; the eigenvalues there are "
        f"{listed_rates(found.eigenvalues, '1/s')}"
    )
    if found.neutral:
        some = "direction is" if found.neutral == 1 else "directions are"
        text += f"; {found.neutral} {some} neutral: every point along it is an equilibrium"
    return Attractor(
        Kind.LINE if found.neutral else Kind.FIXED_POINT,
        text,
        equilibrium=found,
        limit=found.eigenvalues.real.copy(),
        limit_error=np.zeros(len(names)) if found.error is None else found.error,
    )
