"""An explicit pair for what is not stiff: motion and tangents as one smooth system.

Like the stepper's, this file's text goes into generated modules, after the equations that it is
for; the number of states is a constant there, so that loops over them are unrolled.

The method is the eighth-order pair of Dormand and Prince with error estimates of orders five and
three (E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, Springer
1993, Section II.10), and so is the test for steps that stability limits, not accuracy. Steps are as
short as motion and tangents need; the tangents are orthonormalized after each. The trace is
integrated beside them. Where stability, or a tangent far faster than the motion, sets the length of
many steps in a row, the motion is left to the stiff stepper.
"""
# mypy: disallow-untyped-decorators=False
# (numba has no types)

import math
from typing import Any

import numpy as np
from numba import njit

from .propagation import orthonormalize
from .stepper import (
    ACCEPTED,
    DONE,
    NEXT_STEP,
    REACHED,
    REJECTED,
    STATUS,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
)
from .tangents import RAN_AWAY

STIFF = 5  # a status, beside the stepper's
LIMITED = 6.1  # step times fastest rate, about where stability ends
CALM = 1e-8  # share of the motion's in a step's error: alone it would take steps ten times as long
TELLING = 1e-2  # error below which it was not this step's length that the tolerance set
IN_A_ROW = 15  # such steps until a motion counts as stiff
FORGIVEN = 6  # others in a row until they are forgotten
SAFETY, SHRINK, GROW = 0.9, 0.3, 6.0  # of a step's change
LAST = 12  # the stage at the step's end

# Where the stages are, the last at the step's end; and the weights, without their zeros, of the
# rates of those before in each stage but the first, and in the errors of orders five and three.
PLACES = (
    0.0,
    0.05260015195876773,
    0.0789002279381516,
    0.1183503419072274,
    0.2816496580927726,
    0.3333333333333333,
    0.25,
    0.3076923076923077,
    0.6512820512820513,
    0.6,
    0.8571428571428571,
    1.0,
    1.0,
)
_WEIGHTS = (
    (0.05260015195876773,),
    (0.0197250569845379, 0.0591751709536137),
    (0.02958758547680685, 0.08876275643042054),
    (0.2413651341592667, -0.8845494793282861, 0.924834003261792),
    (0.037037037037037035, 0.17082860872947386, 0.12546768756682242),
    (0.037109375, 0.17025221101954405, 0.06021653898045596, -0.017578125),
    (
        0.03709200011850479,
        0.17038392571223998,
        0.10726203044637328,
        -0.015319437748624402,
        0.008273789163814023,
    ),
    (
        0.6241109587160757,
        -3.3608926294469414,
        -0.868219346841726,
        27.59209969944671,
        20.154067550477894,
        -43.48988418106996,
    ),
    (
        0.47766253643826434,
        -2.4881146199716677,
        -0.590290826836843,
        21.230051448181193,
        15.279233632882423,
        -33.28821096898486,
        -0.020331201708508627,
    ),
    (
        -0.9371424300859873,
        5.186372428844064,
        1.0914373489967295,
        -8.149787010746927,
        -18.52006565999696,
        22.739487099350505,
        2.4936055526796523,
        -3.0467644718982196,
    ),
    (
        2.273310147516538,
        -10.53449546673725,
        -2.0008720582248625,
        -17.9589318631188,
        27.94888452941996,
        -2.8589982771350235,
        -8.87285693353063,
        12.360567175794303,
        0.6433927460157636,
    ),
    (
        0.054293734116568765,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        0.3111643669578199,
        -0.1521609496625161,
        0.20136540080403034,
        0.04471061572777259,
    ),
    (
        0.01312004499419488,
        -1.2251564463762044,
        -0.4957589496572502,
        1.6643771824549864,
        -0.35032884874997366,
        0.3341791187130175,
        0.08192320648511571,
        -0.022355307863886294,
    ),
    (
        -0.18980075407240762,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        -0.4226823213237919,
        -0.1521609496625161,
        0.20136540080403034,
        0.02265179219836082,
    ),
)
FIFTH = 13  # and the row after it


def _table() -> Any:
    table = np.zeros((FIFTH + 2, LAST))
    for k, row in enumerate(_WEIGHTS, start=1):
        end = min(k, LAST)
        table[k, [0, *range(end - len(row) + 1, end)]] = row
    return table


WEIGHTS = _table()


