"""Long-term motion of a DC motor with friction under P, PD and PID control of its angle."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from ..drawing import COLOURS, DASHES, drawing, part
from ..finding import Finding, exponents, halved, motion

MOTOR, LUGRE = part(__file__, "motor"), part(__file__, "motor_lugre")
LAWS = {name: part(__file__, f"{name.lower()}_law") for name in ("P", "PD", "PID")}
KT, KE, R, L, J, VISCOUS = 37.4e-3, 0.0374482, 21.4, 0.953e-3, 4.2e-7, 2e-5
FC, FS = 1e-3, 1.5e-3  # N*m
KP, KI, KD = 10.0, 1000.0, 0.05
SCIPY = "an event-driven simulation with SciPy's Radau"


def left(law: str, goal: float) -> float:
    """The remaining error of a step from rest [rad]."""
    return goal - float(motion(MOTOR, 0.3, 0.03, None, LAWS[law], goal).outputs["x"][-1])


def band() -> float:
    """The largest error at which the motor rests: kt Kp e / R = Fs [rad]."""
    return FS * R / (KT * KP)


def moves_from() -> float:
    """The smallest error at which the motor starts under P [rad]."""

    def stays(goal: float) -> bool:
        run = motion(MOTOR, 0.05, 0.025, None, LAWS["P"], goal)
        return bool(run.outputs["x"][-1] <= 0.0)

    return 0.5 * sum(halved(stays, 0.0853, 0.0863, 1e-6))


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


def creeping() -> tuple[np.ndarray, np.ndarray]:
    """End of each stick [s] and its error [rad], with Fs = Fc."""
    run = motion(MOTOR, 5.0, 2e-3, {"Fs": FC}, LAWS["PID"], 1.0)
    stuck = run.outputs["stuck"] > 0.5
    ends = np.flatnonzero(stuck[1:-1] & ~stuck[2:]) + 1
    return run.time[ends], 1.0 - run.outputs["x"][ends]


def hunts_from(motor: str) -> float:
    """Smallest Fs / Fc at which the motor hunts after a step of 1 rad."""

    def rests(share: float) -> bool:
        x = motion(motor, 8.0, 0.02, {"Fs": share * FC}, LAWS["PID"], 1.0).outputs["x"]
        return bool(np.ptp(x[len(x) // 2 :]) < 5e-3)

    return 0.5 * sum(halved(rests, 1.2, 1.6, 1e-3))


def largest_integral() -> float:
    """Largest Ki with a stable loop without dry friction, by Routh [V/(rad*s)]."""
    cubic, square = R * J + L * VISCOUS, R * VISCOUS + KT * (KE + KD)
    return KP * (cubic * square - L * J * KT * KP) / cubic**2


def runs_away_from() -> float:
    """The Ki above which oscillations of a hundred radians grow [V/(rad*s)]."""

    def fades(ki: float) -> bool:
        run = motion(MOTOR, 1.0, 2e-3, None, LAWS["PID"], 100.0, {"Ki": ki})
        quarter = len(run.time) // 4
        x = run.outputs["x"]
        before, after = np.ptp(x[-2 * quarter : -quarter]), np.ptp(x[-quarter:])
        return not run.stopped and bool(after <= max(before, 1.0))

    return 0.5 * sum(halved(fades, 4000.0, 4200.0, 2.0))


def findings() -> list[Finding]:
    _, errors = creeping()
    shrinks, slip = float(errors[-1] / errors[-2]), "a slip in closed form"
    cycle = exponents(MOTOR, 5.0, None, LAWS["PID"], 1.0).motion
    swing, period = cycle.amplitude["plant_x"], cycle.period or 0.0
    stiction, lsoda = "kt Kp e / R = Fs", "the same equations in SciPy's LSODA"
    stick = "PID, Fs = Fc: error of a stick over that of the stick before"
    routh = "Routh's criterion without dry friction, which is small against swings of 100 rad"
    unstable, away = "PID: Ki above which it diverges", runs_away_from()
    return [
        Finding("P: error from which it starts", moves_from(), "rad", stiction, band(), 2e-6),
        Finding("P: error left by a step of 1 rad", left("P", 1.0), "rad", SCIPY),
        Finding("PD: error left by a step of 1 rad", left("PD", 1.0), "rad", SCIPY),
        Finding(stick, shrinks, "1", slip, ratio(), 1e-6),
        Finding("PID, Fs = 1.5 Fc: swing of hunting", swing, "rad", SCIPY),
        Finding("PID, Fs = 1.5 Fc: period of hunting", period, "s", SCIPY),
        Finding("PID: Fs / Fc from which it hunts", hunts_from(MOTOR), "1", SCIPY),
        Finding("the same with LuGre friction", hunts_from(LUGRE), "1", lsoda),
        Finding(unstable, away, "V/(rad*s)", routh, largest_integral(), 5.0),
    ]


def picture() -> Any:
    with drawing(2) as (figure, (course, slow)):
        for k, law in enumerate(LAWS):
            run = motion(MOTOR, 1.0, 1e-3, None, LAWS[law], 1.0)
            style = {"color": COLOURS[k], "ls": DASHES[k], "lw": 1.4, "label": law}
            course.plot(run.time, 1e3 * (1.0 - run.outputs["x"]), **style)
        course.set(xlabel="time [s]", ylabel="error [mrad]", ylim=(-300, 300))
        course.set_title("P and PD stop short, PID hunts")
        course.axhspan(-1e3 * band(), 1e3 * band(), color="#dddddd", zorder=0)
        course.legend(ncols=3, fontsize=9)
        for k, (motor, label) in enumerate(((MOTOR, "sticks"), (LUGRE, "bristles, LuGre"))):
            run = motion(motor, 3.0, 1e-3, {"Fs": FC}, LAWS["PID"], 1.0)
            error = np.maximum(np.abs(1e3 * (1.0 - run.outputs["x"])), 1e-7)
            style = {"color": COLOURS[k], "ls": DASHES[k], "lw": 1.4, "label": label}
            slow.loglog(run.time[1:], error[1:], **style)
        slow.set(xlabel="time [s]", ylabel="|error| [mrad]", xlim=(0.01, 3.0), ylim=(1e-6, 2e3))
        slow.set_title("PID, Fs = Fc: bristles come to rest")
        slow.legend(fontsize=9)
    return figure
