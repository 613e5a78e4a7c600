"""Hunting of a drive with backlash, in simulation and by the describing function."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.optimize import brentq

from ..drawing import COLOURS, drawing, part
from ..finding import Finding, exponents
from ..finding import motion as run_of

DRIVE = part(__file__, "drive")
TABLE_LOOP, MOTOR_LOOP = part(__file__, "table_loop"), part(__file__, "motor_loop")
MM, M, D, K, B = 10.0, 50.0, 200.0, 1e6, 1e-5
KP, KI = 6000.0, 1.5e5
HIGH, LOW = 100.0, 30.0  # studied position gains [1/s]
SHOWN = (7.5, 10.0, 15.0, 22.0, 30.0, 45.0, 60.0, 80.0, 100.0, 120.0, 133.0)
DESCRIBING = "describing function of the backlash"
LEFT_OUT = "the share of the neglected third harmonic is its tolerance"
PUSH = "one push after a long wait, by matrix exponentials"

Matrix = npt.NDArray[np.float64]


def linear(gain: float, stiffness: float) -> Matrix:
    """Rates of (x, v, xm, vm, w) in the table's loop, without backlash."""
    pull = stiffness * np.array([-1.0, 0.0, 1.0, 0.0, 0.0])
    error = np.array([-gain, 0.0, 0.0, -1.0, 0.0])
    motor = KP * error + np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            (pull - [0.0, D, 0.0, 0.0, 0.0]) / M,
            [0.0, 0.0, 0.0, 1.0, 0.0],
            (motor - pull) / MM,
            KI * error,
        ]
    )


@dataclass(frozen=True)
class Swing:
    """A cycle by the describing function.

    Attributes
    ----------
    frequency : float
        Angular frequency [rad/s].
    lead : float
        Amplitude of the motor's lead [m].
    table : float
        Amplitude of the table [m].
    third : float
        Amplitude of the lead's neglected third harmonic, over `lead`.
    """

    frequency: float
    lead: float
    table: float
    third: float


def share(lead: float) -> float:
    """Describing function of the backlash over the screw's stiffness; `lead` over b, at least 1."""
    return 1.0 - 2.0 / math.pi * (math.asin(1.0 / lead) + math.sqrt(1.0 - lead**-2) / lead)


def growth(gain: float, stiffness: float) -> complex:
    """Eigenvalue of the fastest growing oscillation [1/s]."""
    values = np.linalg.eigvals(linear(gain, stiffness))
    swings = values[values.imag > 0.0]
    return complex(swings[np.argmax(swings.real)])


def predicted(gain: float) -> Swing:
    """The cycle for a position gain [1/s].

    For an oscillation of the lead with amplitude A, the screw has the stiffness N(A). A cycle
    exists if the loop with this stiffness has an imaginary eigenvalue.

    Raises
    ------
    ValueError
        If there is no such stiffness up to that of the screw.
    """
    stiffness = float(brentq(lambda n: growth(gain, n).real, 1e-3 * K, K, xtol=1e-9 * K))
    frequency = growth(gain, stiffness).imag
    lead = float(brentq(lambda a: share(a) - stiffness / K, 1.0 + 1e-12, 1e6))
    angle = 2.0 * math.pi * (np.arange(1024) + 0.5) / 1024
    swing = lead * np.cos(angle)
    push = swing - np.clip(swing, -1.0, 1.0)
    third = abs(answer(3j * frequency, gain)) * K * abs(2.0 * np.mean(push * np.cos(3.0 * angle)))
    table = stiffness * lead * B / abs(M * (1j * frequency) ** 2 + D * 1j * frequency)
    return Swing(frequency, lead * B, table, float(third / lead))


def answer(s: complex, gain: float) -> complex:
    """Decrease of the lead per force of the screw [m/N]."""
    table = M * s**2 + D * s
    return (1.0 + (KP + KI / s) * gain / table) / (MM * s**2 + KP * s + KI) + 1.0 / table


def after_a_push(gain: float) -> float:
    """Rest position of the table after a push, over that before it, on the other side.

    The motor arrives with the steady speed gain |x|, and the table is at rest. The motion is linear
    until they separate; then the table slides to rest.
    """
    matrix, step = linear(gain, K), 1e-4
    once = expm(matrix * step)
    state = np.array([-1.0, 0.0, -1.0, gain, 0.0])  # positions without the backlash
    while (later := once @ state)[2] >= later[0]:
        state = later
    parts = brentq(lambda s: (expm(matrix * s) @ state)[[2, 0]] @ [1.0, -1.0], 0.0, step)
    x, v, *_ = expm(matrix * parts) @ state
    return float(x + v * M / D)


@cache
def begin() -> float:
    """Position gain at which a push moves the table to the same distance beyond zero [1/s]."""
    return float(brentq(lambda gain: after_a_push(gain) - 1.0, 4.0, 12.0))


