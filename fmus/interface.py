"""FMI variables of an exported component, and their places in the FMU's memory.

All numbers of an FMU instance are in one array: its variables, its state, the solver's memory, so
that saving and restoring are copies. Value references count the variables from 1 in the order of
the model description, since some hosts expect this; `Layout.places` has the place of each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..solver.core import INFO_SIZE
from ..solver.kernel import DEFAULT_TOLERANCE, Kernel
from .tangent_ports import FRAME_ROLE, SET, SET_ROLE

TOLERANCE = "solver_tolerance"
MESSAGE = "message"
START = "_start"
TIME = "t"  # its name in equations


@dataclass(frozen=True)
class Variable:
    """One Real variable.

    Attributes
    ----------
    place : int
        Its place in the memory.
    reference : int
        Its value reference, which is its number in the model description; see `number_variables`.
    """

    name: str
    place: int
    causality: str
    variability: str
    unit: str
    description: str
    start: float | None = None
    minimum: float = -math.inf
    maximum: float = math.inf
    nominal: float = 1.0
    feedthrough: tuple[str, ...] = ()
    reference: int = 0


def number_variables(variables: Iterable[Variable], first: int) -> tuple[Variable, ...]:
    """The variables with value references from `first` on, in their order."""
    return tuple(replace(v, reference=first + k) for k, v in enumerate(variables))


@dataclass(frozen=True)
class Layout:
    """Offsets into the memory, and other data that the runtime needs besides the equations.

    Attributes
    ----------
    places : list of int
        Place of each value reference; `size`, which is not a place, for variables that are not
        numbers.
    names : dict of str to int
        Place of each variable.
    """

    model: str
    inputs: int
    discrete: int
    delays: int
    modes: int
    held: int
    parameters: int
    states: int
    outputs: int
    starts: int
    tolerance: int
    info: int
    time: int
    samples: int
    step_start: int
    sample_time: int
    frame: dict[str, int]
    size: int
    initial: list[float]
    nominal: list[float]
    places: list[int]
    names: dict[str, int]
    units: dict[str, str]
    ranges: dict[str, list[float | None]]

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class Interface:
    """The Real variables; the value reference of the String ``message`` follows after them."""

    variables: tuple[Variable, ...]
    layout: Layout
    message_reference: int


def interface_of(kernel: Kernel, model: str) -> Interface:
    """The FMI variables of a component and their places."""
    late = 2 * len(kernel.delays)  # delayed signals and their rates
    held = len(kernel.inputs) + len(kernel.discrete) + late + bool(kernel.modes)
    n, parameters = len(kernel.states), held
    states = parameters + len(kernel.parameters)
    outputs = states + n
    starts = outputs + len(kernel.outputs)
    tolerance = starts + n + len(kernel.discrete)
    info = tolerance + 1
    time = info + INFO_SIZE
    samples = time + 1
    frame = _frame(kernel, states, samples + 1)
    size = samples + 1 + bool(frame)
    step_start = max((k for k, i in enumerate(kernel.inputs) if i.role == "internal"), default=-1)

    variables = [
        *_inputs(kernel),
        *_outputs(kernel, outputs),
        *_parameters(kernel, parameters),
        *_starts(kernel, starts),
    ]
    if n or late:
        variables.append(_tolerance(tolerance))
    initial = [0.0] * size
    for v in variables:
        initial[v.place] = v.start or 0.0
    initial[tolerance] = DEFAULT_TOLERANCE
    listed = number_variables(variables, 1)
    layout = Layout(
        model=model,
        inputs=len(kernel.inputs),
        discrete=len(kernel.discrete),
        delays=len(kernel.delays),
        modes=len(kernel.modes),
        held=held,
        parameters=parameters,
        states=states,
        outputs=outputs,
        starts=starts,
        tolerance=tolerance,
        info=info,
        time=time,
        samples=samples,
        step_start=step_start,
        sample_time=next(
            (
                parameters + k
                for k, p in enumerate(kernel.parameters)
                if p.name == kernel.sample_time
            ),
            -1,
        ),
        frame=frame,
        size=size,
        initial=initial,
        nominal=[s.nominal for s in kernel.states],
        places=[size, *(v.place for v in listed), size],
        names={v.name: v.place for v in variables},
        units={v.name: v.unit for v in variables},
        ranges={
            v.name: [
                v.minimum if math.isfinite(v.minimum) else None,
                v.maximum if math.isfinite(v.maximum) else None,
            ]
            for v in variables
            if v.causality == "parameter"
        },
    )
    return Interface(listed, layout, len(listed) + 1)


def _inputs(kernel: Kernel) -> Iterator[Variable]:
    for k, i in enumerate(kernel.inputs):
        if i.role != "internal":
            yield Variable(
                i.name,
                k,
                "input",
                "continuous",
                i.unit,
                i.meaning,
                start=i.start,
                nominal=i.nominal,
            )


def _outputs(kernel: Kernel, first: int) -> Iterator[Variable]:
    internal = {i.name for i in kernel.inputs if i.role == "internal"}
    delayed = {d.name for d in kernel.delays} | {f"{d.name}_rate_" for d in kernel.delays}
    # what changes between events
    moving = {s.name for s in kernel.states} | {i.name for i in kernel.inputs} | delayed | {TIME}
    for k, o in enumerate(kernel.outputs):
        discrete = bool(kernel.sample_time) and moving.isdisjoint(o.uses)
        yield Variable(
            o.name,
            first + k,
            "output",
            "discrete" if discrete else "continuous",
            o.unit,
            o.meaning,
            nominal=o.nominal,
            feedthrough=tuple(n for n in o.feedthrough if n not in internal),
        )


def _parameters(kernel: Kernel, first: int) -> Iterator[Variable]:
    for k, p in enumerate(kernel.parameters):
        yield Variable(
            p.name,
            first + k,
            "parameter",
            "fixed",
            p.unit,
            f"{p.meaning} ({p.source})",
            start=p.default,
            minimum=p.minimum,
            maximum=p.maximum,
            nominal=p.nominal,
        )


def _starts(kernel: Kernel, first: int) -> Iterator[Variable]:
    # the nominal value of a state scales the solver's absolute tolerance; a start value has that of
    # its signal
    shown = {o.uses[0]: o.nominal for o in kernel.outputs if len(o.uses) == 1}
    for k, s in enumerate((*kernel.states, *kernel.discrete)):
        yield Variable(
            s.name + START,
            first + k,
            "parameter",
            "fixed",
            s.unit,
            f"initial {s.meaning}",
            start=s.start,
            nominal=shown.get(s.name, s.nominal),
        )


def _tolerance(place: int) -> Variable:
    return Variable(
        TOLERANCE,
        place,
        "parameter",
        "fixed",
        "1",
        "relative tolerance of the internal solver",
        start=DEFAULT_TOLERANCE,
        minimum=1e-13,
        maximum=1e-2,
        nominal=DEFAULT_TOLERANCE,
    )


def _frame(kernel: Kernel, states: int, free: int) -> dict[str, int]:
    """States that are set from inputs at a new value of the input `ask` (last value in `seen`)."""
    asks = [k for k, i in enumerate(kernel.inputs) if i.role == FRAME_ROLE]
    if not asks:
        return {}
    given = [k for k, i in enumerate(kernel.inputs) if i.role == SET_ROLE]
    names = [s.name for s in kernel.states]
    first = names.index(kernel.inputs[given[0]].name.removesuffix(SET))
    return {
        "ask": asks[0],
        "seen": free,
        "from": given[0],
        "to": states + first,
        "count": len(given),
    }
