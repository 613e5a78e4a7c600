"""Steady sliding in closed form, and simulated motions near it.

With time in units of L/v0, the normal force N of steady sliding, M = m v0^2/(N L), kappa = k
cos(psi) L/N, g = cos(psi) + mu0 sin(psi) and c = 1 + alpha kappa sin(psi)/b, its linear part has
the characteristic polynomial

    M s^3 + (M + a) s^2 + (a + g kappa - b c) s + g kappa.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

import ballscrew

from ..drawing import part

AGEING, SLIP = part(__file__, "ageing"), part(__file__, "slip")
SMALL = 1e-4  # amplitudes of ln(v/v0) that grow or decay as in the linear part
POINTS, FINE = 48, 400  # outputs per turn; FINE if the largest output is the peak


@dataclass(frozen=True)
class Sliding:
    """Steady sliding, with the parameters' defaults of `components.py`."""

    m: float = 1.0
    k: float = 5000.0
    psi: float = 0.0
    W: float = 10.0
    v0: float = 5e-4
    mu0: float = 0.6
    a: float = 0.01
    b: float = 0.015
    L: float = 1e-5
    alpha: float = 0.0

    @property
    def grip(self) -> float:
        """g: net share of the spring's force along the surface, with its effect on friction."""
        return math.cos(self.psi) + self.mu0 * math.sin(self.psi)

    @property
    def normal(self) -> float:
        """The normal force [N]."""
        return self.W * math.cos(self.psi) / self.grip

    @property
    def inertia(self) -> float:
        """Dimensionless inertia M/a."""
        return self.m * self.v0**2 / (self.a * self.normal * self.L)

    @property
    def critical(self) -> float:
        """Stiffness at which a pair of roots is imaginary, by Hurwitz [N/m]."""
        heavy = 1 + self.inertia
        gain = self.grip - self.alpha * heavy * math.sin(self.psi)
        return self.normal * (self.b - self.a) * heavy / (self.L * math.cos(self.psi) * gain)

    def roots(self) -> np.ndarray:
        """Eigenvalues of the linear part, the fastest growing first [1/s]."""
        kappa = self.k * math.cos(self.psi) * self.L / self.normal
        m = self.inertia * self.a
        bent = self.b + self.alpha * kappa * math.sin(self.psi)
        pull = self.grip * kappa
        roots = np.roots([m, m + self.a, self.a + pull - bent, pull])
        return np.asarray(roots[np.lexsort((-roots.imag, -roots.real))] * self.v0 / self.L)

    def start(self, swing: float) -> dict[str, float]:
        """States on the eigenvector that grows fastest, with ln(v/v0) = `swing`."""
        root = self.roots()[0]
        kappa = self.k * math.cos(self.psi) * self.L / self.normal
        c = 1 + self.alpha * kappa * math.sin(self.psi) / self.b
        return {
            "x_start": (-self.v0 * swing / root).real,
            "u_start": swing,
            "w_start": (-c * swing / (root * self.L / self.v0 + 1)).real,
        }

    @property
    def bends(self) -> float:
        """First Lyapunov coefficient of the ageing law's Hopf point at psi = 0, over M/a.

        That of the slip law is negative. Both are per square of the amplitude of ln(v/v0).
        """
        x, s = self.inertia, self.b / self.a - 1
        below = (x * x * s + (x + 1) ** 2) * (4 * x * x * s + (x + 1) ** 2)
        return math.sqrt(s) * (1 - 6 * x - (7 + 4 * s) * x * x) / (2 * below)

    @property
    def bends_slip(self) -> float:
        x, s = self.inertia, self.b / self.a - 1
        below = (x * x * s + (x + 1) ** 2) * (4 * x * x * s + (x + 1) ** 2)
        return -math.sqrt(s) * (x + 1) * (9 * x + 1) * (s + 1) / (2 * below)


def at(share: float, **values: float) -> Sliding:
    """Steady sliding with `share` times the critical stiffness."""
    return Sliding(**{**values, "k": share * Sliding(**values).critical})


@cache
def motion(law: str, sliding: Sliding, stop: float, step: float, **start: float) -> Any:
    return ballscrew.run(
        "none",
        law,
        stop=stop,
        step=step,
        coupling=ballscrew.Coupling("monolithic"),
        plant_values={**vars(sliding), **start},
    ).run


@cache
def verdict(law: str, sliding: Sliding, stop: float, swing: float = 0.01) -> Any:
    values = {**vars(sliding), "u_start": swing}
    return ballscrew.lyapunov("none", law, stop=stop, plant_values=values).motion


