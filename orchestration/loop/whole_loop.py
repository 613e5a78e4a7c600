"""The monolithic reference: plant and controller as one system of equations in one solver."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Matrix, Vector
from ...solver.errors import CouplingError
from ...solver.kernel import IntegrationError, Kernel, Model
from ...solver.signals import REFERENCES, set_point_orders
from ...solver.stored import stored_kernel
from ..fmu.compiled import FARTHEST
from ..fmu.limits import FIRST_STEP, check_memory
from ..master.march import LoopRun, Progress
from ..master.reference_signal import ROUND_OFF, TERMS, Reference
from ..master.sides import step_that_meets
from ..master.verdict import ACCURACY, Verdict
from .catalogue import NAMES, component, kept_as

if TYPE_CHECKING:
    from ...solver.component import Component
    from .loop import Loop


TIGHT, LOOSE = 1e-10, 1e-8
BETWEEN, MOST_POINTS = 1e-3, 1e6  # [s] between two points where outputs are known, and their number
STARTED = "t_step"  # the input with the time from which the terms count


def loop_kernel(plant: str | Component, controller: str | Component) -> Kernel:
    """The compiled closed loop of two parts, with set-points as polynomials of time."""
    return stored_loop("loop", lambda: whole_loop(plant, controller), (plant, controller))


def whole_loop(plant: str | Component, controller: str | Component) -> Component:
    """The closed loop of two parts as one component."""
    from ...solver.component import TIME, Input, symbol
    from ...solver.interconnect import connect

    loop = connect(component(plant), component(controller))
    since = TIME - symbol(STARTED)
    curves, terms = {}, []
    for i in (i for i in loop.inputs if i.role in REFERENCES):
        rest: Any = 0
        for power in reversed(range(1, TERMS)):
            name = term_name(i.name, power)
            terms.append(Input(name, f"{i.unit}/s^{power}", f"term {power} of {i.name}"))
            rest = since * (symbol(name) + rest)
        curves[symbol(i.name)] = symbol(i.name) + rest
    started = Input(STARTED, "s", "time that the terms count from", role="internal")
    return loop.substituted(curves, inputs=(*loop.inputs, *terms, started))


def stored_loop(
    kind: str, make: Callable[[], Component], parts: Sequence[str | Component], *made_by: str
) -> Kernel:
    """The compiled component of a loop, kept on disk under a kind; modules that `make` is in."""
    (p, of_plant), (c, of_controller) = map(kept_as, parts)
    return stored_kernel(f"{kind}_{p}_{c}", make, __name__, *made_by, *of_plant, *of_controller)


def term_name(name: str, power: int) -> str:
    """Name of an input's coefficient of this power of time."""
    return f"{name}_t{power}" if power else name


def inputs_between(
    kernel: Kernel, reference: Reference, grid: Vector
) -> tuple[Vector, Matrix, npt.NDArray[np.bool_]]:
    """Inputs of a loop from each time to the next; solver steps end where they change.

    Returns the times of the grid (m,) with the points of the set-point between them (k,), the
    kernel's inputs from each of them on (k, n), and whether each is one of the grid (k,).
    """
    orders = set_point_orders([i.name for i in kernel.inputs if i.role in REFERENCES])
    times, pieces = reference.between(grid, list(orders.values()))
    columns = {i.name: k for k, i in enumerate(kernel.inputs)}
    inputs = np.tile([i.start for i in kernel.inputs], (len(times), 1))
    for name, piece in zip(orders, pieces, strict=True):
        inputs[:, [columns[term_name(name, power)] for power in range(TERMS)]] = piece
    inputs[:, columns[STARTED]] = times
    return times, inputs, np.isin(times, grid)


