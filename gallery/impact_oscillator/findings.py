"""Motions of an oscillator that strikes a stop, and the closed form of its simplest motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from ..drawing import COLOURS, drawing, part
from ..finding import Finding
from ..finding import exponents as exponents_of
from ..finding import motion as run_of

OSCILLATOR = part(__file__, "oscillator")
ZETA, OMEGA, GAP, R = 0.1, 2.5, 1.0, 0.5
PERIOD = 2.0 * math.pi / OMEGA
LOW, HIGH = 0.9, 2.6  # shares of the grazing force
PERIODIC, CHAOTIC = 2.5, 1.5
SHORT = 30  # periods within which chaos does not make round-off large
CLOSED_FORM = "closed form of the motion with one impact in each period"

Vector = npt.NDArray[np.float64]


def swing(zeta: float, omega: float) -> tuple[float, float]:
    """Cosine and sine part of the motion without impacts, per unit of force."""
    inertia, damping = 1.0 - omega**2, 2.0 * zeta * omega
    return inertia / (inertia**2 + damping**2), damping / (inertia**2 + damping**2)


GRAZING = GAP / math.hypot(*swing(ZETA, OMEGA))


@dataclass(frozen=True)
class SingleImpact:
    """The motion with one impact in each period of the force.

    Attributes
    ----------
    speed : float
        Speed before the impact [1/s].
    phase : float
        Phase of the force at the impact [rad].
    multipliers : ndarray of complex, shape (2,)
        Multipliers of disturbances per period.
    start : tuple of float
        Displacement and velocity [1/s] at the largest force.
    """

    speed: float
    phase: float
    multipliers: npt.NDArray[np.complex128]
    start: tuple[float, float]


def single_impact(
    force: float, zeta: float = ZETA, omega: float = OMEGA, gap: float = GAP, r: float = R
) -> SingleImpact:
    """The motion with one impact per period; other impacts in between are not checked.

    After an impact at the time 0 the motion is h(t), free and damped, with the forced swing p(t).
    From h(T) = h(0) and h'(T) - h'(0) = (1 + r) V follow h'(0), h'(T) and V as multiples of h(0),
    and h(0) from the amplitude of p: a quadratic equation.

    Raises
    ------
    ValueError
        If there is no such motion.
    """
    w, period = math.sqrt(1.0 - zeta**2), 2.0 * math.pi / omega
    decay, c, s = math.exp(-zeta * period), math.cos(w * period), math.sin(w * period)
    first = w * (1.0 / decay - c) / s - zeta  # h'(0)/h(0)
    last = w * (c - decay) / s - zeta  # h'(T)/h(0)
    speed = (last - first) / (1.0 + r)  # V/h(0)
    a, b = (force * q for q in swing(zeta, omega))
    # p = gap - h(0) and p' = V - h'(T) at the impact; p^2 + (p'/omega)^2 = a^2 + b^2
    square = 1.0 + ((speed - last) / omega) ** 2
    left = gap**2 - square * (gap**2 - a**2 - b**2)
    if left < 0.0:
        raise ValueError("the force is too weak for an impact in each period")
    h = (gap + math.copysign(math.sqrt(left), speed)) / square
    if h * speed <= 0.0:
        raise ValueError("no motion with one impact in each period moves towards the stop")
    p, q = gap - h, (speed - last) * h / omega
    phase = math.atan2(b * p - a * q, a * p + b * q)
    kick = (1.0 + r) * (force * math.cos(phase) - gap) / (speed * h)
    trace = decay * (kick * s / w - 2.0 * r * c)
    middle, root = 0.5 * trace, np.emath.sqrt(0.25 * trace**2 - (r * decay) ** 2)
    t = (-phase % (2.0 * math.pi)) / omega
    rate = (first + zeta) * h / w
    cos, sin = math.cos(w * t), math.sin(w * t)
    x = math.exp(-zeta * t) * (h * cos + rate * sin)
    v = math.exp(-zeta * t) * w * (rate * cos - h * sin) - zeta * x
    return SingleImpact(
        speed * h, phase, np.array([middle + root, middle - root], complex), (x + a, v + omega * b)
    )


@cache
def doubling() -> float:
    """Force over the grazing force at the period doubling of the motion with one impact."""

    def beyond(share: float) -> float:
        return float(single_impact(share * GRAZING).multipliers.real.min()) + 1.0

    return float(brentq(beyond, 2.0, PERIODIC))


def without_impacts(share: float) -> dict[str, float]:
    """Force and start of the motion without impacts, at a share of the grazing force."""
    a, b = (share * GRAZING * q for q in swing(ZETA, OMEGA))
    return {"force": share * GRAZING, "x_start": a, "v_start": b * OMEGA}


def motion(values: Mapping[str, float], periods: float, rows: int = 1) -> Any:
    """A motion with `rows` output rows per period."""
    return run_of(OSCILLATOR, periods * PERIOD, PERIOD / rows, values)


def exponents(share: float, periods: float = 100.0) -> Any:
    """Exponents at a share of the grazing force."""
    return exponents_of(OSCILLATOR, periods * PERIOD, {"force": share * GRAZING})


def largest_exponents(low: float, high: float, points: int) -> tuple[Vector, Vector]:
    """Largest exponents while the force grows slowly, each over 30 periods [nats/s].

    They end at a chatter, after which there is no tangent.
    """
    end = 30 * points * PERIOD
    values = without_impacts(low) if low < 1.0 else {}
    values |= {"force": low * GRAZING, "ramp": (high - low) * GRAZING / end, "ramp_end": end}
    found = exponents_of(OSCILLATOR, end, values).spectrum
    grid = np.linspace(0.0, end, points + 1)
    growth = np.interp(grid, found.time, found.growth[:, 0])
    known = np.isfinite(growth)
    shares = low + (high - low) * (np.arange(points) + 0.5) / points
    return shares[known[1:]], np.diff(growth[known]) / (30 * PERIOD)


def findings() -> list[Finding]:
    below = exponents_of(OSCILLATOR, 20.0 * PERIOD, without_impacts(0.99)).motion
    known, periodic = single_impact(PERIODIC * GRAZING), exponents(PERIODIC).motion
    end = float(motion({"force": PERIODIC * GRAZING}, 200).outputs["x"][-1])
    rates = np.sort(np.log(np.abs(known.multipliers)))[::-1] / PERIOD
    chaos = exponents(CHAOTIC, SHORT)
    impacts = chaos.spectrum.events / 2.0  # two events per impact
    dissipation = -2.0 * ZETA + 2.0 * math.log(R) * impacts / chaos.spectrum.time[-1]
    near = np.array([1.01, 1.02]) * doubling()
    factors = [-math.exp(exponents(share).motion.limit[0] * PERIOD) for share in near]
    (slope, offset) = np.polyfit(near, factors, 1)
    doubles, saltation = float((-1.0 - offset) / slope), "eigenvalue of its saltation and flight"
    first, total = float(chaos.exponents[0]), float(chaos.exponents.sum())
    amplitude = "amplitude of the motion without impacts; the gap is 1"
    extrapolated = (
        f"{CLOSED_FORM}, where an eigenvalue is -1; ours is extrapolated linearly from exponents "
        "at 1.01 and 1.02 times that force"
    )
    from_impacts = (
        "chaos; the map from impact to impact, with saltation, gives the same to 1e-6, and over "
        "2500 impacts within four standard errors"
    )
    counted = "-2 zeta, and 2 log(r) for each impact that was counted"
    swing, at = below.amplitude["plant_x"], f"F = {PERIODIC:g} F_g"
    largest = f"largest exponent over {SHORT} periods from rest, F = {CHAOTIC:g} F_g [nats/s]"
    both = f"sum of both exponents over {SHORT} periods, F = {CHAOTIC:g} F_g [nats/s]"
    where, start = f"x where the force is largest, {at}", known.start[0]
    rows = [
        Finding("swing of x at 0.99 of the grazing force", swing, "1", amplitude, 0.99, 1e-6),
        Finding(where, end, "1", CLOSED_FORM, start, 1e-7),
    ]
    for which, ours, theirs in zip(("first", "second"), periodic.limit, rates, strict=True):
        what, source = f"{which} exponent, {at} [nats/s]", f"{CLOSED_FORM}: {saltation}"
        rows.append(Finding(what, float(ours), "1/s", source, float(theirs), 1e-6))
    what = "force of period doubling, over F_g"
    return [
        *rows,
        Finding(what, doubles, "1", extrapolated, doubling(), 2e-3),
        Finding(largest, first, "1/s", from_impacts),
        Finding(both, total, "1/s", counted, dissipation, 1e-9),
    ]


def picture() -> Any:
    with drawing(2) as (figure, (rates, orbits)):
        for low, high, points in ((LOW, 1.3, 10), (1.32, HIGH, 40)):
            where, largest = largest_exponents(low, high, points)
            rates.plot(where, largest, "-", color=COLOURS[0], lw=0.8)
            for sign, k, label in ((1, 1, "chaos"), (-1, 0, "order")):
                shown = sign * largest > 0.0
                style = {"color": COLOURS[k], "ms": 4, "label": label if low > 1 else None}
                rates.plot(where[shown], largest[shown], "o", **style)
        rates.axhline(0.0, color="black", lw=0.8)
        known = np.linspace(doubling(), HIGH, 40)
        slow = [np.abs(single_impact(s * GRAZING).multipliers).max() for s in known]
        rates.plot(known, np.log(slow) / PERIOD, color=COLOURS[1], lw=1.3, ls="--")
        for at, text in ((1.0, "grazing"), (doubling(), "doubling")):
            rates.axvline(at, color="black", lw=1.0, ls=":")
            rates.text(at + 0.015, 0.25, text, fontsize=9)
        rates.text(1.235, 0.02, "chatter:\nminus\ninfinity", fontsize=9, ha="center")
        rates.set(xlim=(LOW, HIGH), ylim=(-0.5, 0.3), xlabel="force over that of grazing")
        rates.set(ylabel="largest exponent [nats/s]", title="Its sign tells chaos from order")
        rates.legend(loc="lower right")
        x, v = single_impact(PERIODIC * GRAZING).start
        wild = motion({"force": CHAOTIC * GRAZING}, 56, 100)
        calm = motion({"force": PERIODIC * GRAZING, "x_start": x, "v_start": v}, 1, 200)
        for run, since, k, share in ((wild, 20, 1, CHAOTIC), (calm, 0, 0, PERIODIC)):
            late = run.time >= since * PERIOD
            wide = {"color": COLOURS[k], "lw": 0.7 if since else 2.0, "label": f"{share:g} F_g"}
            orbits.plot(run.outputs["x"][late], run.outputs["v"][late], **wide)
        orbits.axvline(GAP, color="black", lw=3.0)
        orbits.set(xlabel="x", ylabel="v [1/s]", title="The stop returns half of the speed")
        orbits.legend(loc="upper left")
    return figure
