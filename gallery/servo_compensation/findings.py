"""Oscillation of a servo with too much or too little friction compensation, and its amplitude.

While it moves, with D = Kamp KT Kd + b - b_hat and k = Kamp KT Kp,

    J v' = -k x - D v - (Tc - Tc_hat) sign(v),

which is linear from one stop to the next. With x > 0 at one stop, the next is at

    -(q x - (1 + q) (Tc - Tc_hat) / k),   q = exp(-pi z / sqrt(1 - z^2)),   z = D / (2 sqrt(k J)).

What happens at a stop depends on the compensation at rest: `holds`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..drawing import COLOURS, DASHES, drawing, part
from ..finding import Finding, cells, exponents, halved
from ..finding import motion as run_of

SERVO = part(__file__, "servo")
BY_VELOCITY, BY_ERROR = part(__file__, "by_velocity"), part(__file__, "by_error")
J, K, TC, B, KD = 0.01, 1.0, 0.1, 0.1, 0.02  # the amplifier's gain times KT is 1 N*m/V
START = 0.3  # [rad]
NATURAL = math.sqrt(K / J)  # [rad/s]
OVER, FAR_OVER, UNDER = 0.12, 0.2, 0.05  # Tc_hat [N*m]
DAMPED = 0.06  # D at which the cycle is computed [N*m*s/rad]
HEAVY = 0.24  # D of a servo that does not oscillate
EXACT = "from stop to stop in closed form"
DESCRIBING = "describing function of the sign, with its third harmonic as tolerance"
GRID = (14, 10)
OUTCOMES = {"stuck on a line of equilibria": 0, "limit cycle": 1, "diverges": 2}


def ratio(damping: float) -> float:
    """Damping ratio of the servo in motion, with D [N*m*s/rad]."""
    return damping / (2.0 * math.sqrt(K * J))


def decay(damping: float) -> float:
    """Amplitude at the next stop over that at the last one; more than 1 for D below 0."""
    z = ratio(damping)
    return math.exp(-math.pi * z / math.sqrt(1.0 - z * z))


def swing(mismatch: float, damping: float) -> float:
    """Amplitude of the cycle [rad]; `mismatch` is Tc - Tc_hat [N*m], of opposite sign to D."""
    q = decay(damping)
    return -mismatch / K * (1.0 + q) / (1.0 - q)


def period(damping: float) -> float:
    """Period of every cycle [s]."""
    return 2.0 * math.pi / (NATURAL * math.sqrt(1.0 - ratio(damping) ** 2))


def sine(mismatch: float, damping: float) -> float:
    """Like `swing`, by the describing function: D + 4 mismatch / (pi A w) is zero."""
    return -4.0 * mismatch / (math.pi * damping * NATURAL)


def third(damping: float) -> float:
    """Third harmonic of the angle, which the describing function neglects, over the first."""
    z = abs(ratio(damping))
    return 2.0 * z / (3.0 * abs(8.0 - 6.0j * z))


def holds(law: str, angle: float, mismatch: float) -> bool:
    """Whether the servo stays at rest after a stop at an angle [rad]."""
    return K * abs(angle) <= (TC if law == BY_VELOCITY else mismatch)


def outcome(law: str, mismatch: float, damping: float, start: float = START) -> int:
    """Result of a start from rest: 0, it rests; 1, it oscillates; 2, it diverges."""
    q, angle = decay(damping), start
    for _ in range(10_000):
        if holds(law, angle, mismatch):
            return 0
        if angle > 1e6:
            return 2
        angle = q * angle - (1.0 + q) * mismatch / K
    return 1


def least(damping: float) -> float:
    """Smallest over-compensation with a cycle, if nothing is compensated at rest."""
    return TC * (1.0 - decay(damping)) / (1.0 + decay(damping))


def _gains(model: float, damping: float) -> dict[str, float]:
    """Gains for D: viscous friction is over-compensated for a small D, else Kd is raised."""
    return {"Tc_hat": model, "Kd": max(damping, KD), "b_hat": B + KD - min(damping, KD)}


def motion(
    law: str,
    model: float,
    damping: float,
    stop: float = 15.0,
    step: float = 0.5,
    start: float = START,
) -> Any:
    """The motion to zero from a start at rest [rad]; `model` is Tc_hat [N*m]."""
    return run_of(SERVO, stop, step, {"x_start": start}, law, 0.0, _gains(model, damping))


def cycle(law: str, model: float, damping: float) -> Any:
    """Long-term motion of the servo."""
    return exponents(SERVO, 40.0, None, law, 0.0, _gains(model, damping)).motion


def rests(run: Any) -> bool:
    return bool(run.outputs["stuck"][-1] > 0.5)


def _border(rested: Callable[[float], bool], low: float, high: float) -> float:
    """Value at which `rested` changes from true to false."""
    return 0.5 * sum(halved(rested, low, high, 1e-7))


def swings_from(damping: float) -> float:
    """Smallest over-compensation with oscillation [N*m], if nothing is compensated at rest."""
    return _border(lambda m: rests(motion(BY_VELOCITY, TC + m, damping)), 0.0, TC)


def radius(damping: float) -> float:
    """Smallest start without a final rest, with D below 0 and too little compensation [rad]."""
    return _border(lambda x: rests(motion(BY_VELOCITY, UNDER, damping, start=x)), TC / K, 1.0)


def moves_from(law: str) -> float:
    """Smallest start at rest from which it moves, with too little compensation [rad]."""

    def stays(start: float) -> bool:
        return bool(motion(law, UNDER, KD, 0.2, 0.1, start).outputs["x"][-1] == start)

    return _border(stays, 0.0, 1.5 * TC / K)


def mapped(law: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Tc - Tc_hat, D, result of each cell, and amplitude of the cycle [rad]."""
    x, y = (f"{n}=0.004:0.196:{k}" for n, k in zip(("Tc_hat", "b_hat"), GRID, strict=True))
    found = cells(SERVO, x, y, 20.0, law, 0.0)
    mismatch, damping = TC - np.array(found["Tc_hat"]), KD + B - np.array(found["b_hat"])
    kinds = np.array([OUTCOMES.get(kind, -1) for kind in found["verdict"]])
    swings = np.array([size or np.nan for size in found["oscillation_amplitude"]])
    return mismatch, damping, kinds, np.where(kinds == 1, swings, np.nan)


