"""Follow a model and its tangent vectors: the finite-time Lyapunov exponents of its motion."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import core
from .arrays import Matrix, Vector
from .core import at
from .kernel import MAX_STEPS, Model, describe_failure

FARTHEST = 1e6  # times a state's nominal value
APART = 1000.0  # ratio of rates up to which the explicit pair is tried
ZERO = 1e-9  # share of the fastest rate below which a rate counts as zero
Watch = Callable[[float, Vector | None], bool]
"""Called with the time reached by a long computation and its tangents' growth; returns whether
to stop."""
PIECE = 2000  # samples between two calls of the watch
WATCHED = "the computing time is used up"
SLOW = 0.3  # relative change of a collocated tangent in one step


class _TooStiff(Exception):
    """The explicit pair could not follow a motion."""


@dataclass
class Spectrum:
    """The motion and its tangents on a grid of times.

    With all tangents followed, the sum of `growth` is `trace`.
    """

    time: Vector  # shape (m,) [s]; ends early if the motion could not be computed further
    states: Matrix  # shape (m, n)
    growth: Matrix  # shape (m, count): logarithms of the lengths of the tangents [nats]
    # integral of the Jacobian's trace, with the logarithms of the determinants of the events'
    # saltation matrices [nats]
    trace: Vector
    frame: Matrix  # shape (count, n): the orthonormal tangents at the end, a row each
    events: int
    failure: str  # why the motion ends early; empty if it does not
    diverged: bool  # whether it ends early because a state diverged

    @property
    def exponents(self) -> Vector:
        """Finite-time exponents at the end [nats/s], in the order of the tangents.

        NaN if the motion ends before the second time.
        """
        span = self.time[-1] - self.time[0]
        return self.growth[-1] / span if span > 0 else np.full(self.growth.shape[1], np.nan)


def follow_tangents(
    model: Model,
    times: npt.ArrayLike,
    count: int | None = None,
    frame: npt.ArrayLike | None = None,
    farthest: float = FARTHEST,
) -> Spectrum:
    """Follow a model from its present state, and `count` tangents with it.

    A model without modes that is not stiff uses an explicit pair, all others the stiff step.

    Parameters
    ----------
    model : Model
        Its state, inputs and mode are changed.
    times : array_like, shape (m,)
        Rising [s].
    count : int, optional
        Number of tangents, those that shrink slowest first; default: all. A few tangents are
        cheaper than all if the others shrink much faster.
    frame : array_like, shape (count, n), optional
        The tangents at the start, one per row, orthonormal; default: the axes of the
        states. Finite-time exponents depend on them.
    farthest : float
        A state of more than this many times its nominal magnitude counts as diverged.

    Returns
    -------
    Spectrum

    Raises
    ------
    ValueError
        If count or frame do not fit the states, or discrete states or delayed signals
        are not among the states; see `with_held_states` and `with_delay_states`.
    """
    check_all_are_states(model)
    n = len(model.x)
    count = n if count is None else count
    if not 1 <= count <= n:
        raise ValueError(f"{count} tangents, expected 1 to {n}, the number of states")
    rows = np.array(np.eye(n)[:count] if frame is None else frame, dtype=float, order="C")
    if rows.shape != (count, n):
        raise ValueError(f"the frame has the shape {rows.shape}, expected {(count, n)}")
    grid = np.asarray(times, dtype=float)
    if _may_be_explicit(model, float(grid[0])):
        with contextlib.suppress(_TooStiff):
            return _followed(model, grid, rows.copy(), farthest, explicitly=True)
    if count < n:
        return _followed(model, grid, rows, farthest, collocating=True)
    start, held, info = model.x.copy(), model.u.copy(), model.info.copy()
    run = _followed(model, grid, rows.copy(), farthest)
    # The slow ones again, separately, if they are much slower than others that do not vanish.
    mean_step = (run.time[-1] - grid[0]) / max(1.0, model.info[core.ACCEPTED] - info[core.ACCEPTED])
    with np.errstate(invalid="ignore"):
        slow = (np.abs(run.exponents) * mean_step <= SLOW) | np.isneginf(run.exponents)
    leading = int(np.argmin(slow)) if not slow.all() else 0
    if not leading or run.failure:
        return run
    end, last, notes = model.x.copy(), model.u.copy(), model.info.copy()
    model.x[:], model.u[:], model.info[:] = start, held, info
    again = _followed(model, grid, rows[:leading], farthest, collocating=True)
    model.x[:], model.u[:], model.info[:] = end, last, notes
    if again.failure or not np.isfinite(again.growth[-1]).all():  # alone, they lose a direction
        return run
    run.growth[:, :leading] = again.growth
    return run


def check_all_are_states(model: Model) -> None:
    """Reject discrete states and delayed signals, which tangents do not support.

    Raises
    ------
    ValueError
    """
    held = [("discrete state", d.name, "with_held_states") for d in model.kernel.discrete]
    held += [("delayed signal", d.name, "with_delay_states") for d in model.kernel.delays]
    for what, name, change in held:
        fault = f"has the {what} {name}; expected it among the states, by {change}"
        raise ValueError(f"{model.kernel.name} {fault}")


def _may_be_explicit(model: Model, t: float) -> bool:
    """Whether the rates of a model's motion are close enough for an explicit pair.

    The Jacobian is checked at the start of the motion and at the magnitudes of its states on
    either side. At rest exponentials are exact, and no check is needed. A model that was stiff
    once is not checked again.
    """
    kernel = model.kernel
    if kernel.modes or model.stiff:
        return False
    nominal = kernel.nominal
    seen = []
    for shift in (1.0, 0.0, -1.0):
        matrix = model.jacobian(t, model.x + shift * nominal)
        if not np.all(np.isfinite(matrix)):  # outside the range of the equations
            if shift == 0.0:
                return False
            continue
        rates = np.abs(np.linalg.eigvals(matrix))
        moving = rates[rates > ZERO * rates.max()]
        if len(moving) and moving.max() > APART * moving.min():
            model.stiff = True
            return False
        seen.append(matrix)
    return any(np.any(matrix != seen[0]) for matrix in seen)


def _followed(
    model: Model,
    grid: Vector,
    frame: Matrix,
    farthest: float,
    collocating: bool = False,
    explicitly: bool = False,
) -> Spectrum:
    """Follow the tangents in `frame`; raises _TooStiff, with the model unchanged."""
    n, count = len(model.x), len(frame)
    nominal, before = model.kernel.nominal, model.info.copy()
    bound = farthest * nominal
    scale = nominal if explicitly else np.ldexp(1.0, np.round(np.log2(nominal)).astype(int))
    states = np.empty((len(grid), n))
    states[0] = model.x
    growth, trace = np.zeros((len(grid), count)), np.zeros(len(grid))

    def walk(times: Vector, *along: Matrix | Vector) -> int:
        walk = core.Walk(
            len(times),
            count,
            *map(at, (times, *along, frame, model.u, model.p, model.atol)),
            model.tolerance,
            at(bound),
            at(scale),
            MAX_STEPS,
            collocating,
            model.sample_time,
        )
        return model.system.spectrum(walk, explicitly, model.info)

    ended = False
    if model.watch is None or explicitly:
        done = walk(grid, states, growth, trace)
    else:
        done, ended = _watched(model, model.watch, walk, grid, states, growth, trace)
    status = int(model.info[core.STATUS])
    if status == core.NO_MEMORY:
        raise MemoryError(f"{n} states and {count} tangents")
    if explicitly and status not in (core.DONE, core.DIVERGED):
        model.info[:] = before
        raise _TooStiff
    failure, diverged = _failure(model, states[min(done, len(grid) - 1)], grid[-1])
    if ended:
        failure = f"{WATCHED} at t = {grid[done - 1]:.6g} s"
    model.x[:] = states[done - 1]
    rows = grid[:done], states[:done], growth[:done], trace[:done]
    return Spectrum(*rows, frame, int(model.info[core.EVENTS]), failure, diverged)


def _watched(
    model: Model,
    watch: Watch,
    walk: Callable[..., int],
    grid: Vector,
    states: Matrix,
    growth: Matrix,
    trace: Vector,
) -> tuple[int, bool]:
    """Compute over the grid in pieces; return the rows reached, and whether it was stopped."""
    period = model.sample_time
    for row in range(1, len(grid)):
        now = float(grid[row - 1])
        for table in (states, growth, trace):
            table[row] = table[row - 1]
        while now < grid[row]:
            if watch(now, growth[row]):
                return row, True
            ahead = (np.rint(now / period) + PIECE) * period if period else np.inf
            ahead = float(grid[row]) if ahead > grid[row] - 0.5 * period else float(ahead)
            pair = [np.stack([table[row], table[row]]) for table in (states, growth, trace)]
            reached = walk(np.array([now, ahead]), *pair)
            states[row], growth[row], trace[row] = (both[1] for both in pair)
            if reached < 2:
                return row, False
            now = ahead
    return len(grid), False


def _failure(model: Model, state: Vector, end: float) -> tuple[str, bool]:
    """Why the last call did not reach its end, or empty, and whether the state diverged."""
    kernel, status = model.kernel, int(model.info[core.STATUS])
    if status == core.DONE:
        return "", False
    if status != core.DIVERGED:
        return describe_failure(kernel.name, status, model.info, end), False
    size = np.abs(state) / kernel.nominal
    worst = kernel.states[int(np.argmax(np.nan_to_num(size, nan=np.inf)))].name
    reached = model.info[core.REACHED]
    return f"{kernel.name} diverges: {worst} exceeds its bound at t = {reached:.6g} s", True


@dataclass(frozen=True)
class Returns:
    """Points at which a motion crossed a plane upwards."""

    time: Vector  # shape (k,) [s]
    states: Matrix  # shape (k, n)
    low: Vector  # shape (n,): least values of the states during the motion
    high: Vector  # shape (n,): largest values
    end: float  # the time that was reached [s]
    failure: str  # why it ended early; empty if it did not
    diverged: bool


def follow_returns(
    model: Model, start: float, stop: float, coordinate: int, level: float, most: int
) -> Returns:
    """Follow a model from `start` to `stop` [s], or until it crossed a plane `most` times.

    Parameters
    ----------
    model : Model
        Its state and mode are changed.
    coordinate, level : int, float
        The plane: where this state has this value.
    most : int
        0: no plane is searched, and steps are as long as the tolerance allows.

    A sampled system is checked from sample to sample: its crossings are the first samples beyond
    the plane, with the states before the update.

    Raises
    ------
    ValueError
        If discrete states or delayed signals are not among the states; see `with_held_states`
        and `with_delay_states`.
    """
    check_all_are_states(model)
    n = len(model.x)
    if model.watch is not None and model.watch(start, None):
        here = model.x.copy()
        none = np.empty(0), np.empty((0, n))
        return Returns(*none, here, here, start, f"{WATCHED} at t = {start:.6g} s", False)
    bound = FARTHEST * model.kernel.nominal
    times, states = np.empty(most), np.empty((most, n))
    low, high = np.empty(n), np.empty(n)
    crossings = core.Crossings(
        start,
        stop,
        *map(at, (model.x, model.u, model.p, model.atol)),
        model.tolerance,
        at(bound),
        MAX_STEPS,
        coordinate,
        level,
        most,
        *map(at, (times, states, low, high)),
        model.sample_time,
    )

    found = -1
    if _may_be_explicit(model, start):
        state, before = model.x.copy(), model.info.copy()
        found = model.system.returns(crossings, True, model.info)
        if int(model.info[core.STATUS]) not in (core.DONE, core.DIVERGED):
            model.x[:], model.info[:] = state, before
            found = -1
    if found < 0:
        found = model.system.returns(crossings, False, model.info)
    failure, diverged = _failure(model, model.x, stop)
    reached = float(model.info[core.REACHED])
    return Returns(times[:found], states[:found], low, high, reached, failure, diverged)
