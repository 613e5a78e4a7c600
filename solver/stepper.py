"""The stiff stepper: one L-stable Rosenbrock method with its own error control.

This file stands alone on purpose. It is imported by the project and its text is also put,
unchanged, into every exported FMU, so it may import nothing but the standard library and numpy.
Where numba is present the functions are compiled; without it they run as plain Python.

The method is Rodas5P (G. Steinebach, BIT Numer. Math. 63, 27 (2023)): eight stages, order five
with an embedded fourth-order solution, stiffly accurate, L-stable, one matrix factorization a
step. It needs the exact Jacobian and the partial derivative by time, which the generated
equations deliver. Order and L-stability are measured in ``tests/solver/test_stepper.py``.
"""

from __future__ import annotations

import math
from typing import Any

try:
    from numba import njit
except ImportError:  # the FMU's host may have numpy only: slower, equally right

    def njit(*_args: Any, **_options: Any) -> Any:
        return lambda function: function


STAGES = 8
GAMMA = 0.21193756319429014
_A6 = (
    -7.502846399306121,
    2.561846144803919,
    -11.627539656261098,
    -0.18268767659942256,
    0.030198172008377946,
)


def _rows(*rows: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """Lower triangular rows, filled up with zeros: numba wants tuples of one length."""
    return tuple(row + (0.0,) * (STAGES - len(row)) for row in rows)


A = _rows(
    (),
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    _A6,
    (*_A6, 1.0),
    (*_A6, 1.0, 1.0),
)
C = _rows(
    (),
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (
        24.854864614690072,
        -3.0009227002832186,
        47.4931110020768,
        5.5814197821558125,
        -0.6610691825249471,
    ),
    (
        30.91273214028599,
        -3.1208243349937974,
        77.79954646070892,
        34.28646028294783,
        -19.097331116725623,
        -28.087943162872662,
    ),
    (
        37.80277123390563,
        -3.2571969029072276,
        112.26918849496327,
        66.9347231244047,
        -40.06618937091002,
        -54.66780262877968,
        -9.48861652309627,
    ),
)
NODES = (
    0.0,
    0.6358126895828704,
    0.4095798393397535,
    0.9769306725060716,
    0.4288403609558664,
    1.0,
    1.0,
    1.0,
)
# weights of the partial derivative by time
TIME = (
    GAMMA,
    -0.42387512638858027,
    -0.3384627126235924,
    1.8046452872882734,
    2.325825639765069,
    0.0,
    0.0,
    0.0,
)

DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, CHATTER = 0, 1, 2, 3
# layout of the vector ``info`` that `integrate` reads and writes
NEXT_STEP, ACCEPTED, REJECTED, REACHED, EVENTS, STATUS, LAST_ERROR = 0, 1, 2, 3, 4, 5, 6
INFO_SIZE = 7
# kinds of events: a crossing either way; one that changes the mode; one that only resets the state
EITHER, CHANGES_MODE, RESETS = 0, 1, 2
MOST_AT_ONCE = 64  # events at one instant
INSIDE = 4  # parts of a step at whose ends a crossing is looked for


def work_size(n: int, events: int = 0) -> int:
    """Number of floats of scratch memory for `n` states and the `events` of the richest mode."""
    return n * (2 * n + STAGES + 5) + events * 3 + (3 * n if events else 0)


@njit(error_model="numpy", inline="never")
def factorize(w: Any, pivots: Any, n: int) -> bool:
    """Replace the n x n matrix `w` by its LU factors with row pivoting; False if singular."""
    for k in range(n):
        best, row = abs(w[k, k]), k
        for i in range(k + 1, n):
            if abs(w[i, k]) > best:
                best, row = abs(w[i, k]), i
        if not best > 0.0 or best == math.inf:
            return False
        pivots[k] = row
        if row != k:
            for j in range(n):
                w[k, j], w[row, j] = w[row, j], w[k, j]
        inverse = 1.0 / w[k, k]
        for i in range(k + 1, n):
            w[i, k] *= inverse
            factor = w[i, k]
            if factor != 0.0:
                for j in range(k + 1, n):
                    w[i, j] -= factor * w[k, j]
    return True


@njit(error_model="numpy", inline="never")
def solve_factorized(w: Any, pivots: Any, n: int, b: Any) -> None:
    """Solve for the right-hand side `b`, in place, with the factors made by `factorize`."""
    for k in range(n):
        row = int(pivots[k])
        b[k], b[row] = b[row], b[k]
    for k in range(n):
        for i in range(k + 1, n):
            b[i] -= w[i, k] * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= w[k, j] * b[j]
        b[k] /= w[k, k]


def _integrator(jac: Any, react: Any, events: int, attempt: Any, locate: Any, settle: Any) -> Any:
    """The function `integrate` from the parts that `build` makes."""

    @njit(error_model="numpy")
    def integrate(
        t0: float,
        t1: float,
        x: Any,
        u: Any,
        p: Any,
        atol: Any,
        rtol: float,
        work: Any,
        info: Any,
        max_steps: int,
    ) -> int:
        """Advance ``dx/dt = rhs(t, x, u, p)`` from `t0` to `t1` with `u` and `p` held, in place.

        Parameters
        ----------
        x : ndarray, shape (n,)
            State at `t0`; on return the state at the time ``info[REACHED]``.
        u : ndarray
            Held inputs, and the mode, which events change.
        atol : ndarray, shape (n,)
            Absolute tolerance of each state, in its own unit.
        rtol : float
            Relative tolerance.
        work : ndarray, shape (work_size(n, events),)
            Scratch memory; contents do not matter.
        info : ndarray, shape (INFO_SIZE,)
            ``info[NEXT_STEP]`` is the step to try first (0: choose one) and on return the step that
            the error control would take next; accepted and rejected steps and events are added up.
            The error control's memory is kept where a call ends for want of steps, so that calls of
            one step each walk as one call of many.
        max_steps : int
            Most steps, accepted or rejected, that this call may take.

        Returns
        -------
        int
            ``DONE``, ``TOO_MANY_STEPS``, ``STEP_TOO_SMALL`` or ``CHATTER``.
        """
        n = x.shape[0]
        if events > 0 and settle(t0, x, u, p, work, info) != DONE:
            return CHATTER
        info[REACHED] = t1
        span = t1 - t0
        if n == 0 or span == 0.0:
            return DONE
        jacobian = work[: n * n].reshape((n, n))
        base = 2 * n * n + STAGES * n
        stage = work[base : base + n]
        by_time = work[base + 2 * n : base + 3 * n]
        alone = work[base + 4 * n : base + 5 * n]

        h = info[NEXT_STEP]
        if not h > 0.0 or h > span:
            h = span
        smallest = 1e-13 * max(abs(t0), abs(t1), span)
        t = t0
        last_error = info[LAST_ERROR] if info[LAST_ERROR] > 0.0 else 1e-4
        info[LAST_ERROR] = 0.0
        fresh = True  # the Jacobian belongs to the present point
        rejected_before = False
        still = 0  # events since time last moved on
        for _ in range(max_steps):
            remaining = t1 - t
            if h < smallest and h < remaining:
                info[NEXT_STEP] = h
                info[REACHED] = t
                return STEP_TOO_SMALL
            # A last step of a sliver would cost as much as a whole one: stretch or halve instead.
            final = False
            planned = h
            if h >= remaining * 0.99999:
                h = remaining
                final = True
            elif h > 0.6 * remaining:
                h = 0.5 * remaining
            if fresh:
                jac(t, x, u, p, jacobian, by_time)
                fresh = False
                # A state that depends on none, such as one held at rest, is free of the others'
                # round-off.
                for i in range(n):
                    alone[i] = 1.0
                    for j in range(n):
                        if jacobian[i, j] != 0.0:
                            alone[i] = 0.0
            error = attempt(t, h, x, u, p, atol, rtol, work)
            if error <= 1.0:  # false for NaN, too
                taken = h
                if events > 0:
                    taken = locate(t, h, x, u, p, atol, rtol, work)
                happened = events > 0 and work[n * (2 * n + STAGES + 5) + 2 * events] >= 0.0
                for i in range(n):
                    x[i] = stage[i]
                info[ACCEPTED] += 1
                fresh = True
                if happened:
                    before = t
                    t = t1 if final and taken == h else t + taken
                    still = 0 if t > before else still + 1
                    react(t, x, u, p, int(work[n * (2 * n + STAGES + 5) + 2 * events]))
                    info[EVENTS] += 1
                    if still > MOST_AT_ONCE or settle(t, x, u, p, work, info) != DONE:
                        info[REACHED] = t
                        return CHATTER
                    h = planned
                    last_error = 1e-4
                    rejected_before = False
                    if t >= t1:
                        info[NEXT_STEP] = h
                        return DONE
                    continue
                t = t1 if final else t + h
                error = max(error, 1e-10)
                # proportional-integral control (Gustafsson) keeps rejections rare
                growth = 0.9 * error**-0.17 * last_error**0.06
                growth = min(6.0, max(0.2, growth))
                if rejected_before:
                    growth = min(growth, 1.0)
                last_error = max(error, 1e-4)
                rejected_before = False
                if final:
                    info[NEXT_STEP] = max(planned, h * growth) if growth >= 1.0 else h * growth
                    return DONE
                h *= growth
            else:
                info[REJECTED] += 1
                rejected_before = True
                if error < math.inf:
                    h *= max(0.1, 0.9 * error**-0.2)
                else:
                    h *= 0.1
        info[NEXT_STEP] = h
        info[REACHED] = t
        info[LAST_ERROR] = last_error
        return TOO_MANY_STEPS

    return integrate


def build(
    rhs: Any, jac: Any, indicate: Any = None, kind: Any = None, react: Any = None, events: int = 0
) -> Any:
    """The functions `integrate` and `settle` for one system of equations.

    Closures, because numba cannot cache a function that is handed other compiled functions.

    **Events.** A mode's indicators are oriented so that an event is due where its indicator is
    positive. One that changes the mode or resets the state fires when its indicator becomes
    positive, or is positive where a step begins (an input has jumped, or another event has led
    here); one that watches for a crossing either way fires on a change of sign only. Within a step
    the crossing is bracketed to the last digits of the time by doing the step again, shorter: the
    event is met with the accuracy of the step itself. An event that changes the mode, or that
    watches either way, happens just after the crossing; one that only resets the state just before
    it, so that the reset finds its indicator on the side it came from.

    Parameters
    ----------
    rhs : function (t, x, u, p, dx) -> None
        Writes the derivatives.
    jac : function (t, x, u, p, J, ft) -> None
        Writes the Jacobian by x, shape (n, n), and the partial derivative by t, shape (n,).
    indicate : function (t, x, u, p, g) -> None
        Writes the indicators of the present mode, shape (events,).
    kind : function (u, k) -> int
        ``EITHER``, ``CHANGES_MODE`` or ``RESETS``.
    react : function (t, x, u, p, k) -> None
        Resets `x` and the mode in `u`, in place, as event `k` of the present mode says.
    events : int
        Events of the mode that has most; 0 for a system without.

    Returns
    -------
    tuple of two functions
        ``integrate`` and ``settle``.
    """

    @njit(error_model="numpy")
    def attempt(
        t: float, h: float, x: Any, u: Any, p: Any, atol: Any, rtol: float, work: Any
    ) -> float:
        """One step from `x`, with the Jacobian in `work`; the new state goes there, too.

        Returns the error estimate in units of the tolerance, infinity where there is no step.
        """
        n = x.shape[0]
        jacobian = work[: n * n].reshape((n, n))
        w = work[n * n : 2 * n * n].reshape((n, n))
        base = 2 * n * n
        k = work[base : base + STAGES * n].reshape((STAGES, n))
        base += STAGES * n
        stage = work[base : base + n]
        slope = work[base + n : base + 2 * n]
        by_time = work[base + 2 * n : base + 3 * n]
        pivots = work[base + 3 * n : base + 4 * n]
        alone = work[base + 4 * n : base + 5 * n]
        diagonal = 1.0 / (GAMMA * h)
        for i in range(n):
            for j in range(n):
                w[i, j] = -jacobian[i, j]
            w[i, i] += diagonal
        if not factorize(w, pivots, n):
            return math.inf
        for s in range(STAGES):
            for i in range(n):
                value = x[i]
                for j in range(s):
                    value += A[s][j] * k[j, i]
                stage[i] = value
            rhs(t + NODES[s] * h, stage, u, p, slope)
            for i in range(n):
                value = slope[i] + h * TIME[s] * by_time[i]
                for j in range(s):
                    value += C[s][j] / h * k[j, i]
                k[s, i] = value
                slope[i] = value
            solve_factorized(w, pivots, n, k[s])
            for i in range(n):
                if alone[i] > 0.0:
                    k[s, i] = slope[i] * GAMMA * h
        total = 0.0
        for i in range(n):
            stage[i] += k[STAGES - 1, i]
            scale = atol[i] + rtol * max(abs(x[i]), abs(stage[i]))
            total += (k[STAGES - 1, i] / scale) ** 2
        return math.sqrt(total / n)

    if events == 0:  # nothing to look for, and nothing to compile for it

        @njit(error_model="numpy")
        def no_settling(t: float, x: Any, u: Any, p: Any, work: Any, info: Any) -> int:
            return DONE

        @njit(error_model="numpy")
        def no_event(
            t: float, h: float, x: Any, u: Any, p: Any, atol: Any, rtol: float, work: Any
        ) -> float:
            return h

        @njit(error_model="numpy")
        def no_reaction(t: float, x: Any, u: Any, p: Any, k: int) -> None:
            return

        return _integrator(jac, no_reaction, 0, attempt, no_event, no_settling), no_settling

    @njit(error_model="numpy")
    def settle(t: float, x: Any, u: Any, p: Any, work: Any, info: Any) -> int:
        """Let every event happen that is due at this instant; ``DONE`` or ``CHATTER``."""
        n = x.shape[0]
        base = n * (2 * n + STAGES + 5)
        g = work[base : base + events]
        fired = work[base + events : base + 2 * events]
        fired[:] = 0.0
        for _ in range(MOST_AT_ONCE):
            indicate(t, x, u, p, g)
            due = -1
            for k in range(events):
                what = kind(u, k)
                if g[k] > 0.0 and what != EITHER and not (what == RESETS and fired[k] > 0.0):
                    due = k
                    break
            if due < 0:
                return DONE
            if kind(u, due) == RESETS:
                fired[due] = 1.0
            else:
                fired[:] = 0.0
            react(t, x, u, p, due)
            info[EVENTS] += 1
        info[REACHED] = t
        return CHATTER

    @njit(error_model="numpy")
    def due_at(t: float, x: Any, u: Any, p: Any, before: Any, g: Any) -> int:
        """The event whose indicator is furthest past zero and was not before; -1 if there is none.

        `before` holds the signs at the start of the step: an event that was due then, or watches
        either way and starts on zero, is not looked for.
        """
        indicate(t, x, u, p, g)
        best, found = 0.0, -1
        for k in range(events):
            what = kind(u, k)
            past = -g[k] * before[k] if what == EITHER else g[k]
            if what != EITHER and before[k] > 0.0:
                past = 0.0
            if past > best:
                best, found = past, k
        return found

    @njit(error_model="numpy")
    def locate(
        t: float, h: float, x: Any, u: Any, p: Any, atol: Any, rtol: float, work: Any
    ) -> float:
        """Length of the part of a step that ends at its first event; `h` if there is none.

        On return the state at the end of that part stands where `attempt` leaves it.
        """
        n = x.shape[0]
        base = n * (2 * n + STAGES + 5)
        g = work[base : base + events]
        before = work[base + events : base + 2 * events]
        base += 3 * events
        end = work[base : base + n]
        first = work[base + n : base + 2 * n]
        middle = work[base + 2 * n : base + 3 * n]
        base = 2 * n * n + STAGES * n
        stage = work[base : base + n]
        slope = work[base + n : base + 2 * n]
        indicate(t, x, u, p, before)
        for k in range(events):
            if kind(u, k) == EITHER:
                before[k] = 1.0 if before[k] > 0.0 else (-1.0 if before[k] < 0.0 else 0.0)
        # Hermite's cubic through both ends shows crossings that come and go within the step.
        for i in range(n):
            end[i] = stage[i]
        rhs(t, x, u, p, first)
        rhs(t + h, end, u, p, slope)
        high = -1.0
        for part in range(1, INSIDE):
            s = part / INSIDE
            for i in range(n):
                middle[i] = (
                    (1.0 + 2.0 * s) * (1.0 - s) ** 2 * x[i]
                    + s * (1.0 - s) ** 2 * h * first[i]
                    + s * s * (3.0 - 2.0 * s) * end[i]
                    + s * s * (s - 1.0) * h * slope[i]
                )
            if due_at(t + s * h, middle, u, p, before, g) >= 0:
                attempt(t, s * h, x, u, p, atol, rtol, work)
                if due_at(t + s * h, stage, u, p, before, g) >= 0:
                    high = s * h
                    break
        if high < 0.0:
            if due_at(t + h, end, u, p, before, g) < 0:
                for i in range(n):
                    stage[i] = end[i]
                work[n * (2 * n + STAGES + 5) + 2 * events] = -1.0
                return h
            high = h
        low = 0.0
        # Bisection: fifty halvings cost less than they are worth explaining away.
        while high - low > 2.3e-16 * max(abs(t), high):
            half = 0.5 * (low + high)
            if not low < half < high:
                break
            attempt(t, half, x, u, p, atol, rtol, work)
            if due_at(t + half, stage, u, p, before, g) >= 0:
                high = half
            else:
                low = half
        attempt(t, high, x, u, p, atol, rtol, work)
        found = due_at(t + high, stage, u, p, before, g)
        if found >= 0 and kind(u, found) == RESETS:
            high = low
            if low > 0.0:
                attempt(t, low, x, u, p, atol, rtol, work)
            else:
                for i in range(n):
                    stage[i] = x[i]
        work[n * (2 * n + STAGES + 5) + 2 * events] = found
        return high

    return _integrator(jac, react, events, attempt, locate, settle), settle
