"""The friction laws along a given motion, compiled: what the estimator fits.

Between two samples the velocity is taken as constant, and g(v) as moving evenly; then every law
here has an exact step, which is stable however stiff the law is. The equations are those of
``plant``, and a test compares each with a stiff solver on them. Every parameter comes twice, for
motion forwards and backwards.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .compiled import compiled

Vector = npt.NDArray[np.float64]
Bounds = npt.NDArray[np.int64]


@compiled
def lugre_along(
    x: Vector,
    v: Vector,
    step: Vector,
    starts: Bounds,
    shifts: Vector,
    shaking: Vector,
    forwards: Vector,
    backwards: Vector,
    sharpness: float,
    friction: Vector,
    stiffness: Vector,
) -> None:
    """LuGre along several records, laid end to end.

    Parameters
    ----------
    x, v : ndarray, shape (n,)
        Position [m] and velocity [m/s] at the samples.
    step : ndarray, shape (records,)
        Sampling intervals [s].
    starts : ndarray of int, shape (records + 1,)
        First sample of each record; the last entry is n.
    shifts : ndarray, shape (records,)
        Displacement of each record before its first sample, from a state without force [m].
    shaking : ndarray, shape (records,)
        Mean speed of a motion to and fro that the samples do not show; it wears the deflection
        down without getting anywhere [m/s].
    forwards, backwards : ndarray, shape (6,)
        sigma0, sigma1, sigma2, Fc, Fs, Vs. sigma0 goes with the side to which the bristles are
        bent, the others with the direction of motion.
    sharpness : float
        Kv of the modified law [s/m]; 0 for |v| itself.
    friction, stiffness : ndarray, shape (n,)
        Filled with the friction [N] and the slope of its elastic part over displacement [N/m].
    """
    for r in range(len(starts) - 1):
        h = step[r]
        z = 0.0
        for k in range(starts[r] - 1, starts[r + 1]):
            if k >= starts[r]:
                u = v[k]
                q = forwards if u > 0.0 else backwards
                b = forwards if z > 0.0 else backwards
                g = q[3] + (q[4] - q[3]) * math.exp(-((u / q[5]) ** 2))
                if sharpness > 0.0:
                    s = 2.0 / math.pi * math.atan(sharpness * u)
                    rate = s * s * u - b[0] * s * u * z / g
                else:
                    rate = u - b[0] * abs(u) * z / g
                friction[k] = b[0] * z + q[1] * rate + q[2] * u
                stiffness[k] = b[0] * abs(1.0 - (b[0] * z / g if u > 0.0 else -b[0] * z / g))
                if k + 1 == starts[r + 1]:
                    break
                z *= math.exp(-b[0] * shaking[r] * h / q[4])
                d = x[k + 1] - x[k]
            else:
                d = shifts[r]
            if d == 0.0:
                continue
            q = forwards if d > 0.0 else backwards
            s = 1.0 if d > 0.0 else -1.0
            first = q[4]  # the displacement before the record is slow: the bristles feel g(0)
            last = q[4]
            if k >= starts[r]:
                w = d / h
                if sharpness > 0.0:
                    s = 2.0 / math.pi * math.atan(sharpness * w)
                if v[k] * d > 0.0 and v[k + 1] * d > 0.0:
                    first = q[3] + (q[4] - q[3]) * math.exp(-((v[k] / q[5]) ** 2))
                    last = q[3] + (q[4] - q[3]) * math.exp(-((v[k + 1] / q[5]) ** 2))
                else:
                    first = q[3] + (q[4] - q[3]) * math.exp(-((w / q[5]) ** 2))
                    last = first
            g = 0.5 * (first + last)
            way = s * d
            if z * s < 0.0:  # bent to the other side: first back to nothing
                b = backwards if d > 0.0 else forwards
                rest = s * g / b[0]
                back = g / b[0] * math.log(1.0 - z / rest)
                if back >= way:
                    z = rest + (z - rest) * math.exp(-b[0] * way / g)
                    continue
                way -= back
                z = 0.0
            # towards a rest that moves evenly from that of the first velocity to the last's
            run = q[0] * way / g
            if run == 0.0:
                continue
            gone = -math.expm1(-run)
            begin, end = s * first / q[0], s * last / q[0]
            z = end + (z - begin) * (1.0 - gone) - (end - begin) * gone / run


@compiled
def dahl_along(
    x: Vector,
    v: Vector,
    step: Vector,
    starts: Bounds,
    shifts: Vector,
    shaking: Vector,
    forwards: Vector,
    backwards: Vector,
    friction: Vector,
    stiffness: Vector,
) -> None:
    """Dahl (parameters sigma, Fc, alpha) along several records; see `lugre_along`."""
    for r in range(len(starts) - 1):
        f = 0.0
        for k in range(starts[r] - 1, starts[r + 1]):
            if k >= starts[r]:
                friction[k] = f
                q = forwards if v[k] > 0.0 else backwards
                left = 1.0 - f / q[1] if v[k] > 0.0 else 1.0 + f / q[1]
                stiffness[k] = q[0] * max(left, 0.0) ** q[2]
                if k + 1 == starts[r + 1]:
                    break
                f *= math.exp(-q[0] * shaking[r] * step[r] / q[1])
                d = x[k + 1] - x[k]
            else:
                d = shifts[r]
            if d == 0.0:
                continue
            q = forwards if d > 0.0 else backwards
            s = 1.0 if d > 0.0 else -1.0
            left = max(1.0 - s * f / q[1], 0.0)
            run = q[0] / q[1] * abs(d)
            if abs(q[2] - 1.0) < 1e-9:
                left *= math.exp(-run)
            elif left > 0.0:
                base = left ** (1.0 - q[2]) - (1.0 - q[2]) * run
                left = base ** (1.0 / (1.0 - q[2])) if base > 0.0 else 0.0
            f = s * q[1] * (1.0 - left)


@compiled
def bliman_sorine_along(
    x: Vector,
    v: Vector,
    step: Vector,
    starts: Bounds,
    shifts: Vector,
    shaking: Vector,
    forwards: Vector,
    backwards: Vector,
    friction: Vector,
    stiffness: Vector,
) -> None:
    """Bliman-Sorine (f1, f2, eps_f, eta) along several records; see `lugre_along`."""
    for r in range(len(starts) - 1):
        one = 0.0
        two = 0.0
        for k in range(starts[r] - 1, starts[r + 1]):
            if k >= starts[r]:
                friction[k] = one + two
                q = forwards if v[k] > 0.0 else backwards
                s = 1.0 if v[k] > 0.0 else -1.0
                stiffness[k] = abs((q[0] - s * one) / (q[3] * q[2]) - (q[1] + s * two) / q[2])
                if k + 1 == starts[r + 1]:
                    break
                one *= math.exp(-shaking[r] * step[r] / (q[3] * q[2]))
                two *= math.exp(-shaking[r] * step[r] / q[2])
                d = x[k + 1] - x[k]
            else:
                d = shifts[r]
            if d == 0.0:
                continue
            q = forwards if d > 0.0 else backwards
            s = 1.0 if d > 0.0 else -1.0
            slow = math.exp(-abs(d) / q[2])
            fast = math.exp(-abs(d) / (q[2] * q[3]))
            one = s * q[0] + (one - s * q[0]) * fast
            two = -s * q[1] + (two + s * q[1]) * slow


@compiled
def score(
    force: Vector,
    predicted: Vector,
    spread: Vector,
    count: float,
    gradient: npt.NDArray[np.float64],
    information: npt.NDArray[np.float64],
    cost_only: bool,
) -> float:
    """Minus the log-likelihood of force samples that were rounded to counts.

    Parameters
    ----------
    force, predicted, spread : ndarray, shape (n,)
        Measured and predicted force and the standard deviation before rounding [N].
    count : float
        Resolution of the load cell [N]; 0 for none.
    gradient : ndarray, shape (2, n)
        Filled with the derivatives of the log-likelihood by the prediction and by the spread [1/N].
    information : ndarray, shape (3, n)
        Filled with the expected products of these two: prediction twice, both, spread twice
        [1/N^2], unless `cost_only`.
    """
    total = 0.0
    root2 = math.sqrt(2.0)
    bell = 1.0 / math.sqrt(2.0 * math.pi)
    # a density times the count is the probability of the count
    density = math.log(bell) + (math.log(count) if count > 0.0 else 0.0)
    for k in range(len(force)):
        s = spread[k]
        off = force[k] - predicted[k]
        if count <= 0.3 * s:  # finer than the noise: rounding is one more variance
            variance = s * s + count * count / 12.0
            total += 0.5 * off * off / variance + 0.5 * math.log(variance) - density
            gradient[0, k] = off / variance
            gradient[1, k] = (off * off / variance - 1.0) * s / variance
            information[0, k] = 1.0 / variance
            information[1, k] = 0.0
            information[2, k] = 2.0 * s * s / (variance * variance)
            continue
        high = (off + 0.5 * count) / s
        low = (off - 0.5 * count) / s
        # the tail on the far side keeps its digits
        if low > 0.0:
            mass = 0.5 * (math.erfc(low / root2) - math.erfc(high / root2))
        else:
            mass = 0.5 * (math.erfc(-high / root2) - math.erfc(-low / root2))
        if mass > 1e-250:
            total -= math.log(mass)
            at_low = bell * math.exp(-0.5 * low * low) / s
            at_high = bell * math.exp(-0.5 * high * high) / s
            gradient[0, k] = (at_low - at_high) / mass
            gradient[1, k] = (low * at_low - high * at_high) / mass
        else:  # far out: the nearest edge of the count decides
            edge = low if low > 0.0 else high
            total += 0.5 * edge * edge + math.log(abs(edge)) - math.log(bell)
            gradient[0, k] = edge / s
            gradient[1, k] = edge * edge / s
        if cost_only:
            continue
        # expected information: sum over all counts that the sample might have fallen into
        reach = math.ceil(5.0 * s / count) + 1
        first = math.floor(off / count + 0.5)
        shift = off - first * count
        twice = 0.0
        both = 0.0
        spread_twice = 0.0
        for j in range(-reach, reach + 1):
            b = (shift + (j + 0.5) * count) / s
            a = (shift + (j - 0.5) * count) / s
            if a > 0.0:
                chance = 0.5 * (math.erfc(a / root2) - math.erfc(b / root2))
            else:
                chance = 0.5 * (math.erfc(-b / root2) - math.erfc(-a / root2))
            if chance > 1e-12:
                at_a = bell * math.exp(-0.5 * a * a) / s
                at_b = bell * math.exp(-0.5 * b * b) / s
                moved = at_a - at_b
                widened = a * at_a - b * at_b
                twice += moved * moved / chance
                both += moved * widened / chance
                spread_twice += widened * widened / chance
        information[0, k] = twice
        information[1, k] = both
        information[2, k] = spread_twice
    return total
