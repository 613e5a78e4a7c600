"""A command that arrives late, in equations that the solver has: no memory but states.

The delay is Padé's approximation with a numerator of one degree less, so that nothing of a jump
arrives at once. Up to an angular frequency of some 4/delay it is late by the delay and nothing
else; a jump arrives late on average, over about the delay's own length.
"""

from __future__ import annotations

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


def with_filtered_command(plant: Component, lag: Parameter) -> Component:
    """The plant with its command `u` behind a filter of first order, settled at zero at first.

    Parameters
    ----------
    plant : Component
        Has an input `u`.
    lag : Parameter
        The filter's time constant [s]; its minimum is more than 0.
    """
    u, given = symbol("u"), symbol("u_filtered")
    unit = next(i.unit for i in plant.inputs if i.name == "u")
    state = State(
        given.name, unit, "command behind its filter", (u - given) / symbol(lag.name), nominal=10.0
    )
    held = plant.equations_with({u: given})
    held["states"] = (*held["states"], state)
    return replace(plant, **held, parameters=(*plant.parameters, lag))


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
