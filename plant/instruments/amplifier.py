"""The amplifier between controller and motor: voltage and current limits.

The current limit is modelled as in a servo amplifier with a fast inner loop: near the limit it
lowers the voltage so that the current approaches the limit with the time constant
``current_limit_time`` and never exceeds it if the supply voltage is sufficient.
"""

from __future__ import annotations

import sympy as sp

from ...solver.component import Component, Parameter, symbol
from . import NOMINAL_VOLTAGE, UNLIMITED

PARAMETERS = (
    Parameter(
        "voltage_limit",
        UNLIMITED,
        "V",
        "amplifier voltage limit, either sign; 1e6: none",
        "36 V nominal in Table 2.1, none in the thesis' simulations",
        minimum=0.0,
        maximum=UNLIMITED,
        nominal=NOMINAL_VOLTAGE,
    ),
    Parameter(
        "current_limit",
        UNLIMITED,
        "A",
        "amplifier current limit, either sign; 1e6: none",
        "none in the thesis",
        minimum=0.0,
        maximum=UNLIMITED,
    ),
    Parameter(
        "current_limit_time",
        1e-4,
        "s",
        "time constant with which the current meets its limit",
        "typical of a servo amplifier's current loop",
        minimum=1e-6,
    ),
)


def clip(value: sp.Expr, low: sp.Expr, high: sp.Expr) -> sp.Expr:
    """A value limited by two others."""
    return sp.Piecewise((low, value < low), (high, value > high), (value, True))


def saturate(value: sp.Expr, limit: sp.Expr) -> sp.Expr:
    """A value limited to both signs of a limit."""
    return sp.Max(-limit, sp.Min(limit, value))


def applied_voltage(demand: sp.Expr) -> sp.Expr:
    """Voltage at the motor for a demanded voltage, given the motor's state."""
    current, limit = symbol("i"), symbol("current_limit")
    emf = symbol("ke") * 2 * sp.pi * symbol("p") * symbol("v")
    per_ampere = symbol("L") / symbol("current_limit_time")
    hold = symbol("R") * current + emf
    within_current = clip(
        demand, hold - per_ampere * (limit + current), hold + per_ampere * (limit - current)
    )
    return clip(within_current, -symbol("voltage_limit"), symbol("voltage_limit"))


def with_amplifier(plant: Component) -> Component:
    """The plant with an amplifier at its voltage input; without limits, the same plant."""
    u = symbol("u")
    return plant.substituted({u: applied_voltage(u)}, parameters=(*plant.parameters, *PARAMETERS))
