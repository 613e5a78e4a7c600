"""Long-term motion of a DC motor with friction under P, PD and PID control of its angle."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

import ballscrew

from ..drawing import COLOURS, DASHES, drawing, part
from ..finding import Finding

MOTOR, LUGRE = part(__file__, "motor"), part(__file__, "motor_lugre")
LAWS = {name: part(__file__, f"{name.lower()}_law") for name in ("P", "PD", "PID")}
KT, KE, R, L, J, VISCOUS = 37.4e-3, 0.0374482, 21.4, 0.953e-3, 4.2e-7, 2e-5
FC, FS = 1e-3, 1.5e-3  # N*m
KP, KI, KD = 10.0, 1000.0, 0.05
SCIPY = "an event-driven simulation with SciPy's Radau"


def motion(
    law: str,
    goal: float,
    stop: float,
    step: float,
    motor: str = MOTOR,
    given: Mapping[str, float] | None = None,
    gains: Mapping[str, float] | None = None,
) -> Any:
    """The motion from rest at angle 0 to a goal [rad]."""
    return ballscrew.run(
        LAWS[law],
        motor,
        reference=goal,
        stop=stop,
        step=step,
        coupling=ballscrew.Coupling("monolithic"),
        plant_values=given,
        controller_values=gains,
    ).run


def left(law: str, goal: float) -> float:
    """The remaining error [rad]."""
    return float(goal - motion(law, goal, 0.3, 0.03).outputs["x"][-1])


def band() -> float:
    """The largest error at which the motor rests: kt Kp e / R = Fs [rad]."""
    return FS * R / (KT * KP)


@cache
def moves_from() -> float:
    """The smallest error at which the motor starts under P [rad]."""
    low, high = 0.0853, 0.0863
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        moved = motion("P", middle, 0.05, 0.025).outputs["x"][-1] > 0.0
        low, high = (low, middle) if moved else (middle, high)
    return 0.5 * (low + high)


@cache
def ratio() -> float:
    """Error after a slip over the error before, with Fs = Fc, in closed form.

    t is the torque of the current less Coulomb friction, and y the torque of the voltage at rest
    less Coulomb friction. A slip is linear in (e, v, t, y). It begins at t = 0, v = 0, with the
    difference between t and y that the inductance causes while the integral grows.
    """
    pull = KT / R
    rates = np.array(
        [
            [0.0, -1.0, 0.0, 0.0],
            [0.0, -VISCOUS / J, 1.0 / J, 0.0],
            [0.0, -KT * KE / L, -R / L, R / L],
            [pull * KI, pull * (KD * VISCOUS / J - KP), -pull * KD / J, 0.0],
        ]
    )
    start = np.array([1.0, 0.0, 0.0, pull * KI * L / R])

    def speed(time: float) -> float:
        return float((expm(rates * time) @ start)[1])

    times = np.linspace(2e-3, 0.2, 100)
    end = next(k for k, time in enumerate(times) if speed(time) < 0.0)
    turn = brentq(speed, times[end - 1], times[end], xtol=1e-14)
    return float((expm(rates * turn) @ start)[0])


@cache
def creeping() -> tuple[np.ndarray, np.ndarray]:
    """End of each stick [s] and its error [rad], with Fs = Fc."""
    run = motion("PID", 1.0, 5.0, 2e-3, given={"Fs": FC})
    stuck = run.outputs["stuck"] > 0.5
    ends = np.flatnonzero(stuck[1:-1] & ~stuck[2:]) + 1
    return run.time[ends], 1.0 - run.outputs["x"][ends]


@cache
def hunting() -> Any:
    return ballscrew.lyapunov(LAWS["PID"], MOTOR, stop=5.0, reference=1.0).motion


@cache
def hunts_from(motor: str) -> float:
    """Smallest Fs / Fc at which the motor hunts after a step of 1 rad."""
    low, high = 1.2, 1.6
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        x = motion("PID", 1.0, 8.0, 0.02, motor, {"Fs": middle * FC}).outputs["x"]
        still = np.ptp(x[len(x) // 2 :]) < 5e-3
        low, high = (middle, high) if still else (low, middle)
    return 0.5 * (low + high)


def largest_integral() -> float:
    """Largest Ki with a stable loop without dry friction, by Routh [V/(rad*s)]."""
    cubic, square = R * J + L * VISCOUS, R * VISCOUS + KT * (KE + KD)
    return KP * (cubic * square - L * J * KT * KP) / cubic**2


@cache
def runs_away_from() -> float:
    """The Ki above which oscillations of a hundred radians grow [V/(rad*s)]."""
    low, high = 4000.0, 4200.0
    while high - low > 2.0:
        middle = 0.5 * (low + high)
        run = motion("PID", 100.0, 1.0, 2e-3, gains={"Ki": middle})
        grows = bool(run.stopped) or _grows(run.outputs["x"])
        low, high = (low, middle) if grows else (middle, high)
    return 0.5 * (low + high)


def _grows(x: np.ndarray) -> bool:
    quarter = len(x) // 4
    before, after = np.ptp(x[-2 * quarter : -quarter]), np.ptp(x[-quarter:])
    return bool(after > max(before, 1.0))


def findings() -> list[Finding]:
    _, errors = creeping()
    cycle = hunting()
    stiction = "kt Kp e / R = Fs"
    return [
        Finding("P: error from which it starts", moves_from(), "rad", stiction, band(), 2e-6),
        Finding("P: error left by a step of 1 rad", left("P", 1.0), "rad", SCIPY),
        Finding("PD: error left by a step of 1 rad", left("PD", 1.0), "rad", SCIPY),
        Finding(
            "PID, Fs = Fc: error of a stick over that of the stick before",
            float(errors[-1] / errors[-2]),
            "1",
            "a slip in closed form",
            ratio(),
            1e-6,
        ),
        Finding("PID, Fs = 1.5 Fc: swing of hunting", cycle.amplitude["plant_x"], "rad", SCIPY),
        Finding("PID, Fs = 1.5 Fc: period of hunting", cycle.period or 0.0, "s", SCIPY),
        Finding("PID: Fs / Fc from which it hunts", hunts_from(MOTOR), "1", SCIPY),
        Finding(
            "the same with LuGre friction",
            hunts_from(LUGRE),
            "1",
            "the same equations in SciPy's LSODA",
        ),
        Finding(
            "PID: Ki above which it diverges",
            runs_away_from(),
            "V/(rad*s)",
            "Routh's criterion without dry friction, which is small against swings of 100 rad",
            largest_integral(),
            5.0,
        ),
    ]


def _map() -> tuple[Any, Any, Any]:
    """Fs / Fc, Ki, and the amplitude of hunting [mrad]; infinite if it diverges."""
    with tempfile.TemporaryDirectory() as folder:
        cells = ballscrew.stability_map(
            LAWS["PID"],
            "plant.Fs=0.001:0.002:8",
            "Ki=600:4600:5",
            folder,
            MOTOR,
            stop=3.0,
            reference=1.0,
        ).columns()
    swing = [
        {"limit cycle": 1e3 * (size or 0.0), "diverges": np.inf}.get(kind, np.nan)
        for kind, size in zip(cells["verdict"], cells["oscillation_amplitude"], strict=True)
    ]
    static, gains = np.unique(cells["plant.Fs"]), np.unique(cells["Ki"])
    return static / FC, gains, np.reshape(swing, (len(gains), len(static)))


def _draw_map(axes: Any) -> None:
    ratios, gains, swing = _map()
    hunts = np.ma.masked_invalid(swing)
    shade = axes.pcolormesh(ratios, gains, hunts, cmap="viridis_r", vmin=0.0, shading="nearest")
    axes.figure.colorbar(shade, ax=axes, label="swing of the cycle [mrad]")
    away = np.ma.masked_where(~np.isinf(swing), np.full_like(swing, 0.4))
    axes.pcolormesh(ratios, gains, away, cmap="Greys", vmin=0.0, vmax=1.0, shading="nearest")
    axes.text(1.5, 4600.0, "runs away", ha="center", va="center", fontsize=9)
    axes.text(1.0, 900.0, "no cycle", fontsize=9)
    axes.axhline(largest_integral(), color="#000000", ls="--", lw=1)
    axes.set(xlabel="Fs / Fc", ylabel="Ki [V/(rad s)]", title="PID hunts from some Fs / Fc on")
    axes.grid(visible=False)


def picture() -> Any:
    with drawing(2, 2) as (figure, (course, rest, map_of_gains, slow)):
        for k, law in enumerate(LAWS):
            run = motion(law, 1.0, 1.0, 1e-3)
            style = {"color": COLOURS[k], "ls": DASHES[k], "lw": 1.4, "label": law}
            course.plot(run.time, 1e3 * (1.0 - run.outputs["x"]), **style)
        course.set(xlabel="time [s]", ylabel="error [mrad]", ylim=(-300, 300))
        course.set_title("P and PD stop short, PID hunts")
        for k, (law, count) in enumerate((("P", 19), ("PD", 10))):
            goals = np.linspace(0.02, 1.62, count)
            errors = [1e3 * left(law, goal) for goal in goals]
            rest.plot(goals, errors, "o-", color=COLOURS[k], ms=3, lw=0.8, label=law)
        rest.set(xlabel="step [rad]", ylabel="error left [mrad]", ylim=(-110, 110))
        rest.set_title("They stop anywhere in the grey band")
        for axes in (course, rest):
            axes.axhspan(-1e3 * band(), 1e3 * band(), color="#dddddd", zorder=0)
            axes.legend(ncols=3, fontsize=9)
        _draw_map(map_of_gains)
        for k, (motor, label) in enumerate(((MOTOR, "sticks"), (LUGRE, "bristles, LuGre"))):
            run = motion("PID", 1.0, 3.0, 1e-3, motor, {"Fs": FC})
            error = np.maximum(np.abs(1e3 * (1.0 - run.outputs["x"])), 1e-7)
            slow.loglog(
                run.time[1:], error[1:], color=COLOURS[k], ls=DASHES[k], lw=1.4, label=label
            )
        slow.set(xlabel="time [s]", ylabel="|error| [mrad]", xlim=(0.01, 3.0), ylim=(1e-6, 2e3))
        slow.set_title("PID, Fs = Fc: bristles come to rest")
        slow.legend(fontsize=9)
    return figure