def differing(law: str) -> int:
    """Number of cells of the map that differ from `outcome`."""
    mismatch, damping, kinds, _ = mapped(law)
    theory = [outcome(law, *cell) for cell in zip(mismatch, damping, strict=True)]
    return int(np.sum(kinds != theory))


def findings() -> list[Finding]:
    ours, mismatch = cycle(BY_VELOCITY, FAR_OVER, DAMPED), TC - FAR_OVER
    z, size, wait = f"z = {ratio(DAMPED):g}", ours.amplitude["plant_x"], ours.period or 0.0
    exact, first = swing(mismatch, DAMPED), sine(mismatch, DAMPED)
    share, digit = third(DAMPED), 1e-5 * exact
    left_out = "its error grows as z^2, its third harmonic as z"
    decays, rate = "-D/(2 J), the logarithm of q over half a period", float(ours.limit[1])
    least_over, count = swings_from(KD), GRID[0] * GRID[1]
    larger = f"{EXACT}: the amplitude is larger than the band of rest"
    sticks = "at rest nothing is compensated, and the servo sticks"
    end = float(motion(BY_VELOCITY, OVER, HEAVY, 5.0).outputs["x"][-1])
    beyond = "(Tc - Tc_hat) / k, beyond the goal; there are no stops"
    over, moves = "over-compensation from which it swings", "error from which it moves"
    ends = f"where it ends, Tc_hat = {OVER:g} N*m, z = {ratio(HEAVY):g}"
    grows = f"unstable cycle, z = {ratio(-KD):g}: start from which it diverges"
    held, free = moves_from(BY_VELOCITY), moves_from(BY_ERROR)
    mapped_ = f"cells of the map of {count} that differ from theory, nothing compensated at rest"
    return [
        Finding(f"swing of the cycle, {z}", size, "rad", EXACT, exact, digit),
        Finding(f"the same, {z}", size, "rad", DESCRIBING, first, share * first, left_out),
        Finding(f"period of the cycle, {z}", wait, "s", EXACT, period(DAMPED), 1e-6),
        Finding(
            f"second exponent of the cycle [nats/s], {z}",
            rate,
            "1/s",
            decays,
            -DAMPED / (2 * J),
            1e-4,
        ),
        Finding(f"{over}, z = {ratio(KD):g}", least_over, "N*m", larger, least(KD), 1e-6),
        Finding(
            "the same, by the describing function",
            least_over,
            "N*m",
            "any D > 0 with any Tc < Tc_hat",
            0.0,
            1e-6,
            sticks,
        ),
        Finding(ends, end, "rad", beyond, TC - OVER, 1e-7),
        Finding(grows, radius(-KD), "rad", EXACT, swing(TC - UNDER, -KD), 2e-6),
        Finding(f"{moves}, nothing compensated at rest", held, "rad", "Tc / k", TC / K, 1e-6),
        Finding(
            f"{moves}, compensated at rest",
            free,
            "rad",
            "(Tc - Tc_hat) / k",
            (TC - UNDER) / K,
            1e-6,
        ),
        Finding(mapped_, float(differing(BY_VELOCITY)), "1", EXACT, 0.0, 0.5),
    ]