@cache
def end() -> float:
    """Position gain at which the drive without backlash becomes unstable [1/s]."""
    return float(brentq(lambda gain: growth(gain, K).real, HIGH, 2.0 * HIGH))


def motion(law: str, gain: float, stop: float, step: float, start: float = 2e-5) -> Any:
    """The drive's motion to zero, from a start [m] in the middle of the backlash."""
    values = {"x_start": start, "xm_start": start}
    return run_of(DRIVE, stop, step, values, law, 0.0, {"Kx": gain})


def cycle(gain: float) -> Any:
    """Long-term motion of the drive with a position gain [1/s]."""
    return exponents(DRIVE, 2.0, None, TABLE_LOOP, 0.0, {"Kx": gain}).motion


def measured_push(gain: float) -> float:
    """Like `after_a_push`, from the last pushes of a run with long waits."""
    x = motion(TABLE_LOOP, gain, 20.0, 4e-3, start=1e-6).outputs["x"]
    turns = np.flatnonzero(np.sign(x[1:]) != np.sign(x[:-1]))
    waits = [np.abs(x[a + 1 : b + 1]).max() for a, b in itertools.pairwise(turns)]
    return float(waits[-1] / waits[-2])


def findings() -> list[Finding]:
    rows = []
    for gain in (HIGH, LOW):
        theory, ours = predicted(gain), cycle(gain)
        remark = "" if gain == HIGH else "the lead is far from a sine, see the picture"
        for what, mine, theirs, unit in (
            ("frequency", 2.0 * math.pi / ours.period, theory.frequency, "rad/s"),
            ("swing of the table", ours.amplitude["plant_x"], theory.table, "m"),
        ):
            text, known = f"{what}, Kx = {gain:g} 1/s", f"{DESCRIBING}; {LEFT_OUT}"
            rows.append(Finding(text, mine, unit, known, theirs, theory.third * theirs, remark))
    below = np.array([6.3, 6.6])
    ratios = [measured_push(gain) for gain in below]
    slope, offset = np.polyfit(below, ratios, 1)
    started = float((1.0 - offset) / slope)
    moves, starts = "where a push takes the table, over where it was", "where cycles begin"
    outside = f"{PUSH}; ours is extrapolated from 6.3 and 6.6 1/s"
    sines = f"{DESCRIBING}: D/M, where its stiffness is zero"
    remark = "cycles begin with short pushes between endless waits, and not with sines"
    by_pushes, by_sines = (f"position gain {starts}, by {how}" for how in ("pushes", "sines"))
    return [
        *rows,
        Finding(f"{moves}, Kx = 6.3 1/s", ratios[0], "1", PUSH, after_a_push(6.3), 1e-5),
        Finding(by_pushes, started, "1/s", outside, begin(), 5e-3),
        Finding(by_sines, started, "1/s", sines, D / M, 0.5, remark),
    ]


def picture() -> Any:
    with drawing(2, height=3.4) as (figure, (swing, lead)):
        gains = np.concatenate([np.linspace(4.3, 30.0, 30), np.linspace(32.0, 0.997 * end(), 50)])
        theory = [predicted(gain) for gain in gains]
        values, third = (np.array([[s.table / B, s.third] for s in theory])).T
        swing.plot(gains, values, color=COLOURS[1], label="describing function")
        style = {"color": COLOURS[1], "alpha": 0.2, "lw": 0, "label": "its third harmonic"}
        swing.fill_between(gains, values * (1 - third), values * (1 + third), **style)
        found = [cycle(gain).amplitude["plant_x"] / B for gain in SHOWN]
        swing.plot(SHOWN, found, "o", color=COLOURS[0], label="motion")
        for at, text in ((begin(), "begin"), (end(), "end")):
            swing.axvline(at, color="black", ls=":", lw=1.2)
            swing.text(at + 2.0, 0.12, text, fontsize=9)
        swing.set(xlabel="position gain Kx [1/s]", xlim=(0.0, 150.0), yscale="log")
        swing.set(ylabel="swing of the table over b", ylim=(0.1, 100.0))
        swing.set_title("Backlash makes a stable loop hunt")
        swing.legend(loc="upper left")
        for k, gain in enumerate((10.0, HIGH)):
            period = cycle(gain).period
            run = motion(TABLE_LOOP, gain, 3.0, 1e-3)
            late = run.time > 3.0 - 2.5 * period
            time, leads = (run.time[late] - 3.0) / period + 2.5, run.outputs["lead"][late] / B
            style = {"color": COLOURS[k], "ls": ("--", "-")[k], "label": f"Kx = {gain:g} 1/s"}
            lead.plot(time, leads, **style)
        lead.axhspan(-1.0, 1.0, color="#bbbbbb", alpha=0.5, lw=0, label="backlash")
        lead.set(xlabel="time over the period", ylabel="lead of the motor over b", xlim=(0.0, 2.5))
        lead.set(ylim=(-5.0, 7.0), title="Within the backlash nothing pushes")
        lead.legend(loc="upper right", ncols=3, fontsize=9)
    return figure
