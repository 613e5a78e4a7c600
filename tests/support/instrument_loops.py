"""Loops with instruments: as one system of equations, and as an .ssp with an FMU for each part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ballscrew.fmus.system_export import export_system
from ballscrew.orchestration.loop.catalogue import component, fmu, name_of
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.plant.instruments.measured_through import measured_through
from ballscrew.solver.component import Component
from ballscrew.solver.kernel import Model

GOAL = 0.08
SIGNALS = ("x", "v", "i")


def exported(path: Path, controller: str | Component, instruments: Sequence[str]) -> Path:
    """An .ssp of our plant, a controller and instruments."""
    return export_system(
        fmu("plant"),
        fmu(controller),
        path,
        name=name_of(controller),
        instruments={name: fmu(name) for name in instruments},
    )


def exact_course(
    controller: str | Component,
    instruments: Sequence[Component],
    stop: float,
    values: Mapping[str, float] | None = None,
) -> np.ndarray:
    """`SIGNALS` at each sample of the complete loop in one solver; shape (samples, signals)."""
    whole = measured_through(component(controller), instruments)
    values = {"controller_" + n: v for n, v in (values or {}).items()}
    model = Model(loop_kernel("plant", whole), values, tolerance=1e-10)
    model.set_input("x_d", GOAL)
    period = model.sample_time
    rows = []
    for k in range(round(stop / period) + 1):
        model.sample(k * period)
        read = model.outputs(k * period, model.x)
        rows.append([read[name] for name in SIGNALS])
        model.advance(k * period, (k + 1) * period)
    return np.array(rows)


def apart(course: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Largest distance of each signal as a share of its range."""
    assert course.shape == exact.shape
    return np.abs(course - exact).max(axis=0) / np.ptp(exact, axis=0)
