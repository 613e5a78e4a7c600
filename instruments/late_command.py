"""A command that arrives late, in equations that the solver has: no memory but states.

The delay is Padé's approximation with a numerator of one degree less, so that nothing of a jump
arrives at once. Up to an angular frequency of some 4/delay it is late by the delay and nothing
else; a jump arrives late on average, over about the delay's own length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import factorial

import sympy as sp

from ..solver.component import Component, Parameter, State, symbol

ORDER = 5


def with_late_command(plant: Component, delay: Parameter) -> Component:
    """The plant with its command `u` arriving `delay` [s] late; before that, none arrives.

    Parameters
    ----------
    plant : Component
        Has an input `u`. A feedback law acts before the delay.
    delay : Parameter
        Its minimum is more than 0.
    """
    u, duration = symbol("u"), symbol(delay.name)
    unit = next(i.unit for i in plant.inputs if i.name == "u")
    names = [f"u_late{k}" for k in range(1, ORDER + 1)]
    parts = [symbol(n) for n in names]
    below = _coefficients(ORDER, ORDER - 1)
    above = _coefficients(ORDER - 1, ORDER)
    late = sp.Add(*[(-1) ** k * c * q for k, (c, q) in enumerate(zip(above, parts, strict=False))])
    left = u - sp.Add(*[c * q for c, q in zip(below, parts, strict=False)])
    rates = [*parts[1:], left / below[-1]]
    on_its_way = (
        State(n, unit, f"command on its way, part {k}", rate / duration, nominal=10.0)
        for k, (n, rate) in enumerate(zip(names, rates, strict=True), start=1)
    )
    held = plant.equations_with({u: late})
    held["states"] = (*held["states"], *on_its_way)
    return replace(plant, **held, parameters=(*plant.parameters, delay))


def with_command_behind(
    plant: Component, time: Parameter, coefficients: Sequence[sp.Expr]
) -> Component:
    """The plant with its command `u` behind a linear filter, settled at zero at first.

    Parameters
    ----------
    plant : Component
        Has an input `u`.
    time : Parameter
        In which the coefficients are told; its minimum is more than 0.
    coefficients : sequence of expression
        Of the filter's denominator 1 + c1 s + c2 s^2 + ...; its numerator is 1.
    """
    u, scale = symbol("u"), symbol(time.name)
    unit = next(i.unit for i in plant.inputs if i.name == "u")
    order = len(coefficients)
    names = ["u_filtered", *(f"u_filtered_rate{k}" for k in range(1, order))]
    # rates are told per the filter's time, so that all states are as large as the command
    parts = [symbol(n) for n in names]
    told = [q / scale**k for k, q in enumerate(parts)]
    left = u - parts[0] - sp.Add(*[c * r for c, r in zip(coefficients, told[1:], strict=False)])
    rates = [*(q / scale for q in parts[1:]), left * scale ** (order - 1) / coefficients[-1]]
    behind = [
        State(
            name,
            unit,
            "command behind its filter" + (f", rate {k} by its time" if k else ""),
            rate,
            nominal=10.0,
        )
        for k, (name, rate) in enumerate(zip(names, rates, strict=True))
    ]
    held = plant.equations_with({u: parts[0]})
    held["states"] = (*held["states"], *behind)
    return replace(plant, **held, parameters=(*plant.parameters, time))


def _coefficients(own: int, other: int) -> list[sp.Rational]:
    """Of Padé's polynomial of degree `own`, the other being of degree `other`, lowest first."""
    both = own + other
    return [
        sp.Rational(
            factorial(both - k) * factorial(own),
            factorial(both) * factorial(k) * factorial(own - k),
        )
        for k in range(own + 1)
    ]
