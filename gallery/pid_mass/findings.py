"""The long-term motion of a mass with dry friction under PID control.

Between two sticks the mass slides, and its motion is linear: with the error e, the velocity v and
the force q of the proportional and integral action beyond Coulomb friction,

    e' = -v,   q' = Ki e - Kp v,   m v' = q - D v,   D = Kd + sigma2.

So a slip from rest and the state after it are known in closed form: `slip`.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from ..drawing import COLOURS, DASHES, drawing, part
from ..finding import Finding, exponents, halved, motion

MASS, PID = part(__file__, "mass"), part(__file__, "pid_law")
STEP = 1.0  # of the set-point [m]
M, FC, KP, KI, KD = 1.0, 1.0, 3.0, 4.0, 6.0
DAMPING = KD + 0.4  # with the viscous friction [N*s/m]
VS = 1e-3  # Stribeck velocity of the example [m/s]
SOFT = {"Vs": 0.05, "sigma2": 0.0}  # values with which hunting ends within the map
AIRY = 1.9863527  # smallest s > 0 with sqrt(3) Ai(-s) + Bi(-s) = 0
SLIP = "slip by slip in closed form"


def step(static: float, stop: float, rows: float) -> Any:
    """The motion after a step of the set-point by a metre; `static` is Fs."""
    return motion(MASS, stop, rows, {"Fs": static}, PID, STEP)


def slip(error: float, beyond: float) -> tuple[float, float, float]:
    """A slip from rest: its duration, and error and force beyond Coulomb friction at its end.

    Parameters
    ----------
    error : float
        Error at the start [m], more than 0; 0 is possible if `beyond` is more than 0.
    beyond : float
        Force beyond Coulomb friction at the start [N].
    """
    rates = np.array([[0.0, 0.0, -1.0], [KI, 0.0, -KP], [0.0, 1.0 / M, -DAMPING / M]])
    start = np.array([error, beyond, 0.0])
    short = 0.02
    one, state, time = expm(rates * short), start, 0.0
    while time == 0.0 or state[2] > 0.0:
        state, time = one @ state, time + short
    early = 1e-6 if time < 1.5 * short else time - short
    end = brentq(lambda t: (expm(rates * t) @ start)[2], early, time, xtol=1e-13)
    error, beyond, _ = expm(rates * end) @ start
    return float(end), float(error), float(beyond)


def ratio() -> float:
    """Error after a slip over the error before, with Fs = Fc: the same for every slip."""
    return slip(1.0, 0.0)[1]


def late(error: float, fall: float) -> float:
    """Time before friction begins to fall by `fall` [N], in seconds.

    While v is far below Vs, m v' = Ki e t + fall (v/Vs)^2. This Riccati equation is solved by Airy
    functions; its v is infinite at this time.
    """
    return float(AIRY * (M**2 * VS**2 / (KI * error * fall)) ** (1 / 3))


def after(error: float, fall: float, smooth: bool) -> tuple[float, float]:
    """Magnitude of the error after one slip, and duration of stick and slip.

    Parameters
    ----------
    fall : float
        Fs - Fc [N].
    smooth : bool
        Whether friction falls with the Stribeck curve, to leading order; otherwise it falls
        immediately.
    """
    waits = late(error, fall) if smooth else 0.0
    duration, over, beyond = slip(error, fall + KI * error * waits)
    stick = (2 * FC + fall + beyond) / (KI * abs(over))
    return abs(over), waits + duration + stick


@cache
def cycle(fall: float, smooth: bool = True) -> tuple[float, float, float]:
    """Error while stuck [m], period [s] and second exponent [nats/s] of hunting."""
    error = 0.1
    for _ in range(60):
        error, half = after(error, fall, smooth)
    h = 1e-5 * error
    slope = (after(error + h, fall, smooth)[0] - after(error - h, fall, smooth)[0]) / (2 * h)
    return error, 2 * half, math.log(abs(slope)) / half


def sticks(run: Any) -> tuple[np.ndarray, np.ndarray]:
    """Last output time of each stick of a motion [s], and its error [m]."""
    stuck = run.outputs["stuck"] > 0.5
    ends = np.flatnonzero(stuck[1:-1] & ~stuck[2:]) + 1
    return run.time[ends], STEP - run.outputs["x"][ends]


def border() -> float:
    """The velocity gain at which hunting ends, with Fs = 1.5 Fc and the larger Vs [N*s/m]."""

    def hunts(kd: float) -> bool:
        run = motion(MASS, 2000.0, 2.0, {"Fs": 1.5, **SOFT}, PID, STEP, {"Kd": kd})
        return bool(np.ptp(run.outputs["x"][len(run.time) // 2 :]) > 0.02)

    return 0.5 * sum(halved(hunts, 6.0, 9.0, 3.0 / 2**12))


def steepest(fall: float) -> float:
    """Largest negative slope of the Stribeck curve with the larger Vs [N*s/m]."""
    return fall / SOFT["Vs"] * math.sqrt(2 / math.e)


def findings() -> list[Finding]:
    times, errors = sticks(step(1.0, 4000.0, 0.5))
    found = exponents(MASS, 200.0, None, PID, STEP).motion
    error, period, second = cycle(0.5)
    gap = VS / 0.1  # over the speed of a slip
    shrinks, late = float(errors[-1] / errors[-2]), float(abs(errors[-1]) * times[-1])
    first = f"{SLIP}: a slip that begins at Fc is proportional to its error"
    rule = (
        "2 Fc / (Ki (1 - q)) with the ratio -q above; the time of slips, a share of 1/time, "
        "is neglected"
    )
    falls = f"{SLIP}, with the time in which friction falls; terms in Vs are neglected"
    slope = f"{SLIP}: the slope of the error after a slip by the error before"
    scipy = (
        "SciPy hunts 2 % below it and not 2 % above; the steepest fall of friction is "
        f"{steepest(0.5):.3g} N*s/m"
    )
    equal, more = "Fs = Fc: error", "Fs = 1.5 Fc"
    held, hunting = f"{more}: error while it sticks, in the cycle", f"{more}: period of hunting"
    decays, ends = f"{more}: second exponent of the cycle [nats/s]", "Kd at which hunting ends"
    size, takes = found.amplitude["plant_x"], found.period or 0.0
    rate, theirs = float(found.limit[1]), 2 * FC / (KI * (1 + ratio()))
    return [
        Finding(
            f"{equal} of a stick over that of the stick before", shrinks, "1", first, ratio(), 1e-5
        ),
        Finding(f"{equal} times time, at the end of a stick", late, "m*s", rule, theirs, 0.02),
        Finding(held, size, "m", falls, error, gap * error),
        Finding(hunting, takes, "s", f"{SLIP}, the same", period, gap * period),
        Finding(decays, rate, "1/s", slope, second, gap * abs(second)),
        Finding(f"{more}, Vs = 0.05 m/s: {ends}", border(), "N*s/m", scipy),
    ]


def picture() -> Any:
    with drawing(2) as (figure, (plane, decay)):
        for static, colour, dash in ((1.5, COLOURS[1], "-"), (1.0, COLOURS[0], DASHES[1])):
            style = {"color": colour, "ls": dash, "label": f"Fs = {static:g} Fc"}
            fine = step(static, 100.0, 0.04)
            error = STEP - fine.outputs["x"]
            integral = (fine.commands["u"] - KP * error + KD * fine.outputs["v"]) / KI
            plane.plot(integral, 1e3 * error, lw=1.4, **style)
            times, errors = sticks(step(static, 4000.0, 0.5))
            decay.loglog(times, 1e3 * np.abs(errors), marker="o", ms=4, **style)
        times = np.array([20.0, 4000.0])
        slope = 1e3 * 2 * FC / (KI * (1 + ratio())) / times
        decay.loglog(times, slope, color="#000000", lw=0.9, ls=":", label="closed form, 1/time")
        plane.set(xlabel="integral of the error [m s]", ylabel="error [mm]", ylim=(-560, 420))
        plane.set_title("Fs > Fc hunts, Fs = Fc creeps in")
        decay.set(xlabel="time [s]", ylabel="error while it sticks [mm]")
        decay.set_title("Fs = Fc: the error falls as 1/time")
        for axes in (plane, decay):
            axes.legend(fontsize=9)
    return figure
