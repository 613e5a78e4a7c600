"""Motions of a driven mass with dry friction, and the closed form of its motion without stops.

In units of mass, spring and the force P, the mass slides from its turn at x0 to the turn at -x0,
half a period later, as

    x = f (1 - cos t - b U sin t) + x0 cos(b t) + f U sin(b t),

with the friction f, the frequency b of the force, U = sin(pi/b) / (b (1 + cos(pi/b))), and
x0^2 = V^2 - f^2 U^2 where V = 1/(1 - b^2): `Turning`. The page derives it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..drawing import COLOURS, DASHES, drawing, part
from ..finding import Finding, exponents, halved
from ..finding import motion as run_of

OSCILLATOR = part(__file__, "oscillator")
CLOSED_FORM = "closed form of the motion without stops"
SWINGS = ((0.45, 0.1), (0.8, 0.5), (1.4, 0.5))  # b and F, without stops
SLOW, STIFF = (0.8, 0.5), (0.8, 0.8)  # exponents: a complex pair, and two real ones
BORDERS = {0.45: (0.15, 0.35), 0.8: (0.75, 0.95), 1.4: (0.55, 0.75)}  # F below and above the border
STOPPING = ((0.3, 0.6), (0.1, 0.3), (0.1, 0.5))
SIDE = 0.2, 0.05  # F, and offset of the motion from the middle
WIDTH = 0.2 / 2**10  # of the interval that has a border
ROWS = 200  # output rows per period to count stops

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Turning:
    """The motion without stops that turns twice in each period.

    Attributes
    ----------
    swing : float
        Amplitude, over that of a slow force without friction; NaN if the motion does not exist.
    phase : float
        Phase of the force at the turn at the far end [rad].
    ratio : float
        Acceleration just after a turn over that just before; below 0 the mass would stop.
    multipliers : ndarray of complex, shape (2,)
        Multipliers of disturbances per half period.
    goes_on : bool
        Whether the motion exists: no stop at the turns or in between.
    """

    b: float
    f: float
    swing: float
    phase: float
    ratio: float
    multipliers: npt.NDArray[np.complex128]
    goes_on: bool

    def at(self, times: Vector) -> tuple[Vector, Vector]:
        """Displacement and velocity at times within half a period, starting at the far end."""
        b, f, u = self.b, self.f, damping(self.b)
        x = f * (1.0 - np.cos(times) - b * u * np.sin(times))
        x = x + self.swing * np.cos(b * times) + f * u * np.sin(b * times)
        v = f * (np.sin(times) - b * u * np.cos(times))
        v = v - b * self.swing * np.sin(b * times) + f * b * u * np.cos(b * times)
        return x, v

    @property
    def start(self) -> tuple[float, float]:
        """Displacement and velocity at the largest force."""
        half = math.pi / self.b
        turns, since = divmod(-self.phase / self.b, half)
        x, v = self.at(np.array(since))
        side = -1.0 if turns % 2 else 1.0
        return side * float(x), side * float(v)


def response(b: float) -> float:
    """V: the amplitude without friction, with its sign."""
    return 1.0 / (1.0 - b**2)


def damping(b: float) -> float:
    """U, by which friction reduces the amplitude."""
    return math.sin(math.pi / b) / (b * (1.0 + math.cos(math.pi / b)))


def steepness(b: float) -> float:
    """S: the amplitude, over f, needed for motion without stops.

    At a turn 1/b^2 is needed. At some frequencies below 1/2 more is needed between the turns.
    """
    t = np.linspace(0.0, math.pi / b, 4002)[1:-1]
    needed = np.sin(t) + b * damping(b) * (np.cos(b * t) - np.cos(t))
    return max(1.0 / b**2, float((needed / (b * np.sin(b * t))).max()))


def border(b: float) -> float:
    """Smallest friction, over the force, at which the mass stops."""
    return abs(response(b)) / math.hypot(damping(b), steepness(b))


def turning(b: float, f: float) -> Turning:
    """The motion without stops for the frequency b of the force and the share f of friction."""
    v, u = response(b), damping(b)
    square = v**2 - (f * u) ** 2
    swing = math.sqrt(square) if square > 0.0 else math.nan
    phase = math.atan2(-f * u / v, swing / v)
    ratio = (b**2 * swing - f) / (b**2 * swing + f)
    middle = -0.5 * math.cos(math.pi / b) * (1.0 + ratio)
    root = np.emath.sqrt(middle**2 - ratio)
    both = np.array([middle + root, middle - root], complex)
    return Turning(b, f, swing, phase, ratio, both, f < border(b))


def rates(known: Turning) -> Vector:
    """Exponents of the closed form, larger first [nats/s]."""
    return np.sort(np.log(np.abs(known.multipliers)) * known.b / math.pi)[::-1]


def motion(b: float, f: float, periods: float = 20.0, x: float = 0.0) -> Any:
    """Long-term motion from rest at x, and its exponents."""
    values = {"b": b, "F": f, "x_start": x}
    return exponents(OSCILLATOR, periods * 2 * math.pi / b, values).motion


def course(values: Mapping[str, float], periods: float, rows: int) -> Any:
    """A motion with `rows` output rows per period."""
    period = 2.0 * math.pi / values["b"]
    return run_of(OSCILLATOR, periods * period, period / rows, values)


def stops(b: float, f: float) -> int:
    """Number of stops per period, after ten periods."""
    stuck = course({"b": b, "F": f}, 11, ROWS).outputs["stuck"][-ROWS - 1 :] > 0.5
    return int(np.sum(stuck[1:] & ~stuck[:-1]))


def first_stop(b: float) -> float:
    """Smallest friction at which the mass stops, by bisection.

    After a stop, the motion does not depend on the state before: an exponent is minus infinity.
    """

    def goes_on(f: float) -> bool:
        return not np.isneginf(motion(b, f, 10.0).limit).any()

    return 0.5 * sum(halved(goes_on, *BORDERS[b], 1.001 * WIDTH))


def growth(f: float) -> float:
    """Growth of the amplitude per period at resonance, over the amplitude of a slow force."""
    outputs = course({"b": 1.0, "F": f}, 400, 4).outputs
    size = np.hypot(outputs["x"], outputs["v"])[::4]
    return float((size[400] - size[200]) / 200.0)


def findings() -> list[Finding]:
    rows = []
    for b, f in SWINGS:
        swing, closed = motion(b, f).amplitude["plant_x"], turning(b, f).swing
        rows.append(
            Finding(f"swing at b = {b:g}, F = {f:g} P", swing, "m", CLOSED_FORM, closed, 1e-6)
        )
    total, both = float(motion(*SLOW).limit.sum()), motion(*STIFF).limit
    known = f"{CLOSED_FORM}: log of the ratio of its accelerations about a turn, twice in a period"
    where = f"b = {SLOW[0]:g}, F = {SLOW[1]:g} P [nats/s]"
    theirs = float(rates(turning(*SLOW)).sum())
    rows.append(Finding(f"sum of both exponents at {where}", total, "1/s", known, theirs, 1e-6))
    known = f"{CLOSED_FORM}: eigenvalue of its slide and its turn"
    for which, ours, closed in zip(("first", "second"), both, rates(turning(*STIFF)), strict=True):
        what = f"{which} exponent at b = {STIFF[0]:g}, F = {STIFF[1]:g} P [nats/s]"
        rows.append(Finding(what, float(ours), "1/s", known, float(closed), 1e-6))
    beside = float(motion(0.5, SIDE[0], 20.0, response(0.5) + SIDE[1]).limit[0])
    known = (
        "a slide takes the time of a free swing, so the turns are V + d and d - V for every "
        f"small d; here {SIDE[1]:g} P/k"
    )
    what = f"first exponent at b = 1/2, F = {SIDE[0]:g} P, beside the symmetric motion [nats/s]"
    rows.append(Finding(what, beside, "1/s", known, 0.0, 1e-9))
    for b, place in ((0.45, "on the way"), (0.8, "at the turn"), (1.4, "at the turn")):
        known = f"{CLOSED_FORM}, where it ends {place}; ours by bisection"
        what = f"F from which on it stops, over P, at b = {b:g}"
        rows.append(Finding(what, first_stop(b), "1", known, border(b), WIDTH))
    low, high = 0.6, 0.7
    balance = low + (high - low) * growth(low) / (growth(low) - growth(high))
    known = (
        "pi/4: in half a period the force gives pi P x0 / 2 and friction takes 2 F x0; ours is "
        "extrapolated from runs at 0.6 and 0.7"
    )
    what = "F at which the swing no longer grows at resonance, over P"
    rows.append(Finding(what, balance, "1", known, math.pi / 4.0, 1e-4))
    known = "slide by slide in closed form, the tests count the same"
    for b, f in STOPPING:
        what = f"stops in a period at b = {b:g}, F = {f:g} P"
        rows.append(Finding(what, stops(b, f), "1", known))
    return rows


def _swings(axes: Any) -> None:
    grid = np.array([b for b in np.linspace(0.36, 1.8, 289) if abs(b - 1.0) > 1e-3])
    for f, colour, dash in zip((0.2, 0.5, 0.7), COLOURS, DASHES, strict=False):
        known = [turning(b, f) for b in grid]
        closed = [k.swing if k.goes_on else np.nan for k in known]
        axes.semilogy(grid, closed, color=colour, ls=dash, lw=1.3, label=f"F = {f:g} P")
        for b in (0.6, 0.75, 0.85, 1.2, 1.4, 1.6):
            axes.semilogy(b, motion(b, f).amplitude["plant_x"], "o", color=colour, ms=4)
    axes.set(xlabel="b = frequency over that of the mass", ylabel="swing / (P/k)", ylim=(0.05, 60))
    axes.set_title("Dots: runs. Lines: without stops")
    axes.legend(loc="upper left")


def _exponents(axes: Any) -> None:
    b = 0.8
    grid = np.concatenate([np.linspace(0.02, 0.8, 100), border(b) - np.geomspace(0.017, 1e-5, 60)])
    known = np.array([rates(turning(b, f)) for f in grid])
    for k, label in ((0, "first"), (1, "second")):
        axes.plot(grid, known[:, k], color=COLOURS[k], ls=DASHES[k], lw=1.3, label=label)
    for f in (0.3, 0.45, 0.6, 0.7, 0.76, 0.8, 0.815, 0.85, 0.9):
        found = motion(b, f).limit
        for k in (0, 1):
            axes.plot(f, found[k], "os"[k], color=COLOURS[k], ms=4)
    axes.axvline(border(b), color="black", lw=1.0, ls=":")
    axes.text(border(b) + 0.01, -1.0, "stops: the\nsecond is\nminus infinity", fontsize=9)
    axes.set(xlabel="F / P", ylabel="exponents [nats/s]", ylim=(-1.3, 0.05), xlim=(0.2, 1.05))
    axes.set_title(f"A stop forgets the past (b = {b:g})")
    axes.legend(loc="lower left")


def picture() -> Any:
    with drawing(2) as (figure, (swings, rates_)):
        _swings(swings)
        _exponents(rates_)
    return figure
