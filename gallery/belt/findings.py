"""Speeds at which the friction oscillator on a belt begins and stops to oscillate."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from scipy.special import lambertw

from ..drawing import COLOURS, drawing, part
from ..finding import Finding, exponents, halved
from ..finding import motion as run_of

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
# share of bSTAB's starts that come to rest, by speed of the belt [m/s]: main_friction_case1.json
# and main_friction_v_study.json of pyBasin's tests
SHARES = {
    1.175: 0.0132,
    1.25: 0.08,
    1.4: 0.213,
    1.5: 0.304,
    1.625: 0.4202,
    1.7: 0.4922,
    1.775: 0.5678,
}
NONE, ALL = (1.025, 1.1), (1.85, 1.925, 2.0)  # speeds: no start comes to rest, all do
STARTS = 5000
SLOPE = "where the slope of friction is the damping"
Curve = Callable[[float], float]


def falling(speed: float) -> float:
    """Friction of `belt` at a sliding speed [N]."""
    return FC + (FS - FC) * float(np.exp(-speed / V0))


def classical(speed: float) -> float:
    """Friction of `belt_classical`, and of `belt_lugre` in steady sliding [N]."""
    return FC + (FS - FC) * float(np.exp(-((speed / V0) ** 2)))


def motion(belt: str, stop: float, step: float, **values: float) -> Any:
    """A motion, with given parameters and start values of states."""
    return run_of(belt, stop, step, values)


def verdict(belt: str, **values: float) -> Any:
    return exponents(belt, 60.0, values).motion


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


def swings_on(speed: float) -> bool:
    """Whether the mass with LuGre friction, started on the belt, continues to oscillate."""
    late = motion(LUGRE, 150.0, 0.1, vb=speed).outputs["x"][-100:]
    return bool(np.ptp(late) > speed)


@cache
def end_of_cycle(belt: str, low: float, high: float, **values: float) -> float:
    """Highest speed of the belt with a stick-slip cycle, between `low` and `high` [m/s]."""
    if belt == LUGRE:
        return halved(swings_on, low, high, 1.001 * (high - low) / 2**9)[0]
    width = 1.001 * (high - low) / 2**12
    return halved(lambda speed: sticks_again(belt, speed, **values), low, high, width)[0]


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


def findings() -> list[Finding]:
    return [*_of_the_exponential_fall(), *_of_the_catalogue(), *_of_coulomb()]


def _of_the_exponential_fall() -> list[Finding]:
    at = "main_friction_v_study.json of pyBasin, from bSTAB"
    slide = turning_point(FALLING, falling, 1.1, 1.2)
    slope, theirs = f"{SLOPE}: v0 ln((Fs - Fc)/(c v0))", exponential_turning_point()
    ends, last = f"{at}: between 1.775 and 1.85", end_of_cycle(FALLING, 1.75, 1.9)
    stable = "exponential fall: above it, sliding is stable"
    rows = [
        Finding(stable, slide, "m/s", slope, theirs, 2e-5),
        Finding("exponential fall: the stick-slip cycle ends", last, "m/s", ends, 1.8125, 0.0375),
    ]
    remark = (
        "so close to where sliding becomes stable, some swings are above 0.2 m/s after 400 s, "
        "which they count as a cycle; by that rule we get their share"
    )
    for speed, source, why in ((1.5, at.replace("v_study", "case1"), ""), (1.175, at, remark)):
        share = SHARES[speed]
        digit = 2 * float(np.sqrt(share * (1 - share) / STARTS))
        what = f"share of starts that come to rest, vb = {speed:g}"
        source += "; tolerance: twice their standard error"
        rows.append(Finding(what, share_that_rests(speed), "1", source, share, digit, why))
    return rows


def _of_the_catalogue() -> list[Finding]:
    low, high = gaussian_turning_points()
    lambert, hurwitz = (
        f"{SLOPE}, by Lambert's W",
        "Hurwitz' condition on the cubic of the linear part",
    )
    first = turning_point(CLASSICAL, classical, 0.02, 0.03)
    again, bristles = (turning_point(b, classical, 0.9, 1.0) for b in (CLASSICAL, LUGRE))
    ends, late = (end_of_cycle(belt, 1.85, 2.0) for belt in (CLASSICAL, LUGRE))
    slow, what = (
        float(verdict(DAHL, vb=SPEED).limit[0]),
        "Dahl: slowest exponent [nats/s], vb = 1.5",
    )
    damper = "-c/(2 m): if friction does not fall only the damper acts"
    meets = "SciPy's slip no longer meets the belt there, to 2e-4"
    cubic = lugre_turning_point()
    return [
        Finding("classical: sliding becomes unstable", first, "m/s", lambert, low, 2e-5),
        Finding("classical: sliding is stable again", again, "m/s", lambert, high, 2e-5),
        Finding("classical: the stick-slip cycle ends", ends, "m/s", meets),
        Finding("LuGre: sliding is stable again", bristles, "m/s", hurwitz, cubic, 2e-5),
        Finding("LuGre: the cycle ends", late, "m/s", "SciPy gives the same to 4e-3"),
        Finding(what, slow, "1/s", damper, -DAMPING / 2, 1e-9),
    ]


def _of_coulomb() -> list[Finding]:
    period, swing = coulomb_cycle(0.5)
    cycle, zeta = verdict(COULOMB, vb=0.5, c=0.0), 0.005
    ends = end_of_cycle(COULOMB, 1.9, 2.05, c=2 * zeta)
    ours, size = float(cycle.period or 0.0), cycle.amplitude["plant_x"]
    times = "2 (Fs - Fc)/(k vb) + 2 (pi - arctan((Fs - Fc) omega/(k vb)))/omega"
    root, free = "the root of ((Fs - Fc)/k)^2 + (vb/omega)^2", "Coulomb with stiction, no damper"
    energy = "(Fs - Fc)/sqrt(4 pi zeta k m), from the energy of one turn; tolerance: 3 zeta of it"
    damped = "Coulomb with stiction, zeta = 0.005: the stick-slip cycle ends"
    formula = (FS - FC) / float(np.sqrt(4 * np.pi * zeta))
    return [
        Finding(f"{free}, vb = 0.5: period", ours, "s", times, period, 1e-8),
        Finding(f"{free}, vb = 0.5: swing", size, "m", root, swing, 2e-5),
        Finding(damped, ends, "m/s", energy, formula, 0.03),
    ]


def picture() -> Any:
    with drawing(2, height=3.7) as (figure, (plane, starts)):
        _draw_plane(plane)
        _draw_starts(starts)
    return figure


def _draw_plane(axes: Any) -> None:
    """Draw cycle, unstable cycle and two motions of `belt`."""
    length, course = turn(FALLING, falling, SPEED, border(SPEED))
    time = np.linspace(0.0, length, 400)
    rest = falling(SPEED)
    axes.fill(course(time) + rest, course(time, 1), color=COLOURS[5], alpha=0.25, lw=0)
    axes.plot(course(time) + rest, course(time, 1), color=COLOURS[4], ls="--", label="border")
    for speed, colour in ((0.95, COLOURS[0]), (1.33, COLOURS[2])):
        run = motion(FALLING, 60.0, 0.03, vb=SPEED, x_start=rest, w_start=speed - SPEED)
        axes.plot(run.outputs["x"], run.outputs["v"], color=colour, lw=0.8)
    cycle = slip(FALLING, SPEED)
    ends = "stick-slip cycle"
    axes.plot(cycle.outputs["x"], cycle.outputs["v"], color=COLOURS[1], lw=2.6, label=ends)
    axes.plot(rest, 0.0, "o", color=COLOURS[6], ms=6, label="steady sliding")
    axes.axhline(SPEED, color="#777777", lw=1.0, ls=":")
    axes.text(2.05, SPEED + 0.06, "belt", ha="right", color="#555555")
    title = f"At {SPEED:g} m/s the start decides"
    axes.set(xlabel="position [m]", ylabel="velocity [m/s]", title=title, ylim=(-1.8, 2.6))
    axes.legend(loc="upper left", ncols=2, fontsize=9, columnspacing=1.0)


def _draw_starts(axes: Any) -> None:
    """Draw shares of starts that come to rest, ours and those of bSTAB."""
    turns, end = exponential_turning_point(), end_of_cycle(FALLING, 1.75, 1.9)
    speeds = [1.0, turns, *SHARES]
    ours = [0.0, 0.0, *map(share_that_rests, SHARES)]
    axes.fill_between(speeds, ours, color=COLOURS[5], alpha=0.25, lw=0)
    axes.plot(speeds, ours, color=COLOURS[4], ls="--", label="ours: area within the border")
    axes.plot([end, 2.1], [1.0, 1.0], color=COLOURS[4], ls="--")
    axes.axvline(end, color="#777777", lw=1.0, ls=":")
    axes.text(end + 0.01, 0.03, "no cycle", color="#555555", fontsize=9)
    counted = SHARES | dict.fromkeys(NONE, 0.0) | dict.fromkeys(ALL, 1.0)
    theirs = np.array(list(counted.values()))
    error = 2 * np.sqrt(theirs * (1 - theirs) / STARTS)
    style = {"color": COLOURS[6], "ms": 4, "capsize": 3, "lw": 1.2}
    axes.errorbar([*counted], theirs, error, fmt="o", label="bSTAB: 5000 starts", **style)
    axes.set(xlabel="speed of the belt [m/s]", ylabel="share of starts that rest", xlim=(1.0, 2.1))
    axes.set_title("As many starts rest as bSTAB counted")
    axes.legend(loc="upper left", fontsize=9)