def turns(law: str, sliding: Sliding, swing: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Times of maxima and minima of the spring's force [s], and the force there [N]."""
    turn = 2 * np.pi / abs(sliding.roots()[0].imag)
    run = motion(law, sliding, (count + 0.5) * turn, turn / POINTS, **sliding.start(swing))
    rate = sliding.k * math.cos(sliding.psi) * (sliding.v0 - run.outputs["v"])
    force = CubicHermiteSpline(run.time, run.outputs["F"], rate)
    times = force.derivative().roots(extrapolate=False)
    times = times[times > 0.6 * turn]  # other modes have decayed
    return times, force(times)


def growth(law: str, sliding: Sliding, swing: float = SMALL, count: int = 6) -> float:
    """Growth rate of amplitudes [nats/s]."""
    times, force = turns(law, sliding, swing, count)
    ranges = np.abs(np.diff(force))
    return float(np.log(ranges[-1] / ranges[0]) / (times[-2] - times[0]))


@cache
def critical(law: str, **values: float) -> tuple[float, float]:
    """Stiffness at which small amplitudes are constant [N/m], and their period [s]."""
    guess = Sliding(**values).critical

    def rate(k: float) -> float:
        return growth(law, Sliding(**{**values, "k": k}))

    k = float(brentq(rate, 0.9 * guess, 1.1 * guess, xtol=1e-7 * guess))
    times, _ = turns(law, Sliding(**{**values, "k": k}), SMALL, 6)
    return k, float(2 * np.mean(np.diff(times)))


def escape(law: str, sliding: Sliding, swing: float = SMALL) -> float:
    """Rate at which ln(v/v0) grows or decays without oscillation [nats/s]."""
    stop = 1.0 / abs(sliding.roots()[0].real)
    run = motion(law, sliding, stop, stop / 4, **sliding.start(swing))
    return float(np.log(np.log(run.outputs["v"][-1] / sliding.v0) / swing) / stop)


@cache
def jams(**values: float) -> float:
    """Angle below which sliding at a given normal force is unstable without oscillation [rad].

    The weight is such that the normal force is the same as with a level spring.
    """

    def rate(psi: float) -> float:
        level = Sliding(**values)
        grip = math.cos(psi) + level.mu0 * math.sin(psi)
        weight = level.W * grip / math.cos(psi)
        return escape(AGEING, Sliding(**{**values, "psi": psi, "W": weight}))

    return float(brentq(rate, -1.1, -0.97, xtol=1e-6))


@cache
def turning_velocity() -> float:
    """Pulling speed above which amplitudes at the ageing law's Hopf point decay [m/s]."""

    def rate(v0: float) -> float:
        return growth(AGEING, at(1.0, v0=v0), 0.1, 12)

    return float(brentq(rate, 3e-4, 5e-4, xtol=1e-8))


def late_swing(law: str, sliding: Sliding, start: float, count: int, points: int = POINTS) -> float:
    """Amplitude of ln(v/v0) in the second half of `count` turns from a start."""
    turn = 2 * np.pi / abs(sliding.roots()[0].imag)
    run = motion(law, sliding, (count + 0.5) * turn, turn / points, **sliding.start(start))
    late = np.log(run.outputs["v"][len(run.time) // 2 :])
    return float(np.ptp(late) / 2)


@cache
def balanced(sliding: Sliding, low: float, high: float) -> float:
    """Amplitude of ln(v/v0) in a cycle of the ageing law, stable or not, between two starts."""
    start = float(brentq(lambda s: growth(AGEING, sliding, s, 10), low, high, xtol=1e-7))
    return late_swing(AGEING, sliding, start, 10, FINE)


def cycle_of(law: str, start: float, v0: float) -> tuple[float, float]:
    """Stiffness over the critical one at which a start gives a cycle, and amplitude of ln(v/v0)."""
    share = float(
        brentq(lambda r: growth(law, at(r, v0=v0), start), 0.8, 1.05, xtol=1e-4, rtol=1e-4)
    )
    return share, late_swing(law, at(share, v0=v0), start, 6)


def small_cycle(law: str, sliding: Sliding) -> float:
    """Amplitude of ln(v/v0) in the cycle just beyond the Hopf point, to leading order."""
    grows = sliding.roots()[0].real * sliding.L / sliding.v0
    bends = sliding.bends if law == AGEING else sliding.bends_slip
    turns_at = math.sqrt(sliding.b / sliding.a - 1)
    return 2 * math.sqrt(grows / (-bends * sliding.inertia * turns_at))
