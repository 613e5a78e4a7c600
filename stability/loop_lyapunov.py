"""Lyapunov exponents of a closed loop of two parts: over the solver, or over their FMUs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..fmus.catalogue import name_of
from ..orchestration.whole_loop import held_loop_kernel, loop_kernel
from ..solver.delay_states import NODES
from ..solver.kernel import CONTROLLER, PLANT, Kernel, Model
from ..solver.spectrum import Spectrum
from ..solver.tape import UnsupportedComponent

if TYPE_CHECKING:
    from ..solver.component import Component
from .lyapunov import FIRST, LAST, SAMPLES, TOLERANCE, LyapunovRun, Maker, NoExponents, lyapunov


def loop_maker(
    plant: str | Component,
    controller: str | Component,
    setpoint: float,
    plant_values: Mapping[str, float] | None = None,
    controller_values: Mapping[str, float] | None = None,
    averaged: bool = False,
) -> Maker:
    """A `Maker` of the closed loop of two parts, around a constant set-point [m].

    Of `averaged` ones quantizers are replaced by their mean over all places of their steps.

    Raises
    ------
    KeyError
        For a parameter that does not exist.
    """
    kernel = held_loop_kernel(plant, controller, averaged)
    values = {PLANT + k: v for k, v in (plant_values or {}).items()}
    values |= {CONTROLLER + k: v for k, v in (controller_values or {}).items()}

    def make(tolerance: float) -> Model:
        model = Model(kernel, values, tolerance)
        for name in [i.name for i in kernel.inputs if i.role == "reference"]:
            model.set_input(name, setpoint)
        return model

    return make


def loop_order(kernel: Kernel) -> list[int]:
    """The thesis' order of states: x, v, the friction law's, the current, the controller's."""
    names = [s.name for s in kernel.states]

    def place(k: int) -> tuple[int, int]:
        name = names[k]
        if name.startswith(CONTROLLER):
            return 3, k
        own = name.removeprefix(PLANT)
        if own in FIRST:
            return 0, FIRST.index(own)
        return (2 if own in LAST else 1), k

    return sorted(range(len(names)), key=place)


def loop_lyapunov(
    controller: str | Component,
    stop: float,
    setpoint: float = 0.08,
    plant: str | Component = "plant",
    plant_values: Mapping[str, float] | None = None,
    controller_values: Mapping[str, float] | None = None,
    tolerance: float = TOLERANCE,
    progress: Callable[[str], None] | None = None,
) -> LyapunovRun:
    """Exponents of a closed loop of two parts; parameters as in `run_loop`.

    Raises
    ------
    NoExponents, KeyError, ValueError
    """
    try:
        kernel = held_loop_kernel(plant, controller)
    except UnsupportedComponent as error:
        raise NoExponents(str(error)) from error
    kernel.compile()  # two tolerances, and the motion beyond, are worth half a second
    given = plant, controller, setpoint, plant_values, controller_values
    make = loop_maker(*given)
    average = loop_maker(*given, averaged=True) if kernel.quantized else None
    order = loop_order(kernel)
    label = f"{name_of(controller)} on {name_of(plant)}"
    run = lyapunov(
        make, stop, tolerance, order=order, label=label, progress=progress, average=average
    )
    if loop_kernel(plant, controller).delays:
        text = f"{run.method}; {NODES} nodes along each delay, whose own exponents come last"
        return replace(run, method=text)
    return run


def loop_lyapunov_over_fmus(
    controller: str,
    stop: float,
    step: float,
    setpoint: float = 0.08,
    plant: str = "plant",
    plant_values: Mapping[str, float] | None = None,
    controller_values: Mapping[str, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> LyapunovRun:
    """Exponents of a closed loop from its variational FMUs, and their master.

    The errors of the exponents are their distances to those of one solver. The verdict is that of
    the equations, too: it follows the motion far beyond `stop`.

    Parameters
    ----------
    step : float
        Communication step [s].

    Raises
    ------
    NoExponents
        If the loop cannot be followed so.
    """
    from ..fmus.catalogue import variational_fmu
    from ..orchestration.fmu_instance import FmuInstance
    from .fmu_with_tangents import TangentsImpossible
    from .tangents_over_fmus import follow_over_fmus

    if held_loop_kernel(plant, controller).sample_time:
        raise NoExponents(
            f"{name_of(controller)} is sampled, and no FMU has tangents of a sampled part; "
            "use the equations, --via model"
        )
    given = (setpoint, plant, plant_values, controller_values)
    known = loop_lyapunov(controller, stop, *given, progress=progress)
    if progress:
        progress(f"the FMUs over {stop:g} s")
    count = len(known.names)
    try:
        ours = FmuInstance(variational_fmu(plant, count), "plant")
        theirs = FmuInstance(variational_fmu(controller, count), "controller")
        try:
            run = follow_over_fmus(
                ours,
                theirs,
                setpoint,
                stop,
                step,
                plant_values=plant_values,
                controller_values=controller_values,
            )
        finally:
            ours.close()
            theirs.close()
    except (TangentsImpossible, UnsupportedComponent) as error:
        raise NoExponents(str(error)) from error
    keep = np.unique(np.linspace(0, len(run.time) - 1, SAMPLES + 1).astype(int))
    spectrum = Spectrum(
        run.time[keep],
        np.full((len(keep), count), np.nan),
        run.growth[keep],
        run.trace[keep],
        np.eye(count),
        0,
        run.stopped,
        False,
    )
    method = f"variational FMUs, {run.method}; {run.accuracy}"
    return LyapunovRun(
        known.names, spectrum, known.spectrum, known.motion, known.tolerance, known.label, method
    )
