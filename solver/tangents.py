"""Tangent vectors along a trajectory, orthonormalized: finite-time Lyapunov exponents.

Like the stepper's, this file's text goes into generated modules, after the equations that it is
for.

The trajectory is the stiff stepper's. Over each of its steps the tangents obey a linear equation,
whose propagator is the product of two matrix exponentials of the Jacobian (commutator-free, order
four: A. Alvermann and H. Fehske, J. Comput. Phys. 230, 5930 (2011), with the stage values of
S. Blanes and P. C. Moan, Appl. Numer. Math. 56, 1519 (2006)). An exponential does not damp what is
stiff as a stable step would, so the fast exponents come out right. It is applied in as many equal
parts as keep the fastest tangent above the round-off of the slowest, with an orthonormalization
after each: the parts are powers of two of one small exponential, so that they cost a product of
small matrices each, not a step of the solver.

For what is slow beside something stiff, Jacobians that are constant piece by piece lose order:
where the slow direction turns, each piece sends a little of it into the stiff one. Slow tangents
can be collocated instead. The two do not mix well, since a slow tangent moved by a hair moves the
volume of the stiff ones by much: all tangents are followed by exponentials, or the slow ones by
themselves.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from .propagation import (
    RADAU_NODES,
    SLOW,
    apply,
    collocate,
    orthonormalize,
    push,
    slow_ones,
)
from .stepper import (
    ACCEPTED,
    CHATTER,
    DONE,
    NEXT_STEP,
    REACHED,
    STAGES,
    STATUS,
    TOO_MANY_STEPS,
)

# Two rules' integrals of the Jacobian over a step may differ by DOUBT * rtol**ORDER, over the
# states' magnitudes [nats]: both are of order four where the stepper is of order five.
DOUBT, ORDER = 1.0, 0.45
STILL = 1e-10  # share of the Jacobian by which it may change in a step and still be constant
SHORTEST = 1e-14  # step over time at which it is left at that
STRIDES = 512  # parts of a walk within which a motion does not cross a plane twice unseen
RAN_AWAY = 4  # a status, beside the stepper's
GAUSS = 0.5 - math.sqrt(3.0) / 6.0
HEAVY, LIGHT = (3.0 + 2.0 * math.sqrt(3.0)) / 12.0, (3.0 - 2.0 * math.sqrt(3.0)) / 12.0


def tangent_work_size(n: int) -> int:
    """Number of floats of scratch memory of `spectrum` for `n` states."""
    return 20 * n * n + 20 * n + 2


@njit(error_model="numpy")
def place(x0: Any, slope0: Any, x1: Any, slope1: Any, s: float, h: float, at: Any) -> None:
    """Write Hermite's cubic through both ends of a step, at the share `s` of it, to `at`."""
    for i in range(x0.shape[0]):
        at[i] = (
            (1.0 + 2.0 * s) * (1.0 - s) ** 2 * x0[i]
            + s * (1.0 - s) ** 2 * h * slope0[i]
            + s * s * (3.0 - 2.0 * s) * x1[i]
            + s * s * (s - 1.0) * h * slope1[i]
        )


def build_noting(rhs: Any, react: Any, slopes: Any, n: int, at: int) -> Any:
    """A `react` that notes behind the parameters, from `at` on, what events do to tangents.

    The first event since the note was cleared decides when all that follow at once happen. Noted
    are one if there was any; the row w, the gradient of the first indicator over its rate of
    change; the rate b of the state before, and the matrix A, both as the resets move them on. A
    tangent d becomes (A + (f - b) w) d, with f the state's rate after the last: the saltation
    matrix (e.g. R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical
    Systems, Springer 2004, Section 7).
    """

    @njit(error_model="numpy")
    def noting(t: float, x: Any, u: Any, p: Any, k: int) -> None:
        w, b = p[at + 1 : at + 1 + n], p[at + 1 + n : at + 1 + 2 * n]
        a = p[at + 1 + 2 * n : at + 1 + 2 * n + n * n].reshape((n, n))
        gradient, by_time = np.zeros(n), np.zeros(n)
        reset = np.zeros((n, n))
        rate = slopes(t, x, u, p, k, gradient, reset, by_time)
        if p[at] == 0.0:
            p[at] = 1.0
            rhs(t, x, u, p, b)
            for i in range(n):
                rate += gradient[i] * b[i]
            for i in range(n):
                w[i] = gradient[i] / rate
                for j in range(n):
                    a[i, j] = 1.0 if i == j else 0.0
        a[:] = reset @ a
        b[:] = reset @ b + by_time
        react(t, x, u, p, k)

    return noting


