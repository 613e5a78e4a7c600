"""The amplifier between controller and motor: voltage and current limits.

The current limit is modelled as in a servo amplifier with a fast inner loop: near the limit it
lowers the voltage so that the current approaches the limit with the time constant
``current_limit_time`` and never exceeds it if the supply voltage is sufficient.
"""

from __future__ import annotations

from functools import cache

import sympy as sp

from ...solver.component import Component, Parameter, symbol
from . import NOMINAL_VOLTAGE, UNLIMITED

_OF_VOLTAGE = "amplifier voltage limit, either sign; 1e6: none"
_OF_CURRENT = "amplifier current limit, either sign; 1e6: none"
_VOLTAGE = "36 V nominal in Table 2.1, none in the thesis' simulations"
_TIME = "time constant with which the current meets its limit"
_TYPICAL = "typical of a servo amplifier's current loop"
PARAMETERS = (
    Parameter(
        "voltage_limit", UNLIMITED, "V", _OF_VOLTAGE, _VOLTAGE, 0.0, UNLIMITED, NOMINAL_VOLTAGE
    ),
    Parameter("current_limit", UNLIMITED, "A", _OF_CURRENT, "none in the thesis", 0.0, UNLIMITED),
    Parameter("current_limit_time", 1e-4, "s", _TIME, _TYPICAL, minimum=1e-6),
)


@cache
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
