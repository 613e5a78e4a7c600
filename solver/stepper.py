"""The compiled core's stiff stepper, written a second time in plain Python.

An FMU made by pythonfmu uses it if its equations were edited, or if the core's library cannot be
loaded. It is also the reference for tests of the core: both give the same numbers. It is about
forty times slower. This file imports only `core` and `plain_delays`: all are part of every exported
FMU.

The method is Rodas5P (G. Steinebach, BIT Numer. Math. 63, 27 (2023)): eight stages, order five
with an embedded fourth-order solution, stiffly accurate, L-stable, one matrix factorization a
step. It needs the exact Jacobian and the partial derivative by time, which the generated
equations deliver. Order and L-stability are measured in ``tests/solver/test_stepper.py``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .core import (
    ACCEPTED,
    CHATTER,
    DONE,
    EVENTS,
    LAST_ERROR,
    NEXT_STEP,
    NO_DELAY,
    NOT_FINITE,
    REACHED,
    REJECTED,
    STAGES,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    new_history,
)
from .plain_delays import PlainDelays

GAMMA = 0.21193756319429014
_A6 = (
    -7.502846399306121,
    2.561846144803919,
    -11.627539656261098,
    -0.18268767659942256,
    0.030198172008377946,
)


A: tuple[tuple[float, ...], ...] = (
    (),
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    _A6,
    (*_A6, 1.0),
    (*_A6, 1.0, 1.0),
)
C: tuple[tuple[float, ...], ...] = (
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

# of the dense output, of order four
WITHIN = (
    (
        25.948786856663858,
        -2.5579724845846235,
        10.433815404888879,
        -2.3679251022685204,
        0.524948541321073,
        1.1241088310450404,
        0.4272876194431874,
        -0.17202221070155493,
    ),
    (
        -9.91568850695171,
        -0.9689944594115154,
        3.0438037242978453,
        -24.495224566215796,
        20.176138334709044,
        15.98066361424651,
        -6.789040303419874,
        -6.710236069923372,
    ),
    (
        11.419903575922262,
        2.8879645146136994,
        72.92137995996029,
        80.12511834622643,
        -52.072871366152654,
        -59.78993625266729,
        -0.15582684282751913,
        4.883087185713722,
    ),
)

# kinds of events: a crossing either way; one that changes the mode; one that only resets the state
EITHER, CHANGES_MODE, RESETS = 0, 1, 2
MOST_AT_ONCE = 64  # events at one instant
INSIDE = 4  # parts of a step at whose ends crossings are searched

Row = list[float]


def factorize(w: list[Row], pivots: list[int]) -> bool:
    """Replace a square matrix by its LU factors with row pivoting; False if singular.

    The diagonal has the inverses of the pivots.
    """
    n = len(w)
    for k in range(n):
        row = max(range(k, n), key=lambda i: abs(w[i][k]))
        best = abs(w[row][k])
        if not best > 0.0 or best == math.inf:
            return False
        pivots[k] = row
        w[k], w[row] = w[row], w[k]
        inverse = 1.0 / w[k][k]
        for i in range(k + 1, n):
            w[i][k] *= inverse
            factor = w[i][k]
            if factor != 0.0:
                for j in range(k + 1, n):
                    w[i][j] -= factor * w[k][j]
        w[k][k] = inverse
    return True


def solve_factorized(w: list[Row], pivots: list[int], b: Row) -> None:
    """Solve for the right-hand side `b`, in place, with the factors made by `factorize`."""
    n = len(b)
    for k in range(n):
        b[k], b[pivots[k]] = b[pivots[k]], b[k]
    for k in range(n):
        for i in range(k + 1, n):
            b[i] -= w[i][k] * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= w[k][j] * b[j]
        b[k] *= w[k][k]


class PlainSystem:
    """As `core.System`, for the functions of a generated text.

    Parameters
    ----------
    functions : mapping or namespace of str to function
        Those of `core.FUNCTIONS`.
    states, events : int
        Number of states, and largest number of events in a mode.
    """

    def __init__(self, functions: Any, states: int, events: int) -> None:
        self.states, self.events = states, events
        layout = getattr(functions, "DELAYS", None)
        self.f = PlainDelays(functions, *layout) if layout else functions
        self._late: PlainDelays | None = self.f if layout else None

    @property
    def history(self) -> Any:
        """As that of `core.System`."""
        return self._late.history if self._late else np.zeros(0)

    def forget(self) -> None:
        """As `core.System.forget`."""
        if self._late:
            self._late.history = new_history(self._late.count, self._late.held)

    def remember(self, history: Any) -> None:
        """As `core.System.remember`."""
        if self._late:
            self._late.history = history.copy()

    def out(self, t: float, x: Any, u: Any, p: Any, y: Any) -> None:
        """Write the outputs."""
        self.f.out(t, x, u, p, y)

    def instance(self, x: Any, u: Any, p: Any, y: Any, atol: Any, info: Any) -> PlainInstance:
        """As `core.System.instance`."""
        return PlainInstance(self, x, u, p, y, atol, info)

    def sample(self, t: float, x: Any, u: Any, p: Any, d: Any) -> None:
        """Write the next discrete states."""
        self.f.sample(t, x, u, p, d)

    # -- steps -----------------------------------------------------------------------------------

    def _linearize(self, t: float, x: Row) -> None:
        """The Jacobian here; entries that depend on no state have no round-off from others."""
        matrix, self._by_time = np.zeros((self.states, self.states)), [0.0] * self.states
        self.f.jac(t, x, self._u, self._p, matrix, self._by_time)
        self._jacobian = matrix.tolist()
        self._alone = [not any(row) for row in self._jacobian]

    def _rates(self, t: float, x: Row) -> Row:
        slope = [0.0] * self.states
        self.f.rhs(t, x, self._u, self._p, slope)
        return slope

    def _attempt(self, t: float, h: float, x: Row) -> tuple[float, Row]:
        """One step from `x`: the error estimate in units of the tolerance, and the new state.

        The error is infinite if the step fails.
        """
        n = self.states
        w = [[-value for value in row] for row in self._jacobian]
        per_time = 1.0 / h
        for i in range(n):
            w[i][i] += 1.0 / (GAMMA * h)
        pivots = [0] * n
        if not factorize(w, pivots):
            return math.inf, x
        k: list[Row] = []
        stage = x
        for s in range(STAGES):
            stage = list(x)
            for weight, row in zip(A[s], k, strict=False):
                stage = [value + weight * rate for value, rate in zip(stage, row, strict=True)]
            slope = self._rates(t + NODES[s] * h, stage)
            now = [
                value + h * TIME[s] * by_time
                for value, by_time in zip(slope, self._by_time, strict=True)
            ]
            for weight, row in zip(C[s], k, strict=False):
                now = [
                    value + weight * per_time * rate for value, rate in zip(now, row, strict=True)
                ]
            solved = list(now)
            solve_factorized(w, pivots, solved)
            k.append(
                [
                    right * GAMMA * h if alone else value
                    for alone, right, value in zip(self._alone, now, solved, strict=True)
                ]
            )
        new = [value + rate for value, rate in zip(stage, k[-1], strict=True)]
        total = 0.0
        for i in range(n):
            scale = self._atol[i] + self._rtol * max(abs(x[i]), abs(new[i]))
            share = k[-1][i] / scale
            total += share * share  # pow(share, 2.0) may be off by a last digit
        self._taken = x, new, k
        return math.sqrt(total / (n or 1)), new

    def _dense(self, q: float) -> Row:
        """The state at the share `q` of the last attempted step."""
        x, new, k = self._taken
        if q in (0.0, 1.0):
            return new if q else x
        found = []
        for i in range(self.states):
            bends = [0.0, 0.0, 0.0]
            for order, weights in enumerate(WITHIN):
                for weight, row in zip(weights, k, strict=True):
                    bends[order] += weight * row[i]
            within = bends[0] + q * (bends[1] + q * bends[2])
            found.append((1.0 - q) * x[i] + q * (new[i] + (1.0 - q) * within))
        return found

    def advance(  # noqa: PLR0913, PLR0915
        self,
        t0: float,
        t1: float,
        x: Any,
        u: Any,
        p: Any,
        atol: Any,
        rtol: float,
        info: Any,
        max_steps: int,
    ) -> int:
        """As `core.System.advance`."""
        late = self._late
        info[REACHED] = t0
        if late and not late.begin(t0, x, u, p):
            return NO_DELAY
        if self.settle(t0, x, u, p, info) != DONE:
            return CHATTER
        info[REACHED] = t1
        span = t1 - t0
        if (self.states == 0 and not late) or span == 0.0:
            return DONE
        self._u, self._p, self._atol, self._rtol = u, p, list(atol), rtol
        smallest = 1e-13 * max(abs(t0), abs(t1), span)
        h = float(info[NEXT_STEP])
        if not h > smallest or h > span:  # the previous step may have been tiny
            h = span
        t = t0
        last_error = float(info[LAST_ERROR]) if info[LAST_ERROR] > 0.0 else 1e-4
        info[LAST_ERROR] = 0.0
        fresh = True  # the Jacobian belongs to the present point
        rejected_before = False
        last_event = -math.inf  # when
        still = 0  # events since time last advanced between two of them
        for _ in range(max_steps):
            if late and not late.has_room():
                late.make_room()
            goal = late.latest_end(t, t1) if late else t1
            remaining = goal - t
            if h < smallest and h < remaining:
                info[NEXT_STEP], info[REACHED] = h, t
                return STEP_TOO_SMALL
            # A tiny last step would cost as much as a full one: stretch or halve instead.
            final = False
            planned = h
            if h >= remaining * 0.99999:
                h = remaining
                final = True
            elif h > 0.6 * remaining:
                h = 0.5 * remaining
            before = [float(value) for value in x]
            if fresh:
                self._linearize(t, before)
                fresh = False
            error, new = self._attempt(t, h, before)
            if late and error <= 1.0:
                error = max(error, late.follow(t, h, self._dense, u, p, rtol))
            if error <= 1.0:  # false for NaN, too
                taken, found = h, -1
                if self.events > 0:
                    taken, new, found = self._locate(t, h, before, new)
                if late and taken > 0.0:
                    if taken != h:
                        late.follow(t, taken, self._dense, u, p, rtol)
                    end = goal if final and taken == h else t + taken
                    late.keep(t, end, before, u, p)
                x[:] = new
                info[ACCEPTED] += 1
                fresh = True
                if found >= 0:
                    t = goal if final and taken == h else t + taken
                    still = 0 if t - last_event > smallest else still + 1
                    last_event = t
                    self.f.react(t, x, u, p, found)
                    info[EVENTS] += 1
                    if still > MOST_AT_ONCE or self.settle(t, x, u, p, info) != DONE:
                        info[REACHED] = t
                        return CHATTER
                    h = planned
                    last_error = 1e-4
                    rejected_before = False
                    if t >= t1:
                        info[NEXT_STEP] = h
                        return DONE
                    continue
                t = goal if final else t + h
                error = max(error, 1e-10)
                # proportional-integral control (Gustafsson) keeps rejections rare
                growth = 0.9 * error**-0.17 * last_error**0.06
                growth = min(6.0, max(0.2, growth))
                if rejected_before:
                    growth = min(growth, 1.0)
                last_error = max(error, 1e-4)
                rejected_before = False
                h = max(planned, h * growth) if final and growth >= 1.0 else h * growth
                if t >= t1:
                    info[NEXT_STEP] = h
                    return DONE
            else:
                info[REJECTED] += 1
                rejected_before = True
                h *= max(0.1, 0.9 * error**-0.2) if error < math.inf else 0.1
        info[NEXT_STEP], info[REACHED], info[LAST_ERROR] = h, t, last_error
        return TOO_MANY_STEPS

    # -- events ----------------------------------------------------------------------------------

    def settle(self, t: float, x: Any, u: Any, p: Any, info: Any) -> int:
        """Handle every event that is due now; return `DONE` or `CHATTER`."""
        if self.events == 0:
            return DONE
        fired = [False] * self.events
        for _ in range(MOST_AT_ONCE):
            g = [0.0] * self.events
            self.f.indicate(t, x, u, p, g)
            kinds = [self.f.kind(u, k) for k in range(self.events)]
            due = [
                k
                for k, what in enumerate(kinds)
                if g[k] > 0.0 and what != EITHER and not (what == RESETS and fired[k])
            ]
            if not due:
                return DONE
            if kinds[due[0]] == RESETS:
                fired[due[0]] = True
            else:
                fired = [False] * self.events
            self.f.react(t, x, u, p, due[0])
            info[EVENTS] += 1
        info[REACHED] = t
        return CHATTER

    def _due_at(self, t: float, x: Row, before: Row) -> int:
        """The event whose indicator is furthest past zero and was not before; -1 if there is none.

        `before` holds the signs at the start of the step: an event that was due then, or has
        direction 0 and starts at zero, is not searched.
        """
        g = [0.0] * self.events
        self.f.indicate(t, x, self._u, self._p, g)
        best, found = 0.0, -1
        for k in range(self.events):
            what = self.f.kind(self._u, k)
            past = -g[k] * before[k] if what == EITHER else g[k]
            if what != EITHER and before[k] > 0.0:
                past = 0.0
            if past > best:
                best, found = past, k
        return found

    def _locate(self, t: float, h: float, x: Row, end: Row) -> tuple[float, Row, int]:
        """The part of a step that ends at its first event: length, state there, and the event.

        The whole step and -1 if there is none. The crossing is bracketed to the last digits
        of the time by repeating the step with shorter lengths, so the event has the accuracy
        of the step itself. An event that changes the mode, or has direction 0, happens just after
        the crossing; one that only resets the state happens just before it, so that the reset finds
        its indicator on the original side.
        """
        before = [0.0] * self.events
        self.f.indicate(t, x, self._u, self._p, before)
        for k in range(self.events):
            if self.f.kind(self._u, k) == EITHER:
                before[k] = 1.0 if before[k] > 0.0 else (-1.0 if before[k] < 0.0 else 0.0)
        # The cubic Hermite polynomial through both ends shows two crossings within one step.
        first, last = self._rates(t, x), self._rates(t + h, end)
        high = -1.0
        for part in range(1, INSIDE):
            s = part / INSIDE
            middle = [
                (1.0 + 2.0 * s) * ((1.0 - s) * (1.0 - s)) * x[i]
                + s * ((1.0 - s) * (1.0 - s)) * h * first[i]
                + s * s * (3.0 - 2.0 * s) * end[i]
                + s * s * (s - 1.0) * h * last[i]
                for i in range(self.states)
            ]
            if self._due_at(t + s * h, middle, before) >= 0:
                _, again = self._attempt(t, s * h, x)
                if self._due_at(t + s * h, again, before) >= 0:
                    high = s * h
                    break
        if high < 0.0:
            if self._due_at(t + h, end, before) < 0:
                if self._late:  # shorter attempts have overwritten its stages
                    self._attempt(t, h, x)
                return h, end, -1
            high = h
        low = 0.0
        while high - low > 2.3e-16 * max(abs(t), high):
            half = 0.5 * (low + high)
            if not low < half < high:
                break
            _, state = self._attempt(t, half, x)
            if self._due_at(t + half, state, before) >= 0:
                high = half
            else:
                low = half
        _, state = self._attempt(t, high, x)
        found = self._due_at(t + high, state, before)
        if found >= 0 and self.f.kind(self._u, found) == RESETS:
            high = low
            state = self._attempt(t, low, x)[1] if low > 0.0 else x
        return high, state, found


class EditedSystem(PlainSystem):
    """A system whose text was edited.

    Its Jacobian is computed by differences: a user edits ``rhs`` and not ``jac``.
    """

    def _linearize(self, t: float, x: Row) -> None:
        here, columns = self._rates(t, x), []
        for j, value in enumerate(x):
            step = 1e-8 * max(abs(value), float(self._atol[j]) / self._rtol)
            beside = [*x[:j], value + step, *x[j + 1 :]]
            rates = self._rates(t, beside)
            columns.append([(b - a) / step for a, b in zip(here, rates, strict=True)])
        step = 1e-8 * max(abs(t), 1.0)
        later = self._rates(t + step, x)
        self._by_time = [(b - a) / step for a, b in zip(here, later, strict=True)]
        self._jacobian = [list(row) for row in zip(*columns, strict=True)]
        self._alone = [not any(row) for row in self._jacobian]


class PlainInstance:
    """As `core.Instance`."""

    def __init__(self, system: PlainSystem, *given: Any) -> None:
        self._system, self._given = system, given

    def advance(self, t0: float, t1: float, rtol: float, max_steps: int) -> int:
        x, u, p, _, atol, info = self._given
        status = self._system.advance(t0, t1, x, u, p, atol, rtol, info, max_steps)
        return NOT_FINITE if status == DONE and not all(map(math.isfinite, x)) else status

    def out(self, t: float) -> None:
        x, u, p, y, _, _ = self._given
        self._system.out(t, x, u, p, y)
