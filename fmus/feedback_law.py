"""The feedback law: what lets a linearizing controller be right across an FMI boundary.

A controller reports, beside `u`, the derivatives of `u` by each measured signal, the signals it was
given, and du/dt from its own states. A plant applies, inside its own solver,

    u(t) = u + sum_y u_gain_y * (y(t) - u_ref_y) + u_rate * (t - t_k)

with t_k the start of the communication step. All ports start at 0, so that an unconnected plant is
an ordinary one that holds `u`. Both sides are derived from the component's equations.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import TIME, Component, Input, Output, symbol
from .law_ports import gain_port, rate_port, reference_port

STEP_START = "t_step"
"""Internal input: the time at which the present communication step began [s]."""


def accept_law(plant: Component) -> Component:
    """The plant with law ports on every input that names the outputs a law may act on."""
    ports: list[Input] = []
    applied: dict[sp.Symbol, sp.Expr] = {}
    for command in (i for i in plant.inputs if i.law):
        law = symbol(command.name) + symbol(rate_port(command.name)) * (TIME - symbol(STEP_START))
        signals = [plant.output(name) for name in command.law]
        for y in signals:
            gain, reference = gain_port(command.name, y.name), reference_port(command.name, y.name)
            law += symbol(gain) * (y.value - symbol(reference))
            ports.append(
                Input(gain, _per(command.unit, y.unit), f"d{command.name}/d{y.name} of the law")
            )
        for y in signals:
            ports.append(
                Input(
                    reference_port(command.name, y.name),
                    y.unit,
                    f"{y.name} at which {command.name} was computed",
                    nominal=y.nominal,
                )
            )
        ports.append(
            Input(
                rate_port(command.name),
                f"{command.unit}/s",
                f"rate of {command.name} within the communication step",
            )
        )
        applied[symbol(command.name)] = law
    if not ports:
        return plant
    ports.append(Input(STEP_START, "s", "start of the communication step", role="internal"))
    return plant.substituted(applied, inputs=(*plant.inputs, *ports))


def report_law(controller: Component) -> Component:
    """The controller with outputs for the derivatives, references and rate of each command.

    The derivatives of a command that is held between samples are zero: it does not follow the
    measurements. It has the ports all the same, so that it fits where another controller was.
    """
    measurements = [i for i in controller.inputs if i.role == "measurement"]
    if not measurements:
        return controller
    ports: list[Output] = []
    for command in controller.all_outputs:
        by_signal = {y.name: sp.diff(command.value, symbol(y.name)) for y in measurements}
        rate = sp.diff(command.value, TIME) + sum(
            sp.diff(command.value, symbol(s.name)) * controller.derivative(s.name)
            for s in controller.all_states
        )
        for y in measurements:
            ports.append(
                Output(
                    gain_port(command.name, y.name),
                    _per(command.unit, y.unit),
                    f"d{command.name}/d{y.name}",
                    by_signal[y.name],
                )
            )
        for y in measurements:
            ports.append(
                Output(
                    reference_port(command.name, y.name),
                    y.unit,
                    f"{y.name} at which {command.name} was computed",
                    symbol(y.name),
                    nominal=y.nominal,
                )
            )
        ports.append(
            Output(
                rate_port(command.name),
                f"{command.unit}/s",
                f"rate of {command.name} from the controller's own states",
                rate,
            )
        )
    return replace(controller, outputs=(*controller.outputs, *ports))


def _per(unit: str, other: str) -> str:
    return f"{unit}/{other}" if other.isalnum() else f"{unit}/({other})"