def _plane(axes: Any) -> None:
    """Draw motions from two starts next to the cycle, and one start within the band of rest."""
    for k, (start, label) in enumerate(((0.45, "from outside"), (0.115, "from inside"))):
        run = motion(BY_VELOCITY, FAR_OVER, DAMPED, 1.2, 1e-3, start)
        style = {"color": COLOURS[k], "ls": DASHES[k], "lw": 1.4, "label": label}
        axes.plot(run.outputs["x"], run.outputs["v"], **style)
    first, angle = sine(TC - FAR_OVER, DAMPED), np.linspace(0.0, 2.0 * np.pi, 200)
    style = {"color": "#000000", "ls": ":", "lw": 1.2, "label": "describing function"}
    axes.plot(first * np.cos(angle), first * NATURAL * np.sin(angle), **style)
    axes.plot([-TC / K, TC / K], [0.0, 0.0], color="#777777", lw=5, solid_capstyle="butt")
    axes.text(0.0, 0.18, "stays at rest", ha="center", fontsize=9)
    axes.set(xlabel="angle [rad]", ylabel="velocity [rad/s]", xlim=(-0.5, 0.5), ylim=(-4.2, 6.4))
    axes.set_title(f"Over-compensated: cycle of {swing(TC - FAR_OVER, DAMPED):.3g} rad")
    axes.legend(fontsize=9, loc="upper right")


def _map(axes: Any) -> None:
    shape = GRID[::-1]
    mismatch, damping, kinds, swings = (c.reshape(shape) for c in mapped(BY_VELOCITY))
    x, y = mismatch[0] / TC, damping[:, 0]
    style = {"cmap": "viridis_r", "vmin": 0.0, "vmax": 800.0, "shading": "nearest"}
    shade = axes.pcolormesh(x, y, np.ma.masked_invalid(1e3 * swings), **style)
    axes.figure.colorbar(shade, ax=axes, label="swing of the cycle [mrad]", extend="max")
    away = np.ma.masked_where(kinds != 2, np.full(kinds.shape, 0.4))
    axes.pcolormesh(x, y, away, cmap="Greys", vmin=0.0, vmax=1.0, shading="nearest")
    axes.axhline(0.0, color="#000000", ls=":", lw=1.2, label="describing function")
    axes.axvline(0.0, color="#000000", ls=":", lw=1.2)
    style = {"color": "#D55E00", "ls": "--", "lw": 1.6}
    fine = np.linspace(1e-3, 0.116, 100)
    axes.plot([-least(d) / TC for d in fine], fine, **style)
    below = -fine[fine < 0.076]
    q = np.array([decay(d) for d in below])
    border = K * START / TC * (q - 1.0) / (q + 1.0)
    axes.plot(border, below, **style, label="closed form")
    axes.text(0.5, 0.09, "rests", ha="center", fontsize=9)
    axes.text(-0.5, -0.03, "diverges", ha="center", fontsize=9)
    axes.legend(fontsize=9, loc="lower left")
    axes.set(xlabel="(Tc - Tc_hat) / Tc", ylabel="D [N m s/rad]", xlim=(-0.99, 0.99))
    axes.set(ylim=(-0.083, 0.123), title="Nothing compensated at rest")
    axes.grid(visible=False)


def picture() -> Any:
    with drawing(2) as (figure, (plane, outcomes)):
        _plane(plane)
        _map(outcomes)
    return figure