def note_size(n: int) -> int:
    """Number of floats behind the parameters that `build_noting` writes to."""
    return 1 + 2 * n + n * n


def build_spectrum(rhs: Any, jac: Any, integrate: Any, settle: Any) -> Any:
    """The function `spectrum` for one system of equations.

    Parameters
    ----------
    rhs, jac : functions
        As in `stepper.build`.
    integrate, settle : functions
        The stepper's; where there are events, with the `react` of `build_noting`.
    """

    @njit(error_model="numpy")
    def jump(t: float, x: Any, u: Any, p: Any, at: int, timed: bool, matrix: Any, f: Any) -> float:
        """Write what the noted events do to tangents to `matrix`; log of its determinant."""
        n = x.shape[0]
        w, b = p[at + 1 : at + 1 + n], p[at + 1 + n : at + 1 + 2 * n]
        a = p[at + 1 + 2 * n : at + 1 + 2 * n + n * n]
        rhs(t, x, u, p, f)
        for i in range(n):
            for j in range(n):
                matrix[i, j] = a[i * n + j]
                if timed:
                    matrix[i, j] += (f[i] - b[i]) * w[j]
        size = abs(np.linalg.det(matrix))
        return math.log(size) if size > 0.0 else -math.inf

    @njit(error_model="numpy")
    def spectrum(
        times: Any,
        X: Any,
        L: Any,
        trace: Any,
        u: Any,
        p: Any,
        atol: Any,
        rtol: float,
        work: Any,
        info: Any,
        max_steps: int,
        bound: Any,
        scale: Any,
        frame: Any,
        jumps: int,
        collocating: bool,
        scratch: Any,
    ) -> int:
        """Follow the state ``X[0]`` and its tangents over a grid of times.

        Parameters
        ----------
        times : ndarray, shape (m,)
        X : ndarray, shape (m, n)
            States on the grid; the first row is given.
        L : ndarray, shape (m, count)
            Sums of the tangents' logarithms [nats]; the first row is given.
        trace : ndarray, shape (m,)
            Integral of the Jacobian's trace, and the logarithms of the events' determinants.
        bound : ndarray, shape (n,)
            A state beyond this has run away.
        frame : ndarray, shape (count, n)
            Orthonormal tangents, a row each, in and out.
        jumps : int
            Where the note on events begins in `p`; -1 without events.
        collocating : bool
            Whether slow tangents are collocated.
        scratch : ndarray, shape (tangent_work_size(n),)

        Returns
        -------
        int
            Rows that were reached; ``info[STATUS]`` says why no more, and ``info[REACHED]`` when.
        """
        n = X.shape[1]
        count = frame.shape[0]
        first, last = scratch[:n], scratch[n : 2 * n]
        slope0, slope1 = scratch[2 * n : 3 * n], scratch[3 * n : 4 * n]
        by_time, at = scratch[4 * n : 5 * n], scratch[5 * n : 6 * n]
        base = 6 * n
        j1 = scratch[base : base + n * n].reshape((n, n))
        j2 = scratch[base + n * n : base + 2 * n * n].reshape((n, n))
        omega = scratch[base + 2 * n * n : base + 3 * n * n].reshape((n, n))
        mean = scratch[base + 3 * n * n : base + 4 * n * n].reshape((n, n))
        radau = scratch[base + 4 * n * n : base + 7 * n * n].reshape((3, n, n))
        slow = scratch[base + 7 * n * n : base + 7 * n * n + count * n].reshape((count, n))
        logs = scratch[base + 8 * n * n : base + 8 * n * n + n]
        changes = scratch[base + 8 * n * n + n : base + 8 * n * n + 2 * n]
        rest = scratch[base + 8 * n * n + 2 * n :]
        doubt = DOUBT * rtol**ORDER
        ends = work[2 * n * n + STAGES * n : 2 * n * n + STAGES * n + n]
        rate = 0.0  # nats per second between first and last tangent
        for row in range(1, times.shape[0]):
            x = X[row]
            for i in range(n):
                x[i] = X[row - 1, i]
            for j in range(count):
                L[row, j] = L[row - 1, j]
            trace[row] = trace[row - 1]
            t, goal = times[row - 1], times[row]
            if jumps >= 0:
                # events that are due because an input jumped happen now, whatever the state
                p[jumps] = 0.0
                if settle(t, x, u, p, work, info) != DONE:
                    info[STATUS] = CHATTER
                    return row
                if p[jumps] > 0.0:
                    trace[row] += jump(t, x, u, p, jumps, False, omega, at)
                    apply(omega, frame, at)
                    orthonormalize(frame, L[row])
            taken = 0
            until = goal
            while t < goal:
                for i in range(n):
                    first[i] = x[i]
                mode = u[-1] if jumps >= 0 else 0.0
                if jumps >= 0:
                    p[jumps] = 0.0
                accepted = info[ACCEPTED]
                status = integrate(t, until, x, u, p, atol, rtol, work, info, 1)
                if status != DONE and status != TOO_MANY_STEPS:
                    info[STATUS] = status
                    return row
                taken += 1
                if taken > max_steps:
                    info[STATUS] = TOO_MANY_STEPS
                    return row
                h = info[REACHED] - t
                for i in range(n):
                    if not abs(x[i]) <= bound[i]:
                        info[STATUS] = RAN_AWAY
                        return row
                if info[ACCEPTED] == accepted:
                    continue
                if h > 0.0:
                    # the state before any event, which the stepper's memory still holds
                    for i in range(n):
                        last[i] = ends[i]
                    after = 0.0
                    if jumps >= 0:
                        after = u[-1]
                        u[-1] = mode
                    rhs(t, first, u, p, slope0)
                    rhs(t + h, last, u, p, slope1)
                    # Simpson's rule for the trace: other points than the propagator's
                    for i in range(n):
                        for j in range(n):
                            mean[i, j] = 0.0
                    for part in range(3):
                        s = 0.5 * part
                        place(first, slope0, last, slope1, s, h, at)
                        jac(t + s * h, at, u, p, omega, by_time)
                        weight = (4.0 if part == 1 else 1.0) / 6.0
                        for i in range(n):
                            for j in range(n):
                                mean[i, j] += weight * omega[i, j]
                    for part in range(2):
                        s = GAUSS if part == 0 else 1.0 - GAUSS
                        place(first, slope0, last, slope1, s, h, at)
                        jac(t + s * h, at, u, p, j1 if part == 0 else j2, by_time)
                    # The stepper sees what moves the state; tangents may feel more within a step.
                    apart = 0.0
                    for i in range(n):
                        for j in range(n):
                            gap = mean[i, j] - 0.5 * (j1[i, j] + j2[i, j])
                            apart = max(apart, abs(gap) * h * scale[j] / scale[i])
                    if apart > doubt and h > SHORTEST * max(abs(t), abs(goal)):
                        for i in range(n):
                            x[i] = first[i]
                        if jumps >= 0:
                            u[-1] = mode
                        until = t + 0.5 * h
                        info[NEXT_STEP] = 0.5 * h
                        continue
                    until = goal
                    for i in range(n):
                        trace[row] += h * mean[i, i]
                    for j in range(count):
                        logs[j] = L[row, j]
                        for i in range(n):
                            slow[j, i] = frame[j, i]
                    # where the Jacobian stands still, exponentials are exact
                    turning, largest = 0.0, 0.0
                    for i in range(n):
                        for j in range(n):
                            ratio = scale[j] / scale[i]
                            turning = max(turning, abs(j1[i, j] - j2[i, j]) * ratio)
                            largest = max(largest, abs(j1[i, j]) * ratio)
                    leading = 0
                    if collocating and turning > STILL * largest:
                        leading = slow_ones(mean, slow, scale, h, changes)
                    if leading < count:
                        for part in range(2):
                            a, b = (HEAVY, LIGHT) if part == 0 else (LIGHT, HEAVY)
                            for i in range(n):
                                for j in range(n):
                                    omega[i, j] = h * (a * j1[i, j] + b * j2[i, j])
                            met = push(omega, frame, L[row], scale, 0.75 * rate * h, n, rest)
                            rate = 2.0 * met / h
                    if leading > 0:
                        widest = 0.0
                        for j in range(leading):
                            widest = max(widest, changes[j])
                            L[row, j] = logs[j]
                        parts = max(1, math.ceil(widest / SLOW))
                        for part in range(parts):
                            for stage in range(3):
                                s = (part + RADAU_NODES[stage]) / parts
                                place(first, slope0, last, slope1, s, h, at)
                                jac(t + s * h, at, u, p, radau[stage], by_time)
                            collocate(radau, h / parts, slow, leading, n, rest)
                        for j in range(leading):
                            for i in range(n):
                                frame[j, i] = slow[j, i]
                        for j in range(leading, count):
                            logs[j] = L[row, j]
                        orthonormalize(frame, L[row])
                        # the faster ones turn with them, and keep what the exponential said
                        for j in range(leading, count):
                            L[row, j] = logs[j]
                    if jumps >= 0:
                        u[-1] = after
                t = info[REACHED]
                if jumps >= 0 and p[jumps] > 0.0:
                    trace[row] += jump(t, x, u, p, jumps, True, omega, at)
                    apply(omega, frame, at)
                    orthonormalize(frame, L[row])
        info[STATUS] = DONE
        return int(times.shape[0])

    return spectrum


