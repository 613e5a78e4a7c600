"""Motions, cycles and basins of the friction oscillator on a belt, with closed forms."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from scipy.special import lambertw

import ballscrew

from ..drawing import part

FALLING, CLASSICAL, COULOMB, LUGRE, DAHL = (
    part(__file__, name)
    for name in ("belt", "belt_classical", "belt_coulomb", "belt_lugre", "belt_dahl")
)
FC, FS, V0, DAMPING = 0.5, 1.0, 0.5, 0.1  # of all five belts [N, m/s, N*s/m]; m = 1 kg, k = 1 N/m
SPEED = 1.5
TURN = 9.0  # longer than the time from leaving the belt to sticking again [s]
SIGMA0, SIGMA1 = 1e3, 10.0  # N/m and N*s/m, of `belt_lugre`
SMALL = 1e-3  # amplitudes, over the belt's speed, that grow as in the linear part
REGION = 2.0  # [m] and [m/s]: bSTAB's starts are |x| < 2 m, 0 < v < 2 m/s
Curve = Callable[[float], float]


def falling(speed: float) -> float:
    """Friction of `belt` at a sliding speed [N]."""
    return FC + (FS - FC) * float(np.exp(-speed / V0))


def classical(speed: float) -> float:
    """Friction of `belt_classical`, and of `belt_lugre` in steady sliding [N]."""
    return FC + (FS - FC) * float(np.exp(-((speed / V0) ** 2)))


@cache
def motion(belt: str, stop: float, step: float, **values: float) -> Any:
    """A motion, with given parameters and start values of states."""
    coupling = ballscrew.Coupling("monolithic")
    return ballscrew.run(
        "none", belt, stop=stop, step=step, coupling=coupling, plant_values=values
    ).run


@cache
def verdict(belt: str, **values: float) -> Any:
    return ballscrew.lyapunov("none", belt, stop=60.0, plant_values=values).motion


def turn(belt: str, curve: Curve, speed: float, swing: float) -> tuple[float, Any]:
    """Length of a turn around the equilibrium [s], and the position from there as a spline.

    Parameters
    ----------
    swing : float
        Speed at the equilibrium at the start of the turn [m/s].
    """
    rest = curve(speed)
    held = {"z_start": -curve(speed - swing) / SIGMA0} if belt == LUGRE else {}
    run = motion(belt, TURN, 0.05, vb=speed, x_start=rest, w_start=swing - speed, **held)
    course = CubicHermiteSpline(run.time, run.outputs["x"] - rest, run.outputs["v"])
    back = [t for t in course.roots(extrapolate=False) if t > 1.0 and course(t, 1) > 0.0]
    return float(back[0]) if back else TURN, course


def growth(belt: str, curve: Curve, speed: float, swing: float) -> float:
    """Logarithm of the ratio of the amplitudes after and before a turn."""
    length, course = turn(belt, curve, speed, swing)
    return float(np.log(course(length, 1) / swing))


@cache
def turning_point(belt: str, curve: Curve, low: float, high: float) -> float:
    """Speed of the belt between `low` and `high` at which small amplitudes are constant [m/s]."""
    return float(
        brentq(lambda speed: growth(belt, curve, speed, SMALL * speed), low, high, xtol=1e-7)
    )


@cache
def border(speed: float) -> float:
    """Amplitude of `belt` above which it grows into the cycle [m/s]: that of the unstable cycle."""
    last = 0.99999 * speed
    return float(
        brentq(lambda u: growth(FALLING, falling, speed, u), SMALL * speed, last, xtol=1e-4)
    )


def share_that_rests(speed: float) -> float:
    """Share of the region's starts that come to rest, which are those within the unstable cycle."""
    length, course = turn(FALLING, falling, speed, border(speed))
    time = np.linspace(0.0, length, 2001)
    x, v = course(time) + falling(speed), course(time, 1)
    inside = np.where((v > 0.0) & (np.abs(x) < REGION), v, 0.0)
    return float(np.trapezoid(inside**2, time)) / (2 * REGION * REGION)


def slip(belt: str, speed: float, step: float = 0.01, **values: float) -> Any:
    """The motion from just before the mass leaves the belt until it can have stuck again."""
    leaves = FS - values.get("c", DAMPING) * speed
    return motion(belt, TURN, step, vb=speed, x_start=leaves - 1e-3 * speed, **values)


def sticks_again(belt: str, speed: float, **values: float) -> bool:
    run = slip(belt, speed, **values)
    return bool((run.outputs["v"] - speed)[run.time > 2.0].max() > -1e-5)


def last_speed(sticks: Callable[[float], bool], low: float, high: float, steps: int) -> float:
    """Speed of the belt at which the cycle ends [m/s], by halving."""
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sticks(middle) else (low, middle)
    return low


def swings_on(speed: float) -> bool:
    """Whether the mass with LuGre friction, started on the belt, continues to oscillate."""
    late = motion(LUGRE, 150.0, 0.1, vb=speed).outputs["x"][-100:]
    return bool(np.ptp(late) > speed)


@cache
def end_of_cycle(belt: str, low: float, high: float, **values: float) -> float:
    """Highest speed of the belt with a stick-slip cycle, between `low` and `high` [m/s]."""
    if belt == LUGRE:
        return last_speed(swings_on, low, high, steps=9)
    return last_speed(lambda speed: sticks_again(belt, speed, **values), low, high, steps=12)


def exponential_turning_point() -> float:
    """Speed at which the slope of `falling` equals the damping: v0 ln((Fs - Fc)/(c v0)) [m/s]."""
    return V0 * float(np.log((FS - FC) / (DAMPING * V0)))


def gaussian_turning_points() -> tuple[float, float]:
    """Speeds at which the slope of `classical` equals the damping [m/s].

    With s = (v/v0)^2, s exp(-2 s) = q^2.
    """
    q = DAMPING * V0 / (2 * (FS - FC))
    low, high = (-0.5 * lambertw(-2 * q * q, branch).real for branch in (0, -1))
    return V0 * float(np.sqrt(low)), V0 * float(np.sqrt(high))


def lugre_turning_point() -> float:
    """Speed at which the linear part of `belt_lugre` has imaginary eigenvalues [m/s].

    With the slope s of the curve and the bristles' rate r = sigma0 v/g, the transfer function from
    speed to friction is s (1 + p sigma1/sigma0)/(1 + p/r). The speed follows from the Hurwitz
    condition on the cubic.
    """

    def margin(v: float) -> float:
        slope = -2 * v / V0**2 * (classical(v) - FC)
        rate = SIGMA0 * v / classical(v)
        second = rate + DAMPING + slope * rate * SIGMA1 / SIGMA0
        return second * ((DAMPING + slope) * rate + 1.0) - rate

    return float(brentq(margin, 0.8, 1.2))


def coulomb_cycle(speed: float) -> tuple[float, float]:
    """Period [s] and amplitude [m] of the stick-slip cycle without damping.

    With m = 1 kg and k = 1 N/m, the mass sticks for 2 (Fs - Fc)/(k vb), and slides along a circle
    around (Fc/k, 0) in the plane of x and x'/omega.
    """
    excess = FS - FC
    period = 2 * excess / speed + 2 * (np.pi - np.arctan(excess / speed))
    return float(period), float(np.hypot(excess, speed))
