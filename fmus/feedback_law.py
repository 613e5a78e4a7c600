"""The feedback law: ports that make a linearizing controller accurate across an FMI boundary.

A controller reports, in addition to `u`, the derivatives of `u` by each measured signal, the
signals it was given, and du/dt from its own states. A plant applies, inside its own solver,

    u(t) = u + sum_y u_gain_y * (y(t) - u_ref_y) + u_rate * (t - t_k)

with t_k the start of the communication step. All ports start at 0, so that a plant without
connected ports is an ordinary one that holds `u`. Both sides are derived from the component's
equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import sympy as sp

from ..solver.component import TIME, Component, Input, Mode, Output, symbol
from ..solver.functions import slope
from .ports import gain_port, rate_port, reference_port

STEP_START = "t_step"
"""Internal input: the time at which the present communication step began [s]."""


def with_law_ports(component: Component) -> Component:
    """The component with the ports of the feedback law, for a plant or a controller."""
    return report_law(accept_law(component))


def accept_law(plant: Component) -> Component:
    """The plant with law ports on every input for which outputs of a law are declared."""
    ports: list[Input] = []
    applied: dict[sp.Symbol, sp.Expr] = {}
    for command in (i for i in plant.inputs if i.law):
        law = symbol(command.name) + symbol(rate_port(command.name)) * (TIME - symbol(STEP_START))
        signals = [plant.output(name) for name in command.law]
        for y in signals:
            gain, reference = gain_port(command.name, y.name), reference_port(command.name, y.name)
            law += symbol(gain) * (y.value - symbol(reference))
        ports += _law_ports(command, signals)
        applied[symbol(command.name)] = law
    if not ports:
        return plant
    ports.append(Input(STEP_START, "s", "start of the communication step", role="internal"))
    return plant.substituted(applied, inputs=(*plant.inputs, *ports))


def report_law(controller: Component) -> Component:
    """The controller with outputs for the derivatives, references and rate of each command.

    The derivatives of a command that is held between samples are zero, since it does not
    follow the measurements. The ports exist in any case, so that controllers can be exchanged.
    """
    measurements = [i for i in controller.inputs if i.role == "measurement"]
    if not measurements:
        return controller
    ports: list[Output] = []
    moded: dict[str, dict[str, sp.Expr]] = {m.name: {} for m in controller.modes}
    for command in controller.all_outputs:
        described = _law_ports(command, measurements)
        values = _law_values(controller, None, command, measurements)
        ports += [
            Output(port.name, port.unit, port.meaning, value, nominal=port.nominal)
            for port, value in zip(described, values, strict=True)
        ]
        for mode in controller.modes:
            values = _law_values(controller, mode, command, measurements)
            names = (port.name for port in described)
            moded[mode.name] |= dict(zip(names, values, strict=True))
    modes = tuple(
        replace(mode, outputs={**mode.outputs, **moded[mode.name]}) for mode in controller.modes
    )
    return replace(controller, outputs=(*controller.outputs, *ports), modes=modes)


def _law_values(
    controller: Component, mode: Mode | None, command: Output, measurements: Sequence[Input]
) -> list[sp.Expr]:
    """Gains, references and rate of a command, in a mode or in a component without modes."""
    value = sp.sympify(mode.outputs.get(command.name, command.value) if mode else command.value)
    derivatives = {s.name: controller.derivative(s.name) for s in controller.all_states}
    derivatives |= dict(mode.derivatives) if mode else {}
    derivatives |= {d.name: symbol(d.rate) for d in controller.delays}
    rate = slope(value, TIME) + sum(
        slope(value, symbol(name)) * derivative for name, derivative in derivatives.items()
    )
    gains = [slope(value, symbol(y.name)) for y in measurements]
    return [*gains, *(symbol(y.name) for y in measurements), rate]


def _law_ports(command: Input | Output, signals: Sequence[Input | Output]) -> list[Input]:
    """The ports of one command's law, the same on both sides: gains, references, rate."""
    u = command.name
    gains = [
        Input(gain_port(u, y.name), _per(command.unit, y.unit), f"d{u}/d{y.name} of the law")
        for y in signals
    ]
    then = f"at which {u} was computed"
    references = [
        Input(reference_port(u, y.name), y.unit, f"{y.name} {then}", nominal=y.nominal)
        for y in signals
    ]
    rate = Input(rate_port(u), f"{command.unit}/s", f"rate of {u} from the controller's own states")
    return [*gains, *references, rate]


def _per(unit: str, other: str) -> str:
    return f"{unit}/{other}" if other.isalnum() else f"{unit}/({other})"
