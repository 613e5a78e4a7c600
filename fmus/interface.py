"""FMI variables of an exported component, and their places in the FMU's memory.

All numbers of an FMU instance are in one array: its variables, its state, the solver's memory, so
that saving and restoring are copies. Value references count the variables from 1 in the order of
the model description, since some hosts expect this; `Layout.places` has the place of each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from ..solver.core import INFO_SIZE
from ..solver.kernel import DEFAULT_TOLERANCE, Kernel, StateInfo
from ..solver.signals import START_VALUE
from .dependencies import states_of_outputs
from .ports import FRAME_ROLE, SET, SET_ROLE

SOLVER_TOLERANCE = "solver_tolerance"
MESSAGE = "message"
START = "_start"


@dataclass(frozen=True)
class Variable:
    """One Real variable."""

    name: str
    place: int  # in the memory; of a derivative, its number
    causality: str
    variability: str
    unit: str
    description: str
    start: float | None = None
    minimum: float = -math.inf
    maximum: float = math.inf
    nominal: float = 1.0
    reference: int = 0  # its value reference, which is its number in the model description


@dataclass(frozen=True)
class Layout:
    """Offsets into the memory, and other data that the runtime needs besides the equations."""

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
    places: list[int]  # of each value reference; `size` for variables that are not numbers
    names: dict[str, int]  # place of each variable
    units: dict[str, str]
    ranges: dict[str, list[float | None]]


@dataclass(frozen=True)
class Interface:
    """The variables of an FMU.

    Their value references are in this order: inputs, outputs and parameters, the String
    ``message``, in native FMUs the states that are no outputs, derivatives, event indicators, and
    the time, which is a variable in FMI 3.0.
    """

    variables: tuple[Variable, ...]  # all that are Real, except indicators and time
    layout: Layout
    message_reference: int
    states: tuple[Variable, ...] = ()  # of a native FMU: one per state
    derivatives: tuple[Variable, ...] = ()  # one per state
    events: int = 0  # number of event indicators

    @property
    def first_indicator(self) -> int:
        """Value reference of the first event indicator; the others follow."""
        return 1 + max([self.message_reference, *(v.reference for v in self.variables[-1:])])

    @property
    def time_reference(self) -> int:
        """Value reference of the time, the last one."""
        return self.first_indicator + self.events

    def of(self, causality: str) -> list[Variable]:
        return [v for v in self.variables if v.causality == causality]


def interface_of(kernel: Kernel) -> Interface:
    """The variables of a readable FMU of a component."""
    late = 2 * len(kernel.delays)  # delayed signals and their rates
    held = len(kernel.inputs) + len(kernel.discrete) + late + bool(kernel.modes)
    n, at, size = len(kernel.states), {}, held
    counts = {"parameters": len(kernel.parameters), "states": n, "outputs": len(kernel.outputs)}
    counts |= {"starts": n + len(kernel.discrete), "tolerance": 1, "info": INFO_SIZE}
    for part, count in (counts | {"time": 1, "samples": 1}).items():
        at[part] = size
        size += count
    frame = _frame(kernel, at["states"], size)
    size += bool(frame)
    of_parameters = {p.name: at["parameters"] + k for k, p in enumerate(kernel.parameters)}
    listed = [*_inputs(kernel), *_outputs(kernel, at["outputs"])]
    listed += [*_parameters(kernel, at["parameters"]), *_starts(kernel, at["starts"])]
    if n or late:
        meaning = "relative tolerance of the internal solver"
        about = SOLVER_TOLERANCE, at["tolerance"], "parameter", "fixed", "1", meaning
        listed.append(Variable(*about, DEFAULT_TOLERANCE, 1e-13, 1e-2, DEFAULT_TOLERANCE))
    variables = _numbered(listed, 1)
    initial = [0.0] * size
    for v in variables:
        initial[v.place] = v.start or 0.0
    initial[at["tolerance"]] = DEFAULT_TOLERANCE
    layout = Layout(
        model=kernel.name,
        inputs=len(kernel.inputs),
        discrete=len(kernel.discrete),
        delays=len(kernel.delays),
        modes=len(kernel.modes),
        held=held,
        **at,
        step_start=next((k for k, i in enumerate(kernel.inputs) if i.role == "internal"), -1),
        sample_time=of_parameters.get(kernel.sample_time, -1),
        frame=frame,
        size=size,
        initial=initial,
        nominal=[s.nominal for s in kernel.states],
        places=[size, *(v.place for v in variables), size],
        names={v.name: v.place for v in variables},
        units={v.name: v.unit for v in variables},
        ranges={
            v.name: [b if math.isfinite(b) else None for b in (v.minimum, v.maximum)]
            for v in variables
            if v.causality == "parameter"
        },
    )
    return Interface(variables, layout, len(variables) + 1)


def native_interface_of(kernel: Kernel) -> Interface:
    """The same variables, then those of a native FMU.

    A state is the output that is equal to it, or a variable of its own.
    """
    shared = interface_of(kernel)
    first, layout = shared.message_reference + 1, shared.layout
    taken = {v.name for v in shared.variables} | {MESSAGE}
    shown = dict(zip(states_of_outputs(kernel), shared.of("output"), strict=True))

    def local(name: str, place: int, unit: str, meaning: str, s: StateInfo) -> Variable:
        return Variable(name, place, "local", "continuous", unit, meaning, nominal=s.nominal)

    hidden: list[Variable] = []
    for k, s in enumerate(kernel.states):
        if k not in shown:
            name = f"{s.name}_state" if s.name in taken else s.name
            hidden.append(local(name, layout.states + k, s.unit, s.meaning, s))
    own = _numbered(hidden, first)
    of_number = {v.place - layout.states: v for v in own} | shown
    states = tuple(of_number[k] for k in range(len(kernel.states)))
    rates = [
        local(f"der({v.name})", k, f"{s.unit}/s", f"time derivative of {s.meaning}", s)
        for k, (s, v) in enumerate(zip(kernel.states, states, strict=True))
    ]
    derivatives = _numbered(rates, first + len(own))
    variables = (*shared.variables, *own, *derivatives)
    return Interface(variables, layout, first - 1, states, derivatives, kernel.events)


def _numbered(variables: Iterable[Variable], first: int) -> tuple[Variable, ...]:
    """The variables with value references from `first` on, in their order."""
    return tuple(replace(v, reference=first + k) for k, v in enumerate(variables))


def _inputs(kernel: Kernel) -> Iterator[Variable]:
    for k, i in enumerate(kernel.inputs):
        if i.role != "internal":
            about = i.name, k, "input", "continuous", i.unit, i.meaning
            yield Variable(*about, start=i.start, nominal=i.nominal)


def _outputs(kernel: Kernel, first: int) -> Iterator[Variable]:
    delayed = {d.name for d in kernel.delays} | {f"{d.name}_rate_" for d in kernel.delays}
    # what changes between events
    moving = {s.name for s in kernel.states} | {i.name for i in kernel.inputs} | delayed | {"t"}
    for k, o in enumerate(kernel.outputs):
        held = bool(kernel.sample_time) and moving.isdisjoint(o.uses)
        variability = "discrete" if held else "continuous"
        about = o.name, first + k, "output", variability, o.unit, o.meaning
        yield Variable(*about, nominal=o.nominal)


def _parameters(kernel: Kernel, first: int) -> Iterator[Variable]:
    for k, p in enumerate(kernel.parameters):
        about = p.name, first + k, "parameter", "fixed", p.unit, f"{p.meaning} ({p.source})"
        yield Variable(*about, p.default, p.minimum, p.maximum, p.nominal)


def _starts(kernel: Kernel, first: int) -> Iterator[Variable]:
    # the nominal value of a state scales the solver's absolute tolerance; a start value has that of
    # its signal
    shown = {o.uses[0]: o.nominal for o in kernel.outputs if len(o.uses) == 1}
    for k, s in enumerate((*kernel.states, *kernel.discrete)):
        about = s.name + START, first + k, "parameter", "fixed", s.unit, f"initial {s.meaning}"
        yield Variable(*about, start=s.start, nominal=shown.get(s.name, s.nominal))


def _frame(kernel: Kernel, states: int, free: int) -> dict[str, int]:
    """States that are set from inputs at a new value of the input `ask` (last value in `seen`)."""
    asks = [k for k, i in enumerate(kernel.inputs) if i.role == FRAME_ROLE]
    if not asks:
        return {}
    given = [k for k, i in enumerate(kernel.inputs) if i.role == SET_ROLE]
    names = [s.name for s in kernel.states]
    to = states + names.index(kernel.inputs[given[0]].name.removesuffix(SET))
    return {"ask": asks[0], "seen": free, "from": given[0], "to": to, "count": len(given)}


def with_start_values(
    kernel: Kernel, values: Mapping[str, float], sources: Mapping[str, str]
) -> Kernel:
    """A copy whose parameters, and initial states by ``x_start``, have these values as defaults.

    Parameters
    ----------
    kernel : Kernel
    values : mapping of str to float
        Each the name of a parameter, or of a state with ``_start``.
    sources : mapping of str to str
        Sources of parameter values, added to their descriptions.
    """
    parameters = [
        replace(p, default=values[p.name], source=sources[p.name]) if p.name in values else p
        for p in kernel.parameters
    ]
    states, discrete = (
        [replace(s, start=values.get(s.name + START, s.start)) for s in own]
        for own in (kernel.states, kernel.discrete)
    )
    return replace(kernel, parameters=parameters, states=states, discrete=discrete)


def with_set_point(kernel: Kernel) -> Kernel:
    """A copy of a controller or a loop whose set-point starts at the default set-point of a run."""
    goal = {"reference": START_VALUE}
    inputs = [replace(i, start=goal.get(i.role, i.start)) for i in kernel.inputs]
    return replace(kernel, inputs=inputs)