def run_monolithic(loop: Loop, step: float | None = None, progress: Progress = None) -> LoopRun:
    """Run the closed loop without FMUs, its outputs on a grid of this step [s].

    The run is made twice, with a hundredfold difference in tolerance; the difference of the results
    bounds the error of the looser run and determines the verdict on the tighter one. Raises
    `CouplingError`, `BadParameter`, and `UserError` if the rows of all steps do not fit.
    """
    kernel = _checked_kernel(loop)
    stop, step = loop.stop, step or min(FIRST_STEP, loop.stop)
    apart = max(BETWEEN, stop / MOST_POINTS)
    columns = 5 * len(kernel.outputs) + 6  # two courses, times, what is drawn
    needed, what = 8.0 * columns * stop / min(step, apart), f"{stop / step:.3g} communication steps"
    check_memory(needed, f"{what} need", "use longer steps or a shorter motion")
    tight, wide = (Model(kernel, loop.values, tolerance) for tolerance in (TIGHT, LOOSE))
    step = step_that_meets(period := tight.sample_time, step)
    grid = np.minimum(np.arange(math.ceil(stop / step - ROUND_OFF) + 1) * step, stop)
    parts = math.ceil(step / apart - ROUND_OFF)
    finer = (grid[:-1, None] + step / parts * np.arange(parts)).ravel()
    finer = np.append(finer[finer < stop - ROUND_OFF * step], grid[-1])
    times, _ = loop.reference.between(finer, ())
    found, stopped = follow(tight, loop.reference, times, FARTHEST, progress)
    loose, broken = follow(wide, loop.reference, times, FARTHEST)
    time = times[: len(next(iter(found.values())))]
    rows = np.flatnonzero(np.isin(time, grid))
    steps = np.diff(time[rows])
    outputs = {n: y for n, y in found.items() if n != "u"}
    commands = {n: y for n, y in found.items() if n == "u"}
    goal = loop.reference.on(time, 0)
    run = LoopRun(
        *(time, outputs, commands, goal),
        residual_max=dict.fromkeys(commands, 0.0),
        effect_rate_max=dict.fromkeys(outputs, 0.0),
        macro_steps=len(rows) - 1,
        step_range=(float(steps.min(initial=step)), float(steps.max(initial=0.0))),
        verdict=_verdict(outputs, loose, stopped or broken),
        stopped=stopped,
        units={o.name: o.unit for o in kernel.outputs},
        sampling_period=period,
    )
    shown, given = ({n: y[rows] for n, y in of.items()} for of in (outputs, commands))
    fewer = replace(run, outputs=shown, commands=given, between=run)
    return replace(fewer, time=time[rows], reference=goal[rows])


def _checked_kernel(loop: Loop) -> Kernel:
    for part in (loop.plant, loop.controller):
        if not part.has_equations:
            expected = f"expected one of {', '.join(NAMES)}, and FILE.py:FUNCTION"
            raise CouplingError(f"without FMUs, the equations of {part} are needed; {expected}")
    if loop.coupling or loop.corrections or loop.mapping:
        raise CouplingError("a loop without FMUs has no coupling, corrections, ports; remove them")
    loop.check_values()
    return loop_kernel(loop.plant.name, loop.controller.name)


def follow(
    model: Model,
    reference: Reference,
    grid: Vector,
    farthest: float = math.inf,
    progress: Progress = None,
) -> tuple[dict[str, Vector], str]:
    """Run a loop of `loop_kernel` from the model's present state over a grid of rising times [s].

    Its samples are among them. Beyond `farthest` times an output's nominal value the loop diverges.
    Returns the outputs on the grid, as far as the run went, and why it ended early, if it did.
    """
    period, declared = model.sample_time, model.kernel.outputs
    limits = farthest * np.array([o.nominal for o in declared])
    times, at, on_grid = inputs_between(model.kernel, reference, grid)
    turns = times / period if period > 0 else np.full(len(times), 0.5)
    sampled = on_grid & (np.abs(turns - np.round(turns)) < ROUND_OFF)
    size = max(1, len(times) // 100) if math.isfinite(farthest) else len(times)
    pieces, stopped = [], ""
    for first in range(0, len(times), size):
        if progress:
            progress(float(times[first]))
        # each piece ends where the next begins, which samples there
        rows = np.arange(first, min(first + size + 1, len(times)))
        own = rows < first + size
        given = at[np.maximum(rows - 1, 0)], at[rows]
        try:
            run = model.simulate(times[rows], given, sampled[rows] & own)
        except IntegrationError as error:
            run, stopped = error.so_far, str(error)
        shown = (on_grid[rows] & own)[: len(run.time)]
        table = np.column_stack([values[shown] for values in run.outputs.values()])
        beyond = np.argwhere(~(np.abs(table) <= limits))
        if len(beyond):
            row, column = beyond[0]
            name, when = declared[column].name, run.time[shown][row]
            stopped = f"the loop diverges: {name} exceeds its bound at t = {when:.6g} s"
            table = table[: row + 1]
        pieces.append(table)
        if stopped:
            break
    courses = np.vstack(pieces).T
    return {o.name: course for o, course in zip(declared, courses, strict=True)}, stopped


def _verdict(tight: dict[str, Vector], loose: dict[str, Vector], stopped: str) -> Verdict:
    estimate, worst, share = {}, next(iter(tight)), 0.0
    for name, course in tight.items():
        rows = min(len(course), len(loose[name]))
        estimate[name] = float(np.max(np.abs(course[:rows] - loose[name][:rows])))
        part = estimate[name] / (float(np.ptp(course[:rows])) or 1.0)
        if not part <= share:
            worst, share = name, part
    if stopped:
        return Verdict(False, stopped, "check the parameters", estimate)
    text = (
        f"a hundred times the tolerance moves no output by more than {100 * share:.2g} % of its "
        f"range ({worst}: {estimate[worst]:.2g})"
    )
    trusted = share <= ACCURACY
    advice = "" if trusted else "the motion depends on round-off; shorten the run"
    return Verdict(trusted, text, advice, estimate)
