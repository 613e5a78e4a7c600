"""Lyapunov exponents of a closed loop of two parts, over the solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from ..controllers import ALONE
from ..fmus.catalogue import name_of
from ..orchestration.whole_loop import held_loop_kernel, loop_kernel
from ..solver.delay_states import NODES
from ..solver.kernel import CONTROLLER, PLANT, Kernel, Model
from ..solver.tape import UnsupportedComponent

if TYPE_CHECKING:
    from ..solver.component import Component
from .lyapunov import (
    FIRST,
    LAST,
    TOLERANCE,
    LyapunovRun,
    Maker,
    NoExponents,
    Watching,
    lyapunov,
)


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
    watching: Watching | None = None,
) -> LyapunovRun:
    """Exponents of a closed loop of two parts; parameters as in `run_loop` and `lyapunov`.

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
    alone = isinstance(controller, str) and controller in ALONE
    label = name_of(plant) if alone else f"{name_of(controller)} on {name_of(plant)}"
    run = lyapunov(make, stop, tolerance, None, order, label, watching, average)
    if loop_kernel(plant, controller).delays:
        text = f"{run.method}; {NODES} nodes along each delay, whose own exponents come last"
        return replace(run, method=text)
    return run
