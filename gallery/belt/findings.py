"""Speeds at which the friction oscillator on a belt begins and stops to oscillate."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..drawing import COLOURS, DASHES, drawing
from ..finding import Finding
from .cycles import (
    CLASSICAL,
    COULOMB,
    DAHL,
    DAMPING,
    FALLING,
    FC,
    FS,
    LUGRE,
    SPEED,
    border,
    classical,
    coulomb_cycle,
    end_of_cycle,
    exponential_turning_point,
    falling,
    gaussian_turning_points,
    lugre_turning_point,
    motion,
    share_that_rests,
    slip,
    turn,
    turning_point,
    verdict,
)

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


def findings() -> list[Finding]:
    return [*_of_the_exponential_fall(), *_of_the_catalogue(), *_of_coulomb()]


def _of_the_exponential_fall() -> list[Finding]:
    at = "main_friction_v_study.json of pyBasin, from bSTAB; tolerance: twice their standard error"

    def of_starts(speed: float, source: str, remark: str = "") -> Finding:
        share = SHARES[speed]
        digit = 2 * float(np.sqrt(share * (1 - share) / STARTS))
        what = f"share of starts that come to rest, vb = {speed:g}"
        return Finding(what, share_that_rests(speed), "1", source, share, digit, remark)

    return [
        Finding(
            "exponential fall: above it, sliding is stable",
            turning_point(FALLING, falling, 1.1, 1.2),
            "m/s",
            f"{SLOPE}: v0 ln((Fs - Fc)/(c v0))",
            exponential_turning_point(),
            2e-5,
        ),
        Finding(
            "exponential fall: the stick-slip cycle ends",
            end_of_cycle(FALLING, 1.75, 1.9),
            "m/s",
            "main_friction_v_study.json of pyBasin, from bSTAB: between 1.775 and 1.85",
            1.8125,
            0.0375,
        ),
        of_starts(1.5, at.replace("v_study", "case1")),
        of_starts(1.7, at),
        of_starts(
            1.175,
            at,
            "so close to where sliding becomes stable, some swings are above 0.2 m/s after 400 s, "
            "which they count as a cycle; by that rule we get their share",
        ),
    ]


def _of_the_catalogue() -> list[Finding]:
    low, high = gaussian_turning_points()
    return [
        Finding(
            "classical: sliding becomes unstable",
            turning_point(CLASSICAL, classical, 0.02, 0.03),
            "m/s",
            f"{SLOPE}, by Lambert's W",
            low,
            2e-5,
        ),
        Finding(
            "classical: sliding is stable again",
            turning_point(CLASSICAL, classical, 0.9, 1.0),
            "m/s",
            f"{SLOPE}, by Lambert's W",
            high,
            2e-5,
        ),
        Finding(
            "classical: the stick-slip cycle ends",
            end_of_cycle(CLASSICAL, 1.85, 2.0),
            "m/s",
            "SciPy's slip no longer meets the belt there, to 2e-4",
        ),
        Finding(
            "LuGre: sliding is stable again",
            turning_point(LUGRE, classical, 0.9, 1.0),
            "m/s",
            "Hurwitz' condition on the cubic of the linear part",
            lugre_turning_point(),
            2e-5,
        ),
        Finding(
            "LuGre: the cycle ends",
            end_of_cycle(LUGRE, 1.85, 2.0),
            "m/s",
            "SciPy gives the same to 4e-3",
        ),
        Finding(
            "Dahl: slowest exponent [nats/s], vb = 1.5",
            float(verdict(DAHL, vb=SPEED).limit[0]),
            "1/s",
            "-c/(2 m): if friction does not fall only the damper acts",
            -DAMPING / 2,
            1e-9,
        ),
    ]


def _of_coulomb() -> list[Finding]:
    period, swing = coulomb_cycle(0.5)
    cycle = verdict(COULOMB, vb=0.5, c=0.0)
    zeta = 0.005
    return [
        Finding(
            "Coulomb with stiction, no damper, vb = 0.5: period",
            float(cycle.period or 0.0),
            "s",
            "2 (Fs - Fc)/(k vb) + 2 (pi - arctan((Fs - Fc) omega/(k vb)))/omega",
            period,
            1e-8,
        ),
        Finding(
            "Coulomb with stiction, no damper, vb = 0.5: swing",
            cycle.amplitude["plant_x"],
            "m",
            "the root of ((Fs - Fc)/k)^2 + (vb/omega)^2",
            swing,
            2e-5,
        ),
        Finding(
            "Coulomb with stiction, zeta = 0.005: the stick-slip cycle ends",
            end_of_cycle(COULOMB, 1.9, 2.05, c=2 * zeta),
            "m/s",
            "(Fs - Fc)/sqrt(4 pi zeta k m), from the energy of one turn; tolerance: 3 zeta of it",
            (FS - FC) / float(np.sqrt(4 * np.pi * zeta)),
            0.03,
        ),
    ]


def picture() -> Any:
    with drawing(2, 2, height=3.7) as (figure, (plane, swings, starts, laws)):
        _draw_plane(plane)
        _draw_swings(swings)
        _draw_starts(starts)
        _draw_laws(laws)
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


def _draw_swings(axes: Any) -> None:
    """Draw amplitudes of cycles over the belt's speed, and on the axis stable steady sliding."""
    end = end_of_cycle(FALLING, 1.75, 1.9)
    shown = (
        (FALLING, 0.02, end, COLOURS[1], "exponential fall"),
        (CLASSICAL, 0.035, end_of_cycle(CLASSICAL, 1.85, 2.0), COLOURS[0], "Gaussian fall"),
    )
    for belt, begin, last, colour, label in shown:
        speeds = begin + (last - begin) * np.linspace(0.0, 1.0, 11) ** 1.5
        cycle = [_swing(slip(belt, v, 0.05).outputs["x"]) for v in speeds]
        axes.plot(speeds, cycle, color=colour, label=label)
    speeds = np.linspace(0.1, 1.9, 5)
    late = [_swing(motion(LUGRE, 60.0, 0.1, vb=v).outputs["x"][-100:]) for v in speeds]
    axes.plot(speeds, late, "D", color=COLOURS[2], ms=5, label="LuGre, Gaussian fall")
    axes.plot(speeds, 0 * speeds, "s", color=COLOURS[3], ms=5, label="Dahl, no fall")
    turns, unstable = exponential_turning_point(), []
    for speed in SHARES:
        length, course = turn(FALLING, falling, speed, border(speed))
        unstable.append(_swing(course(np.linspace(0.0, length, 300))))
    meet = _swing(slip(FALLING, end).outputs["x"])
    swings = [0.0, *unstable, meet]
    axes.plot([turns, *SHARES, end], swings, color=COLOURS[4], ls="--", label="border")
    axes.plot([0.0, turns], [0.0, 0.0], color=COLOURS[1], lw=1.2, ls=":")
    axes.plot([turns, 2.2], [0.0, 0.0], color=COLOURS[1], lw=2.4)
    title = f"Dies at {end:.2f} m/s, is back below {turns:.2f} m/s"
    axes.set(xlabel="speed of the belt [m/s]", ylabel="swing of x [m]", title=title)
    axes.legend(loc="upper left", fontsize=9)


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


def _draw_laws(axes: Any) -> None:
    """Draw motions from the belt at a low speed, with the laws of the catalogue."""
    speed = 0.3
    shown = ((CLASSICAL, "classical", 0, 2.6), (LUGRE, "LuGre", 2, 1.4), (DAHL, "Dahl", 3, 1.0))
    for belt, label, k, wide in shown:
        run = motion(belt, 50.0, 0.03, vb=speed)
        style = {"color": COLOURS[k], "ls": DASHES[0 if belt == DAHL else k], "lw": wide}
        axes.plot(run.outputs["x"], run.outputs["v"], label=label, **style)
    axes.axhline(speed, color="#777777", lw=1.0, ls=":")
    axes.set(xlabel="position [m]", ylabel="velocity [m/s]", title="No fall of friction, no cycle")
    axes.legend(loc="center", bbox_to_anchor=(0.45, 0.27), fontsize=9)


def _swing(x: Any) -> float:
    return float(np.ptp(x)) / 2
