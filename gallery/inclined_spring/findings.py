"""Steady sliding over an inclined spring in closed form, its stability limit, and motions beyond.

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

from ..drawing import COLOURS, DASHES, drawing, part
from ..finding import Finding, exponents
from ..finding import motion as run_of

AGEING, SLIP = part(__file__, "ageing"), part(__file__, "slip")
LAWS = {AGEING: "ageing", SLIP: "slip"}
HURWITZ = "closed form, by Hurwitz' condition on the linear part"
CUBIC = "root of the linear part's cubic"
RADAU = "SciPy's Radau gives the same to"
TILTED = {"psi": -0.5, "alpha": 0.3}
LINKER = "Dieterich and Linker (1992), abstract: -arccot of the friction coefficient"
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


def motion(law: str, sliding: Sliding, stop: float, step: float, **start: float) -> Any:
    return run_of(law, stop, step, {**vars(sliding), **start})


def verdict(law: str, sliding: Sliding, stop: float, swing: float = 0.01) -> Any:
    return exponents(law, stop, {**vars(sliding), "u_start": swing}).motion


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


def small_cycle(law: str, sliding: Sliding) -> float:
    """Amplitude of ln(v/v0) in the cycle just beyond the Hopf point, to leading order."""
    grows = sliding.roots()[0].real * sliding.L / sliding.v0
    bends = sliding.bends if law == AGEING else sliding.bends_slip
    turns_at = math.sqrt(sliding.b / sliding.a - 1)
    return 2 * math.sqrt(grows / (-bends * sliding.inertia * turns_at))


def findings() -> list[Finding]:
    return [*_of_the_threshold(), *_of_the_linear_part(), *_of_the_bifurcation(), *_of_cycles()]


def _of_the_threshold() -> list[Finding]:
    cases: tuple[tuple[str, dict[str, float], str], ...] = (
        (AGEING, {}, "level spring"),
        (AGEING, {"psi": 0.5}, "psi = 0.5"),
        (SLIP, TILTED, "psi = -0.5, alpha = 0.3"),
    )
    rows = []
    for law, values, text in cases:
        ours, theirs = critical(law, **values)[0], Sliding(**values).critical
        what = f"{LAWS[law]}, {text}: oscillations decay above this stiffness"
        rows.append(Finding(what, ours, "N/m", HURWITZ, theirs, 1e-3))
    level, period = Sliding(), critical(AGEING, psi=0.5, m=0.1)[1]
    formula = "2 pi L/(v0 sqrt(b/a - 1)) for alpha = 0, for any mass, angle and weight"
    theirs = 2 * math.pi * level.L / (level.v0 * math.sqrt(level.b / level.a - 1))
    below, angle = "b = 0.005 < a: below this angle the mass jams or diverges", jams(b=0.005)
    return [
        *rows,
        Finding("ageing, psi = 0.5, m = 0.1 kg: period there", period, "s", formula, theirs, 2e-6),
        Finding(below, angle, "rad", LINKER, -math.atan(1 / level.mu0), 1e-5),
    ]


def _of_the_linear_part() -> list[Finding]:
    found = []
    for psi in (0.3, -0.3):
        sliding = Sliding(k=15000.0, psi=psi)
        root = float(sliding.roots()[0].real)
        what = f"ageing, k = 15 kN/m, psi = {psi:g}: rate at which swings grow [nats/s]"
        found.append(Finding(what, growth(AGEING, sliding), "1/s", CUBIC, root, 1e-4 * abs(root)))
    tilted, hanging = at(1.5, **TILTED), Sliding(psi=-1.2, W=-10.0)
    fast, leaves = float(tilted.roots()[-1].real), float(hanging.roots()[0].real)
    limit, rate = float(verdict(SLIP, tilted, 5.0).limit[-1]), escape(AGEING, hanging)
    above = "slip, psi = -0.5, alpha = 0.3, 1.5 times that stiffness: fastest exponent [nats/s]"
    away = "ageing, W = -10 N, psi = -1.2: rate at which it leaves steady sliding [nats/s]"
    return [
        *found,
        Finding(above, limit, "1/s", CUBIC, fast, 1e-6 * abs(fast)),
        Finding(away, rate, "1/s", CUBIC, leaves, 1e-3 * leaves),
    ]


def _of_the_bifurcation() -> list[Finding]:
    level = Sliding()
    ratio = level.b / level.a
    heavy = (2 * math.sqrt(3 + ratio) - 3) / (3 + 4 * ratio)
    fastest = math.sqrt(heavy * level.a * level.normal * level.L / level.m)
    source = (
        "m v0^2/(a N L) = (2 sqrt(3 + r) - 3)/(3 + 4 r), r = b/a: first Lyapunov coefficient, "
        "without terms in the amplitude"
    )
    what = "ageing: above this pull the Hopf bifurcation is supercritical"
    found = [Finding(what, turning_velocity(), "m/s", source, fastest, 1e-6)]
    near, source = at(0.99, v0=1e-3), "normal form of the Hopf bifurcation, to leading order"
    for law, name in LAWS.items():
        swing, ours = small_cycle(law, near), verdict(law, near, 6.0).amplitude["plant_u"]
        what = f"{name}, v0 = 1 mm/s, 0.99 times the critical stiffness: swing of ln(v/v0)"
        found.append(Finding(what, ours, "1", source, swing, 0.01 * swing))
    both = at(1.003, v0=2e-4)
    stable, unstable = balanced(both, 1.2, 2.0), balanced(both, 0.4, 1.0)
    what = "ageing, v0 = 0.2 mm/s, 1.003 times the critical stiffness: swing of the"
    start, from_ = "SciPy's Radau {} from a start 4 % below", "{} from one 4 % above"
    inside = f"{start.format('grows')} and {from_.format('fades')}"
    outside = f"{start.format('fades')} and {from_.format('grows')}"
    return [
        *found,
        Finding(f"{what} cycle", stable, "1", inside),
        Finding(f"{what} unstable cycle", unstable, "1", outside),
    ]


def _of_cycles() -> list[Finding]:
    found = []
    soft = Sliding(k=2000.0)
    for law, name in LAWS.items():
        cycle = verdict(law, soft, 10.0)
        drop = 2 * soft.k * cycle.amplitude["plant_x"]
        what = f"{name}, k = 2 kN/m: "
        found += [
            Finding(f"{what}period of stick-slip", cycle.period or 0.0, "s", f"{RADAU} 1e-6"),
            Finding(f"{what}fall of the spring's force", drop, "N", f"{RADAU} 1e-4"),
        ]
    return found


def picture() -> Any:
    with drawing(2) as (figure, (angles, course)):
        _draw_angles(angles)
        _draw_course(course)
    return figure


def _draw_angles(axes: Any) -> None:
    angle = np.linspace(-0.75, 1.2, 120)
    for n, alpha in enumerate((0.0, 0.3)):
        curve = [Sliding(psi=p, alpha=alpha).critical for p in angle]
        style = {"color": COLOURS[n], "ls": DASHES[n]}
        axes.semilogy(angle, curve, label=f"closed form, alpha = {alpha:g}", **style)
        found = [critical(AGEING, psi=p, alpha=alpha)[0] for p in (-0.5, 0.0, 0.5, 1.0)]
        axes.plot((-0.5, 0.0, 0.5, 1.0), found, "o", color=COLOURS[n], ms=5)
    axes.plot([], [], "o", color="#555555", ms=5, label="from runs")
    axes.text(0.15, 1.5e4, "steady sliding\nis stable", fontsize=9)
    axes.text(-0.7, 5.2e3, "stick-slip", fontsize=9)
    axes.set(xlabel="angle of the spring [rad]", ylabel="stiffness [N/m]", ylim=(4e3, 1e5))
    axes.set_xticks((-0.5, 0.0, 0.5, 1.0))
    axes.set_title("A spring that lifts helps")
    axes.legend(fontsize=9)


def _draw_course(axes: Any) -> None:
    for n, (law, name) in enumerate(LAWS.items()):
        run = motion(law, Sliding(k=2000.0), 6.0, 1e-3)
        late = run.time >= 3.0
        style = {"color": COLOURS[n], "ls": DASHES[n]}
        axes.semilogy(run.time[late] - 3.0, 1e3 * run.outputs["v"][late], label=name, **style)
    axes.axhline(0.5, color="#777777", lw=1.0, ls=":")
    axes.text(0.65, 0.62, "the pull", color="#555555", fontsize=9)
    axes.set(xlabel="time [s]", ylabel="velocity [mm/s]", ylim=(1e-4, 2e2))
    axes.set_title("The ageing law slips harder")
    axes.legend(fontsize=9)
