"""Random courses of components with modes, in model exchange and in co-simulation.

A course has held commands that jump at communication points, a tolerance, and round-off added to
the states. The reference is the effect of the same tolerance, steps and round-off on co-simulation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from exchange_host import FIRST_STEP, ROUND_OFF, ExchangeHost

from ballscrew.fmus.feedback_law import with_law_ports
from ballscrew.fmus.native.export import write_native
from ballscrew.fmus.native.sources import native_model
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.solver import core
from ballscrew.solver.component import Component
from ballscrew.solver.kernel import Kernel, Model

TIGHT = 1e-12  # tolerance of the reference
DRAWS = 5  # perturbed courses of co-simulation
TIMES = 10.0
TOLERANCES = 1e-9, 1e-6
WIDE_TOLERANCES = 1e-6, 1e-1


@dataclass(frozen=True)
class Case:
    """One course: communication points [s], and the command after each."""

    seed: int
    tolerance: float
    times: np.ndarray
    commands: np.ndarray


@dataclass(frozen=True)
class Outcome:
    """Comparison of a course in model exchange."""

    case: Case
    distance: float  # largest difference of the position from the reference [m]
    allowed: float  # ten times that of perturbed co-simulation [m]
    held: float  # largest friction while stuck, as a share of the static one times `BREAK_AWAY` [N]
    zeros: int  # starts of continuous time with an event indicator of exactly zero
    events: int
    travel: float  # of the reference [m]


def case(seed: int, volts: float, tolerances: tuple[float, float]) -> Case:
    """A sine, held over communication steps; `volts` break away, `tolerances` are the limits."""
    random = np.random.default_rng(seed)
    low, high = np.log10(tolerances)
    steps = int(random.integers(10, 25))
    widths = random.uniform(0.5, 1.5, steps) * 10 ** random.uniform(-3, -2)
    times = np.concatenate([[0.0], np.cumsum(widths)])
    amplitude = volts * 10 ** random.uniform(-0.1, 1.3)
    phase = 2 * np.pi * random.uniform(0.5, 3.0) * times / times[-1]
    return Case(seed, float(10 ** random.uniform(low, high)), times, amplitude * np.sin(phase))


def co_simulated(kernel: Kernel, one: Case, tolerance: float, noise: Any = None) -> np.ndarray:
    """The positions at the communication points; `noise` draws round-off and first steps."""
    model = Model(kernel, tolerance=tolerance)
    nominal = np.array([s.nominal for s in kernel.states])
    place = [s.name for s in kernel.states].index("x")
    rows = [model.x[place]]
    for t0, t1, u in zip(one.times, one.times[1:], one.commands, strict=False):
        model.set_input("u", u)
        if noise is not None:
            model.info[core.NEXT_STEP] = FIRST_STEP * 10 ** noise.uniform(0, 2)
        model.advance(t0, t1)
        if noise is not None:
            size = ROUND_OFF * (nominal + abs(model.x))
            model.x += size * noise.normal(size=len(size))
        rows.append(model.x[place])
    return np.array(rows)


def outcome(kernel: Kernel, path: Path, one: Case) -> Outcome:
    """Run one course in both kinds of simulation."""
    reference = co_simulated(kernel, one, TIGHT)
    random = np.random.default_rng(one.seed)
    theirs = [co_simulated(kernel, one, one.tolerance, random) for _ in range(DRAWS)]
    host = ExchangeHost(path, {}, one.tolerance, random)
    rows, held, zeros = [host.get("x")[0]], 0.0, int((host.z == 0.0).sum())
    own = {p.name: p.default for p in kernel.parameters}
    for t1, u in zip(one.times[1:], one.commands, strict=False):
        host.jump({"u": u})
        host.advance(t1)
        zeros += int((host.z == 0.0).sum())
        x, friction, stuck = host.get("x", "friction", "stuck")
        rows.append(x)
        most = own.get("Fs") or own["Fs_pos" if friction > 0 else "Fs_neg"]
        held = max(held, abs(friction) * stuck / most * BREAK_AWAY)
    host.close()
    return Outcome(
        one,
        float(abs(np.array(rows) - reference).max()),
        TIMES * max(float(abs(course - reference).max()) for course in theirs),
        held,
        zeros,
        host.events,
        float(np.ptp(reference)),
    )


@dataclass(frozen=True)
class Subject:
    """A component with modes and outputs `x`, `friction`, `stuck`; `volts` break it away."""

    make: Callable[[], Component]
    volts: float

    def made(self, fmi: int, folder: Path) -> tuple[Kernel, Path]:
        model = native_model(with_law_ports(self.make()))
        return model.kernel, write_native(model, folder / f"exchange{fmi}.fmu", fmi).path


BREAK_AWAY = 2.35  # N
COMPONENTS = {
    f"{kind}_{law}": Subject(partial(component, f"{kind}_{law}"), command)
    for law in ("classical", "directional_classical")
    for kind, command in (("plant", 0.214), ("drive", BREAK_AWAY), ("rotary_drive", BREAK_AWAY))
}


def cases(name: str, fmi: int, count: int) -> list[Case]:
    """The first courses of a component; every fourth has a much too large tolerance."""
    first = 10_000 * list(COMPONENTS).index(name) + 1000 * fmi
    return [
        case(first + k, COMPONENTS[name].volts, WIDE_TOLERANCES if k % 4 == 3 else TOLERANCES)
        for k in range(count)
    ]


def complaint(one: Outcome) -> str:
    """Errors of a course; empty if there are none."""
    said = f"seed {one.case.seed}, tolerance {one.case.tolerance:.1e}: "
    if one.held > BREAK_AWAY * (1 + 1e-9):
        return f"{said}stuck at {one.held:.9g} N"
    if one.zeros:
        return f"{said}{one.zeros} event indicators of zero"
    if one.case.tolerance <= TOLERANCES[1] and not one.distance <= one.allowed:
        return f"{said}{one.distance:.2e} m away, allowed {one.allowed:.2e} m"
    return ""
