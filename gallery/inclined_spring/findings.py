"""Stability limit of steady sliding over an inclined spring, and the motion beyond it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..drawing import COLOURS, DASHES, drawing
from ..finding import Finding
from .motions import (
    AGEING,
    SLIP,
    Sliding,
    at,
    balanced,
    critical,
    cycle_of,
    escape,
    growth,
    jams,
    motion,
    small_cycle,
    turning_velocity,
    verdict,
)

LAWS = {AGEING: "ageing", SLIP: "slip"}
HURWITZ = "closed form, by Hurwitz' condition on the linear part"
CUBIC = "root of the linear part's cubic"
RADAU = "SciPy's Radau gives the same to"
TILTED = {"psi": -0.5, "alpha": 0.3}
LINKER = "Dieterich and Linker (1992), abstract: -arccot of the friction coefficient"


def findings() -> list[Finding]:
    return [*_of_the_threshold(), *_of_the_linear_part(), *_of_the_bifurcation(), *_of_cycles()]


def _of_the_threshold() -> list[Finding]:
    cases: tuple[tuple[str, dict[str, float], str], ...] = (
        (AGEING, {}, "level spring"),
        (AGEING, {"psi": 0.5}, "psi = 0.5"),
        (SLIP, TILTED, "psi = -0.5, alpha = 0.3"),
    )
    stiffness = [
        Finding(
            f"{LAWS[law]}, {text}: oscillations decay above this stiffness",
            critical(law, **values)[0],
            "N/m",
            HURWITZ,
            Sliding(**values).critical,
            1e-3,
        )
        for law, values, text in cases
    ]
    level = Sliding()
    return [
        *stiffness,
        Finding(
            "ageing, psi = 0.5, m = 0.1 kg: period there",
            critical(AGEING, psi=0.5, m=0.1)[1],
            "s",
            "2 pi L/(v0 sqrt(b/a - 1)) for alpha = 0, for any mass, angle and weight",
            2 * math.pi * level.L / (level.v0 * math.sqrt(level.b / level.a - 1)),
            2e-6,
        ),
        Finding(
            "b = 0.005 < a: below this angle the mass jams or diverges",
            jams(b=0.005),
            "rad",
            LINKER,
            -math.atan(1 / level.mu0),
            1e-5,
        ),
    ]


def _of_the_linear_part() -> list[Finding]:
    found = []
    for psi in (0.3, -0.3):
        sliding = Sliding(k=15000.0, psi=psi)
        root = float(sliding.roots()[0].real)
        what = f"ageing, k = 15 kN/m, psi = {psi:g}: rate at which swings grow [nats/s]"
        found.append(Finding(what, growth(AGEING, sliding), "1/s", CUBIC, root, 1e-4 * abs(root)))
    hanging = Sliding(psi=-1.2, W=-10.0)
    leaves = float(hanging.roots()[0].real)
    rest = verdict(SLIP, at(1.5, **TILTED), 5.0)
    fast = float(at(1.5, **TILTED).roots()[-1].real)
    return [
        *found,
        Finding(
            "slip, psi = -0.5, alpha = 0.3, 1.5 times that stiffness: fastest exponent [nats/s]",
            float(rest.limit[-1]),
            "1/s",
            CUBIC,
            fast,
            1e-6 * abs(fast),
        ),
        Finding(
            "ageing, W = -10 N, psi = -1.2: rate at which it leaves steady sliding [nats/s]",
            escape(AGEING, hanging),
            "1/s",
            CUBIC,
            leaves,
            1e-3 * leaves,
        ),
    ]


def _of_the_bifurcation() -> list[Finding]:
    level = Sliding()
    ratio = level.b / level.a
    heavy = (2 * math.sqrt(3 + ratio) - 3) / (3 + 4 * ratio)
    found = [
        Finding(
            "ageing: above this pull the Hopf bifurcation is supercritical",
            turning_velocity(),
            "m/s",
            "m v0^2/(a N L) = (2 sqrt(3 + r) - 3)/(3 + 4 r), r = b/a: first Lyapunov coefficient, "
            "without terms in the amplitude",
            math.sqrt(heavy * level.a * level.normal * level.L / level.m),
            1e-6,
        )
    ]
    near = at(0.99, v0=1e-3)
    for law, name in LAWS.items():
        swing = small_cycle(law, near)
        found.append(
            Finding(
                f"{name}, v0 = 1 mm/s, 0.99 times the critical stiffness: swing of ln(v/v0)",
                verdict(law, near, 6.0).amplitude["plant_u"],
                "1",
                "normal form of the Hopf bifurcation, to leading order",
                swing,
                0.01 * swing,
            )
        )
    both = at(1.003, v0=2e-4)
    what = "ageing, v0 = 0.2 mm/s, 1.003 times the critical stiffness"
    below, above = "SciPy's Radau {} from a start 4 % below", "{} from one 4 % above"
    return [
        *found,
        Finding(
            f"{what}: swing of the cycle",
            balanced(both, 1.2, 2.0),
            "1",
            f"{below.format('grows')} and {above.format('fades')}",
        ),
        Finding(
            f"{what}: swing of the unstable cycle",
            balanced(both, 0.4, 1.0),
            "1",
            f"{below.format('fades')} and {above.format('grows')}",
        ),
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
    with drawing(2, 2) as (figure, (angles, swings, plane, course)):
        _draw_angles(angles)
        _draw_swings(swings)
        _draw_plane(plane)
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


def _draw_swings(axes: Any) -> None:
    cases = (
        (AGEING, 2e-4, (0.3, 0.7, 1.1, 1.4, 1.7, 2.0)),
        (AGEING, 1e-3, (0.15, 0.3, 0.45)),
        (SLIP, 2e-4, (0.3, 0.6, 0.9, 1.2)),
    )
    for n, (law, v0, starts) in enumerate(cases):
        share, swing = np.array([cycle_of(law, start, v0) for start in starts]).T
        label = f"{LAWS[law]}, {1e3 * v0:g} mm/s"
        style = {"color": COLOURS[n], "ls": DASHES[n], "ms": 4}
        axes.plot([1.0, *share], [0.0, *swing], marker="o", label=label, **style)
    axes.axvline(1.0, color="#777777", lw=1.0, ls=":")
    axes.set(xlabel="stiffness / critical stiffness", ylabel="swing of ln(v/v0)")
    axes.set(xlim=(0.95, 1.008), ylim=(0.0, 3.2), title="Slow and ageing: two answers above 1")
    axes.legend(fontsize=9)


def _draw_plane(axes: Any) -> None:
    for n, (share, begin) in enumerate(((0.8, 4.0), (1.1, 0.0))):
        run = motion(AGEING, at(share), begin + 1.0, 5e-4, u_start=1.0)
        late = run.time >= begin
        speed, force = 1e3 * run.outputs["v"][late], run.outputs["F"][late]
        style = {"color": COLOURS[n], "ls": DASHES[n], "lw": 1.4}
        axes.semilogx(speed, force, label=f"k = {share:g} times critical", **style)
    axes.axvline(0.5, color="#777777", lw=1.0, ls=":")
    axes.text(0.53, 6.22, "the pull", color="#555555", fontsize=9)
    axes.set(xlabel="velocity [mm/s]", ylabel="force of the spring [N]", ylim=(5.7, 6.45))
    axes.set_title("A swing fades, or becomes stick-slip")
    axes.legend(fontsize=9, loc="upper left")


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