def explicit_work_size(n: int) -> int:
    """Number of floats of scratch memory for `n` states and as many tangents."""
    return 18 * (n + n * n) + n * n + 4 * n + 2


@njit(error_model="numpy")
def weigh(row: int, k: Any, h: float, out: Any) -> None:
    """Add the rates `k` with the weights of a row of the table, times `h`, to `out`."""
    for s in range(LAST):
        weight = h * WEIGHTS[row, s]
        if weight != 0.0:
            for i in range(out.shape[0]):
                out[i] += weight * k[s, i]


@njit(error_model="numpy")
def mixed(five: float, three: float) -> float:
    """One error from the squares of those of orders five and three, as Hairer mixes them."""
    both = five + 0.01 * three
    return five / math.sqrt(both) if both > 0.0 else five


def build_explicit(rhs: Any, jac: Any, n: int) -> Any:
    """The functions `walk` and `integrate` for one system of equations without events.

    Parameters
    ----------
    rhs, jac : functions
        As in `stepper.build`.
    n : int
        Number of states.

    Returns
    -------
    tuple of two functions
        One for state and tangents, one like the stepper's; both may end with the status ``STIFF``.
    """

    @njit(error_model="numpy")
    def turn(j: Any, tangents: Any, k: Any) -> None:
        """Multiply all tangents, which stand behind a state each, by the Jacobian."""
        for row in range(n, k.shape[0], n):
            for a in range(n):
                total = 0.0
                for b in range(n):
                    total += j[a, b] * tangents[row + b]
                k[row + a] = total

    @njit(error_model="numpy")
    def slopes(t: float, w: Any, u: Any, p: Any, j: Any, by_time: Any, k: Any) -> float:
        """Write the rates of state and tangents to `k`; returns the Jacobian's trace."""
        rhs(t, w[:n], u, p, k[:n])
        trace = 0.0
        if k.shape[0] > n:
            jac(t, w[:n], u, p, j, by_time)
            turn(j, w, k)
            for a in range(n):
                trace += j[a, a]
        return trace

    @njit(error_model="numpy")
    def error_of(
        w: Any, new: Any, logs: Any, errors: Any, atol: Any, rtol: float, scale: Any
    ) -> tuple[float, float]:
        """Error estimates of the state, and the worst of all, in units of the tolerance.

        A tangent's is taken relative to its whole length in the states' units, and to what is left
        of it without the directions before it, whose logarithm is wanted.
        """
        own, worst = 0.0, 0.0
        for row in range(0, new.shape[0], n):
            a5, a3, b5, b3, length = 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(row, row + n):
                unit = scale[i - row]
                if row == 0:
                    unit = math.sqrt(n) * (atol[i] + rtol * max(abs(w[i]), abs(new[i])))
                a5 += (errors[0, i] / unit) ** 2
                a3 += (errors[1, i] / unit) ** 2
                length += (new[i] / unit) ** 2
                b5 += errors[0, i] ** 2
                b3 += errors[1, i] ** 2
            if row == 0:
                own = worst = mixed(a5, a3)
            else:
                whole = mixed(a5, a3) / (rtol * math.sqrt(length))
                left = mixed(b5, b3) / (rtol * math.exp(logs[row // n - 1]))
                if not max(whole, left) <= worst:  # NaN is the worst of all
                    worst = max(whole, left)
        return own, worst

    @njit(error_model="numpy")
    def walk(
        t0: float,
        t1: float,
        w: Any,
        sums: Any,
        u: Any,
        p: Any,
        atol: Any,
        rtol: float,
        work: Any,
        info: Any,
        max_steps: int,
        bound: Any,
        scale: Any,
    ) -> float:
        """Advance state and tangents from `t0` to `t1`, in place; returns the trace's integral.

        Parameters
        ----------
        w : ndarray, shape (n + count n,)
            The state and behind it the tangents, a row each.
        sums : ndarray, shape (count,)
            Their logarithms are added to these.
        work : ndarray, shape (explicit_work_size(n),)
            Keeps how many of the last steps were limited by stability.
        info : ndarray, shape (INFO_SIZE,)
            As the stepper's; the status is in ``info[STATUS]``.
        """
        m, count = w.shape[0], sums.shape[0]
        k = work[: 13 * m].reshape((13, m))
        at, new = work[13 * m : 14 * m], work[14 * m : 15 * m]
        errors = work[15 * m : 17 * m].reshape((2, m))
        base = 18 * (n + n * n)
        j = work[base : base + n * n].reshape((n, n))
        base += n * n
        by_time, logs = work[base : base + n], work[base + n : base + n + count]
        limited = work[base + 2 * n : base + 2 * n + 2]  # in a row, and others since
        frame = work[17 * m : 17 * m + count * n].reshape((count, n))
        info[STATUS] = DONE
        info[REACHED] = t1
        span = t1 - t0
        if not span > 0.0:
            return 0.0
        total = 0.0
        t, h = t0, info[NEXT_STEP]
        start = slopes(t, w, u, p, j, by_time, k[0])
        here = start
        if not h > 0.0:  # a hundredth of the time in which the state changes by its size
            size, speed = 0.01, 0.0
            for i in range(n):
                size = max(size, abs(w[i]) / scale[i])
                speed = max(speed, abs(k[0, i]) / scale[i])
            h = 0.01 * size / speed if speed > 0.0 else span
        smallest = 1e-13 * max(abs(t0), abs(t1), span)
        rejected = False
        status = TOO_MANY_STEPS
        for _ in range(max_steps):
            remaining = t1 - t
            if h < smallest and h < remaining:
                status = STEP_TOO_SMALL
                break
            planned, final = h, False
            if h >= remaining * 0.99999:
                h, final = remaining, True
            elif h > 0.6 * remaining:
                h = 0.5 * remaining
            trace = 0.0
            for s in range(1, LAST + 1):
                trace += WEIGHTS[LAST, s - 1] * here
                where = at if s < LAST else new
                for i in range(m):
                    where[i] = w[i]
                weigh(s, k, h, where)
                here = slopes(t + PLACES[s] * h, where, u, p, j, by_time, k[s])
            for estimate in range(2):
                for i in range(m):
                    errors[estimate, i] = 0.0
                weigh(FIFTH + estimate, k, h, errors[estimate])
            for row in range(count):
                logs[row] = 0.0
                for i in range(n):
                    frame[row, i] = new[(row + 1) * n + i]
            if count > 0:
                orthonormalize(frame, logs)
            own, error = error_of(w, new, logs, errors, atol, rtol, scale)
            if not error <= 1.0:  # for NaN, too
                info[REJECTED] += 1
                rejected = True
                h *= max(SHRINK, SAFETY * error**-0.125) if error < math.inf else 0.1
                here = start
                continue
            # The last two stages are both at the step's end. How far their rates are apart, over
            # how far they are themselves, says how fast the fastest there is.
            apart, change = 0.0, 0.0
            for row in range(0, m, n):
                for i in range(n):
                    apart += ((new[row + i] - at[row + i]) / scale[i]) ** 2
                    change += ((k[LAST, row + i] - k[LAST - 1, row + i]) / scale[i]) ** 2
            unstable = apart > 0.0 and h * h * change > LIMITED * LIMITED * apart
            if unstable or (error > TELLING and own < CALM * error):
                limited[0] += 1.0
                limited[1] = 0.0
            else:
                limited[1] += 1.0
                if limited[1] >= FORGIVEN:
                    limited[0] = 0.0
            for i in range(n):
                w[i] = new[i]
                k[0, i] = k[LAST, i]
            for row in range(count):
                sums[row] += logs[row]
                for i in range(n):
                    w[(row + 1) * n + i] = frame[row, i]
            turn(j, w, k[0])
            start = here
            total += h * trace
            info[ACCEPTED] += 1
            t = t1 if final else t + h
            growth = min(GROW, max(SHRINK, SAFETY * max(error, 1e-12) ** -0.125))
            if rejected:
                growth = min(growth, 1.0)
            rejected = False
            if final:
                status = DONE
                h = max(planned, h * growth) if growth >= 1.0 else h * growth
            else:
                h *= growth
            for i in range(n):
                if not abs(w[i]) <= bound[i]:
                    status = RAN_AWAY
            if limited[0] >= IN_A_ROW and status != RAN_AWAY:
                status = STIFF
            if status != TOO_MANY_STEPS:
                break
        info[NEXT_STEP], info[REACHED], info[STATUS] = h, t, status
        return total

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
        """As the stepper's."""
        end = work.shape[0]
        bound, scale = work[end - n :], work[end - 2 * n : end - n]
        for i in range(n):
            bound[i], scale[i] = math.inf, atol[i] / rtol
        walk(t0, t1, x, work[:0], u, p, atol, rtol, work, info, max_steps, bound, scale)
        return int(info[STATUS])

    return walk, integrate
