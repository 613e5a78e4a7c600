"""Follow a model and its tangent vectors: the finite-time Lyapunov exponents of its motion."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import explicit, kernel_cache, propagation, stepper, tangents
from .kernel import MAX_STEPS, Kernel, Model, describe_failure

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

RUNAWAY = 1e6  # times a state's nominal value
APART = 1000.0  # ratio of rates up to which the explicit pair is tried
ZERO = 1e-9  # share of the fastest rate below which one is none

_FOOTER = """

if MOST_EVENTS:
    noting = build_noting(rhs, react, slopes, {states}, {parameters})
    integrate, settle_events = build(rhs, jac, indicate, kind, noting, MOST_EVENTS)
_spectrum = build_spectrum(rhs, jac, integrate, settle_events)
_returns = build_returns(integrate)
walk, integrate_explicitly = build_explicit(rhs, jac, {states})
_explicit_returns = build_returns(integrate_explicitly)


@njit(cache=True, error_model="numpy")
def spectrum(
    times, X, L, trace, u, p, atol, rtol, work, info, max_steps, bound, scale, frame, jumps,
    collocating, scratch
):
    return _spectrum(
        times, X, L, trace, u, p, atol, rtol, work, info, max_steps, bound, scale, frame, jumps,
        collocating, scratch
    )


@njit(cache=True, error_model="numpy")
def returns(
    t0, t1, x, u, p, atol, rtol, work, info, max_steps, bound, coordinate, level, times, states,
    low, high
):
    return _returns(
        t0, t1, x, u, p, atol, rtol, work, info, max_steps, bound, coordinate, level, times,
        states, low, high
    )


@njit(cache=True, error_model="numpy")
def explicit_spectrum(
    times, X, L, trace, u, p, atol, rtol, work, info, max_steps, bound, scale, frame
):
    count, n = frame.shape
    w = np.empty(n + count * n)
    for i in range(n):
        w[i] = X[0, i]
        for j in range(count):
            w[(j + 1) * n + i] = frame[j, i]
    for row in range(1, times.shape[0]):
        for j in range(count):
            L[row, j] = L[row - 1, j]
        trace[row] = trace[row - 1] + walk(
            times[row - 1], times[row], w, L[row], u, p, atol, rtol, work, info, max_steps, bound,
            scale
        )
        for i in range(n):
            X[row, i] = w[i]
            for j in range(count):
                frame[j, i] = w[(j + 1) * n + i]
        if info[STATUS] != DONE:
            return row
    return times.shape[0]


@njit(cache=True, error_model="numpy")
def explicit_returns(
    t0, t1, x, u, p, atol, rtol, work, info, max_steps, bound, coordinate, level, times, states,
    low, high
):
    return _explicit_returns(
        t0, t1, x, u, p, atol, rtol, work, info, max_steps, bound, coordinate, level, times,
        states, low, high
    )
