"""Lyapunov exponents of a closed loop of two parts, over the solver."""

from __future__ import annotations

from dataclasses import replace

from ..orchestration.fmu.limits import TOLERANCE
from ..orchestration.loop.loop import Loop
from ..orchestration.loop.whole_loop import held_loop_kernel, loop_kernel, model_of
from ..solver.delay_states import NODES
from ..solver.kernel import CONTROLLER, PLANT, Kernel
from .lyapunov import FIRST, LAST, LyapunovRun, Maker, Watching, lyapunov


def loop_maker(loop: Loop, averaged: bool = False) -> Maker:
    """A `Maker` of a closed loop around its constant set-point.

    With `averaged`, quantizers are replaced by their mean over all positions of their steps.

    Raises
    ------
    KeyError
        For a parameter that does not exist.
    """
    kernel = held_loop_kernel(loop.plant.name, loop.controller.name, averaged)
    return lambda tolerance: model_of(kernel, loop, tolerance)


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
    loop: Loop, tolerance: float = TOLERANCE, watching: Watching | None = None
) -> LyapunovRun:
    """Exponents of a closed loop; `tolerance` and `watching` as in `lyapunov`.

    Raises
    ------
    UserError, KeyError, ValueError
    """
    parts = loop.plant.name, loop.controller.name
    kernel = held_loop_kernel(*parts)
    kernel.compile()  # takes half a second, less than two tolerances and the long-term motion
    make = loop_maker(loop)
    average = loop_maker(loop, averaged=True) if kernel.quantized else None
    order = loop_order(kernel)
    run = lyapunov(make, loop.stop, tolerance, None, order, loop.title, watching, average)
    if loop_kernel(*parts).delays:
        text = f"{run.method}; {NODES} nodes along each delay, whose own exponents are last"
        run = replace(run, method=text)
    return replace(run, loop=loop)
