"""Tangent states, inputs and outputs in addition to the ordinary ones of a component.

For each tangent, every state, input and output gets a tangent variable:

    d/dt state_d1 = A state_d1 + B input_d1        output_d1 = C state_d1 + D input_d1

with the partial derivatives at the present state and inputs. The feedback law's ports are
differentiated like all others, so that tangents exchanged between FMUs are those of
the coupled scheme itself. The result is a component and is exported like any other.

A master that orthonormalizes must set tangents during the run. An FMI master may then only set
inputs, so each tangent of a state has an input for it, ``<state>_d<k>_set``; the tangents take
these values when the input ``tangent_frame`` has a new value, before anything else happens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import sympy as sp

from ..solver.component import Component, Input, Output, State, symbol
from ..solver.errors import ContractError
from ..solver.functions import slopes
from .feedback_law import with_law_ports
from .ports import FRAME, FRAME_ROLE, SET_ROLE, TRACE, set_port, tangent_port


def variational(component: Component, tangents: int) -> Component:
    """The component with the feedback law's ports and with tangents.

    Parameters
    ----------
    component : Component
        Without the feedback law's ports.
    tangents : int
        Number of tangents; for a loop, the number of states of plant and controller together. At
        the start tangent k is the k-th axis of the component's own states, and zero if there are
        fewer; parameters ``<state>_d<k>_start`` change that.

    Returns
    -------
    Component
        States in the order position, velocity, friction, the rest; then the tangents, the first
        one's first; then the integral of the trace of the Jacobian by the states [1].

    Raises
    ------
    ContractError
        If it has modes, delays or discrete states.
    ValueError
        If `tangents` is less than 1.
    """
    _check(component, tangents)
    lawful = with_law_ports(component)
    states = _ordered(lawful)
    outputs = lawful.all_outputs
    own = [s.name for s in states]
    _check_names(component.name, own, outputs)
    signals = [i for i in lawful.inputs if i.role != "internal"]
    names = [*own, *(i.name for i in signals)]
    moved = [symbol(name) for name in names]
    rates = slopes([lawful.derivative(name) for name in own], moved)
    shown = slopes([o.value for o in outputs], moved)

    new_states: list[State] = []
    new_inputs: list[Input] = []
    new_outputs: list[Output] = []
    set_inputs: list[Input] = []
    for k in range(1, tangents + 1):
        vector = sp.Matrix([symbol(tangent_port(name, k)) for name in names])
        moving = [_tangent_of(s, k, row, rates[row, :] * vector) for row, s in enumerate(states)]
        new_states += moving
        set_inputs += [_set_input(s) for s in moving]
        new_inputs += [
            Input(tangent_port(i.name, k), i.unit, f"tangent {k} of {i.meaning}", nominal=i.nominal)
            for i in signals
        ]
        new_outputs += [
            _tangent_output(o, k, shown[row, :] * vector) for row, o in enumerate(outputs)
        ]
        there = {o.name for o in new_outputs}
        new_outputs += [
            Output(s.name, s.unit, s.meaning, symbol(s.name), nominal=s.nominal)
            for s in moving
            if s.name not in there
        ]
    if states:
        trace = rates[:, : len(states)].trace()
        meaning = "integral over time of the trace of the Jacobian by the states"
        new_states.append(State(TRACE, "1", meaning, trace))
        new_outputs.append(Output(TRACE, "1", meaning, symbol(TRACE)))
        meaning = "a new value sets the tangents from the ..._set inputs"
        set_inputs.append(Input(FRAME, "1", meaning, role=FRAME_ROLE))
    return Component(
        name=f"{component.name}_variational",
        description=f"{component.description}; with {tangents} tangents",
        parameters=lawful.all_parameters,
        inputs=(*map(_wired, lawful.inputs), *new_inputs, *set_inputs),
        states=(*states, *new_states),
        outputs=(*outputs, *new_outputs),
    )


def _check(component: Component, tangents: int) -> None:
    if tangents < 1:
        raise ValueError(f"{tangents} tangents, expected at least 1")
    instants = {"modes": component.modes, "delays": component.delays}
    for what, parts in (instants | {"discrete states": component.discrete}).items():
        if parts:
            raise ContractError(
                f"{component.name} has {what}; only a component without events and samples can "
                "be exported with tangents. Export it without tangents, or use no FMUs (--via "
                "model)"
            )


def _check_names(component: str, states: Sequence[str], outputs: Sequence[Output]) -> None:
    hidden = [n for n in states if any(o.name == n and o.value != symbol(n) for o in outputs)]
    if hidden:
        raise ContractError(
            f"{component} has a state and another output, both named {hidden[0]!r}: their "
            "tangents would also have the same name"
        )


def _tangent_of(state: State, k: int, row: int, rate: sp.Matrix) -> State:
    """Tangent k of the state in this row."""
    about = tangent_port(state.name, k), state.unit, f"tangent {k} of {state.meaning}"
    return State(*about, rate[0], start=float(row == k - 1), nominal=state.nominal)


def _tangent_output(output: Output, k: int, value: sp.Matrix) -> Output:
    about = tangent_port(output.name, k), output.unit, f"tangent {k} of {output.meaning}"
    return Output(*about, value[0], nominal=output.nominal)


def _set_input(tangent: State) -> Input:
    meaning = f"value that {tangent.name} gets with a new {FRAME}"
    about = set_port(tangent.name), tangent.unit, meaning
    return Input(*about, nominal=tangent.nominal, role=SET_ROLE)


def _wired(port: Input) -> Input:
    """The input without its feedback law, whose ports already exist."""
    return replace(port, law=(), role="signal" if port.role == "measurement" else port.role)


def _ordered(component: Component) -> Sequence[State]:
    """States with their derivatives; states of force terms follow the state they act on."""
    explicit = {
        s.name: replace(s, derivative=derivative)
        for s, derivative in zip(component.all_states, component.derivatives, strict=True)
    }
    names = [s.name for s in component.states]
    last = max((names.index(b.state) for b in component.balances), default=-1) + 1
    inner = [s.name for t in component.terms for s in t.states]
    return [explicit[n] for n in (*names[:last], *inner, *names[last:])]