"""


@dataclass
class Spectrum:
    """The motion and its tangents on a grid of times.

    Attributes
    ----------
    time : ndarray, shape (m,)
        [s]; ends early where the motion could not be followed.
    states : ndarray, shape (m, n)
    growth : ndarray, shape (m, count)
        Logarithms of the lengths of the orthonormalized tangents since the start [nats].
    trace : ndarray, shape (m,)
        Integral of the trace of the Jacobian over time, with the logarithms of the determinants of
        the events' saltation matrices [nats]: with all tangents followed, the sum of `growth`.
    frame : ndarray, shape (count, n)
        The orthonormal tangents at the end, a row each.
    events : int
        Events met.
    failure : str
        Why the motion ends early; empty if it does not.
    ran_away : bool
        Whether it ends early because a state left every bound.
    """

    time: Vector
    states: Matrix
    growth: Matrix
    trace: Vector
    frame: Matrix
    events: int
    failure: str
    ran_away: bool

    @property
    def exponents(self) -> Vector:
        """Finite-time exponents at the end [nats/s], in the order of the tangents."""
        span = self.time[-1] - self.time[0]
        return self.growth[-1] / span if span > 0 else np.zeros(self.growth.shape[1])


@cache
def _functions(module: str, source: str, states: int, parameters: int) -> Any:
    files = (tangents.__file__, explicit.__file__)
    added = "\n\n".join(Path(f).read_text(encoding="utf-8") for f in files)
    # these names stand in the module already
    own = r"^from \.(stepper|tangents) import (\([^)]*\)|.*)$"
    added = re.sub(own, "", added, flags=re.MULTILINE)
    added = added.replace("from .propagation", f"from {propagation.__name__}")
    shared = hashlib.sha256(Path(propagation.__file__).read_bytes()).hexdigest()
    text = "\n\n".join([source, added, f"# with {shared}"])
    text += _FOOTER.format(states=states, parameters=parameters)
    name = f"tangents_{module}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    return kernel_cache.load(name, text)


def functions(kernel: Kernel) -> Any:
    """The module with the compiled tangents of a kernel."""
    return _functions(kernel.module, kernel.source, len(kernel.states), len(kernel.parameters))


def follow(
    model: Model,
    times: npt.ArrayLike,
    count: int | None = None,
    frame: npt.ArrayLike | None = None,
    runaway: float = RUNAWAY,
) -> Spectrum:
    """Follow a model from its present state, and `count` tangents with it.

    What has no modes and is not stiff is followed by an explicit pair, all else by the stiff step.

    Parameters
    ----------
    model : Model
        Its state, inputs and mode are moved on.
    times : array_like, shape (m,)
        Rising [s].
    count : int, optional
        How many tangents, the slowest to shrink first; all if left out. Few are cheaper than all
        where the others are much faster.
    frame : array_like, shape (count, n), optional
        The tangents at the start, a row each, orthonormal; the states' axes if left out.
        Finite-time exponents depend on them.
    runaway : float
        A state beyond this many times its nominal magnitude has run away.

    Returns
    -------
    Spectrum

    Raises
    ------
    ValueError
        For a count or frame that does not fit the states.
    """
    n = len(model.x)
    count = n if count is None else count
    if not 1 <= count <= n:
        raise ValueError(f"{count} tangents, expected 1 to {n}, the number of states")
    rows = np.array(np.eye(n)[:count] if frame is None else frame, dtype=float)
    if rows.shape != (count, n):
        raise ValueError(f"the frame has the shape {rows.shape}, expected {(count, n)}")
    grid = np.asarray(times, dtype=float)
    if _may_be_explicit(model, float(grid[0])):
        smooth = _stride(model, grid, rows.copy(), runaway)
        if smooth is not None:
            return smooth
    if count < n:
        return _walk(model, grid, rows, runaway, collocating=True)
    start, held, info = model.x.copy(), model.u.copy(), model.info.copy()
    run = _walk(model, grid, rows.copy(), runaway, collocating=False)
    # The slow ones again, by themselves, where they are slow beside others.
    mean_step = (run.time[-1] - grid[0]) / max(
        1.0, model.info[stepper.ACCEPTED] - info[stepper.ACCEPTED]
    )
    with np.errstate(invalid="ignore"):
        slow = np.abs(run.exponents) * mean_step <= propagation.SLOW
    leading = int(np.argmin(slow)) if not slow.all() else 0
    if not leading or run.failure:
        return run
    end, last, notes = model.x.copy(), model.u.copy(), model.info.copy()
    model.x[:], model.u[:], model.info[:] = start, held, info
    again = _walk(model, grid, rows[:leading], runaway, collocating=True)
    model.x[:], model.u[:], model.info[:] = end, last, notes
    if again.failure:
        return run
    run.growth[:, :leading] = again.growth
    return run


def _may_be_explicit(model: Model, t: float) -> bool:
    """Whether the rates of a model's motion look near enough to each other for an explicit pair.

    Looked at are the Jacobian where the motion begins and at its states' magnitudes to either side.
    Where it stands still exponentials are exact, and nothing else is asked for.
    """
    kernel = model.kernel
    if kernel.modes:
        return False
    jac = kernel.functions.jac
    jac = getattr(jac, "py_func", jac)  # three calls are not worth compiling it
    n, u, p = len(model.x), model.u.tolist(), model.p.tolist()
    nominal = np.array([s.nominal for s in kernel.states])
    seen = []
    for shift in (1.0, 0.0, -1.0):
        matrix = np.zeros((n, n))
        try:
            jac(t, (model.x + shift * nominal).tolist(), u, p, matrix, [0.0] * n)
            rates = np.abs(np.linalg.eigvals(matrix))
        except (ArithmeticError, TypeError, ValueError):  # outside of what the equations are for
            if shift == 0.0:
                return False
            continue
        moving = rates[rates > ZERO * rates.max()]
        if len(moving) and moving.max() > APART * moving.min():
            return False
        seen.append(matrix)
    return any(np.any(matrix != seen[0]) for matrix in seen)


def _stride(model: Model, grid: Vector, frame: Matrix, runaway: float) -> Spectrum | None:
    """As `_walk`, by the explicit pair; None, and the model as it was, where that is too stiff."""
    n = len(model.x)
    f = functions(model.kernel)
    states = np.empty((len(grid), n))
    states[0] = model.x
    growth = np.zeros((len(grid), len(frame)))
    trace = np.zeros(len(grid))
    nominal = np.array([s.nominal for s in model.kernel.states])
    before = model.info.copy()
    done = f.explicit_spectrum(
        grid,
        states,
        growth,
        trace,
        model.u,
        model.p,
        model.atol,
        model.tolerance,
        np.zeros(explicit.explicit_work_size(n)),
        model.info,
        MAX_STEPS,
        runaway * nominal,
        nominal,
        frame,
    )
    if int(model.info[stepper.STATUS]) not in (stepper.DONE, tangents.RAN_AWAY):
        model.info[:] = before
        return None
    failure, ran_away = _failure(model, states[min(done, len(grid) - 1)], grid[-1])
    model.x[:] = states[done - 1]
    return Spectrum(
        grid[:done], states[:done], growth[:done], trace[:done], frame, 0, failure, ran_away
    )


def _walk(model: Model, grid: Vector, frame: Matrix, runaway: float, collocating: bool) -> Spectrum:
    kernel = model.kernel
    n = len(model.x)
    f = functions(kernel)
    states = np.empty((len(grid), n))
    states[0] = model.x
    growth = np.zeros((len(grid), len(frame)))
    trace = np.zeros(len(grid))
    nominal = np.array([s.nominal for s in kernel.states])
    parameters, jumps = _with_note(model, f)
    done = f.spectrum(
        grid,
        states,
        growth,
        trace,
        model.u,
        parameters,
        model.atol,
        model.tolerance,
        model._work,
        model.info,
        MAX_STEPS,
        runaway * nominal,
        2.0 ** np.round(np.log2(nominal)),
        frame,
        jumps,
        collocating,
        np.zeros(tangents.tangent_work_size(n)),
    )
    failure, ran_away = _failure(model, states[min(done, len(grid) - 1)], grid[-1])
    model.x[:] = states[done - 1]
    return Spectrum(
        grid[:done],
        states[:done],
        growth[:done],
        trace[:done],
        frame,
        int(model.info[stepper.EVENTS]),
        failure,
        ran_away,
    )


def _with_note(model: Model, f: Any) -> tuple[Vector, int]:
    """The parameters with room for a note on events behind them, and where it begins."""
    if not f.MOST_EVENTS:
        return model.p, -1
    return np.concatenate([model.p, np.zeros(tangents.note_size(len(model.x)))]), len(model.p)


def _failure(model: Model, state: Vector, end: float) -> tuple[str, bool]:
    """Why the last call did not reach its end, if so, and whether the state ran away."""
    kernel, status = model.kernel, int(model.info[stepper.STATUS])
    if status == stepper.DONE:
        return "", False
    if status != tangents.RAN_AWAY:
        return describe_failure(kernel.name, status, model.info, end), False
    size = np.abs(state) / np.array([s.nominal for s in kernel.states])
    worst = kernel.states[int(np.argmax(np.nan_to_num(size, nan=np.inf)))].name
    reached = model.info[stepper.REACHED]
    return f"{kernel.name} runs away: {worst} leaves every bound at t = {reached:.6g} s", True


@dataclass(frozen=True)
class Returns:
    """Where a motion crossed a plane upwards.

    Attributes
    ----------
    time : ndarray, shape (k,)
        [s]
    states : ndarray, shape (k, n)
    low, high : ndarray, shape (n,)
        Least and largest values of the states on the way.
    end : float
        The time that was reached [s].
    failure : str
        Why it ended early; empty if it did not.
    ran_away : bool
    """

    time: Vector
    states: Matrix
    low: Vector
    high: Vector
    end: float
    failure: str
    ran_away: bool


def follow_returns(
    model: Model, start: float, stop: float, coordinate: int, level: float, most: int
) -> Returns:
    """Follow a model from `start` to `stop` [s], or until it crossed a plane `most` times.

    Parameters
    ----------
    model : Model
        Its state and mode are moved on.
    coordinate, level : int, float
        The plane: where this state has this value.
    """
    f = functions(model.kernel)
    n = len(model.x)
    nominal = np.array([s.nominal for s in model.kernel.states])
    times, states = np.empty(most), np.empty((most, n))
    low, high = np.empty(n), np.empty(n)
    parameters, _ = _with_note(model, f)

    def walk(returns: Any, work: Vector) -> int:
        found = returns(
            start,
            stop,
            model.x,
            model.u,
            parameters,
            model.atol,
            model.tolerance,
            work,
            model.info,
            MAX_STEPS,
            RUNAWAY * nominal,
            coordinate,
            level,
            times,
            states,
            low,
            high,
        )
        return int(found)

    found = -1
    if _may_be_explicit(model, start):
        state, before = model.x.copy(), model.info.copy()
        found = walk(f.explicit_returns, np.zeros(explicit.explicit_work_size(n)))
        if int(model.info[stepper.STATUS]) not in (stepper.DONE, tangents.RAN_AWAY):
            model.x[:], model.info[:] = state, before
            found = -1
    if found < 0:
        found = walk(f.returns, model._work)
    failure, ran_away = _failure(model, model.x, stop)
    reached = float(model.info[stepper.REACHED])
    return Returns(times[:found], states[:found], low, high, reached, failure, ran_away)