def build_returns(integrate: Any) -> Any:
    """The function `returns`: where a motion crosses a plane, upwards, again and again."""

    @njit(error_model="numpy")
    def returns(
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
        bound: Any,
        coordinate: int,
        level: float,
        times: Any,
        states: Any,
        low: Any,
        high: Any,
    ) -> int:
        """Walk from `t0` towards `t1` until `times` is full of crossings; returns their number.

        Parameters
        ----------
        x : ndarray, shape (n,)
            The state, moved on.
        coordinate, level : int, float
            The plane: where ``x[coordinate]`` is `level`.
        times : ndarray, shape (k,)
            Out: when it was crossed upwards.
        states : ndarray, shape (k, n)
            Out: the states there, met by doing the step again up to the crossing.
        low, high : ndarray, shape (n,)
            Out: least and largest value of each state at the ends of steps.
        """
        n = x.shape[0]
        before, again = np.empty(n), np.empty(n)
        held, notes = u.copy(), info.copy()
        found = 0
        for i in range(n):
            low[i], high[i] = x[i], x[i]
        t = t0
        longest = (t1 - t0) / STRIDES
        for _ in range(max_steps):
            if t >= t1 or found == times.shape[0]:
                break
            for i in range(n):
                before[i] = x[i]
            held[:] = u
            status = integrate(t, min(t1, t + longest), x, u, p, atol, rtol, work, info, 1)
            if status != DONE and status != TOO_MANY_STEPS:
                info[STATUS] = status
                return found
            h = info[REACHED] - t
            for i in range(n):
                if not abs(x[i]) <= bound[i]:
                    info[STATUS] = RAN_AWAY
                    return found
                low[i], high[i] = min(low[i], x[i]), max(high[i], x[i])
            if before[coordinate] < level <= x[coordinate]:
                # regula falsi with Illinois' halving, on the step done again
                a, fa = 0.0, before[coordinate] - level
                b, fb = h, x[coordinate] - level
                s = h
                for i in range(n):
                    again[i] = x[i]
                for _ in range(60):
                    if (
                        abs(again[coordinate] - level) <= 1e-3 * atol[coordinate]
                        or b - a <= 1e-15 * t
                    ):
                        break
                    s = b - fb * (b - a) / (fb - fa)
                    for i in range(n):
                        again[i] = before[i]
                    mode = held.copy()
                    notes[:] = info
                    notes[0] = 0.0
                    integrate(t, t + s, again, mode, p, atol, rtol, work, notes, max_steps)
                    f = again[coordinate] - level
                    if f < 0.0:
                        a, fa = s, f
                        fb *= 0.5
                    else:
                        b, fb = s, f
                        fa *= 0.5
                times[found] = t + s
                for i in range(n):
                    states[found, i] = again[i]
                found += 1
            t = info[REACHED]
        info[STATUS] = DONE
        info[REACHED] = t
        return found

    return returns
