"""A late command: with a pure delay, or through a filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import sympy as sp

from ...solver.component import Component, Delay, Parameter, State, symbol


def with_late_command(plant: Component, delay: Parameter) -> Component:
    """The plant with its command `u` delayed by `delay` [s]; before that the command is zero.

    The delay's minimum is more than 0. A feedback law acts before the delay.
    """
    u = symbol("u")
    given = next(i for i in plant.inputs if i.name == "u")
    late = Delay("u_late", u, symbol(delay.name), given.unit, nominal=given.nominal)
    held = plant.equations_with({u: symbol(late.name)})
    held["delays"] = (*held["delays"], late)
    return replace(plant, **held, parameters=(*plant.parameters, delay))


def with_command_behind(
    plant: Component, time: Parameter, coefficients: Sequence[sp.Expr]
) -> Component:
    """The plant with its command `u` through a linear filter that starts at zero.

    The denominator is 1 + c1 s + c2 s^2 + ... with these coefficients, whose unit of time is
    `time`, with a minimum of more than 0; the numerator is 1.
    """
    u, scale = symbol("u"), symbol(time.name)
    unit = next(i.unit for i in plant.inputs if i.name == "u")
    order = len(coefficients)
    names = ["u_filtered", *(f"u_filtered_rate{k}" for k in range(1, order))]
    # rates are per filter time, so that all states have the magnitude of the command
    parts = [symbol(n) for n in names]
    scaled = [q / scale**k for k, q in enumerate(parts)]
    left = u - parts[0] - sp.Add(*[c * r for c, r in zip(coefficients, scaled[1:], strict=False)])
    rates = [*(q / scale for q in parts[1:]), left * scale ** (order - 1) / coefficients[-1]]
    meaning = "command behind its filter"
    meanings = [meaning, *(f"{meaning}, rate {k} by its time" for k in range(1, order))]
    behind = [
        State(name, unit, words, rate, nominal=10.0)
        for name, words, rate in zip(names, meanings, rates, strict=True)
    ]
    held = plant.equations_with({u: parts[0]})
    held["states"] = (*held["states"], *behind)
    return replace(plant, **held, parameters=(*plant.parameters, time))
