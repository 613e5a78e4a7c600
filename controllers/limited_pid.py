"""The position PID within a voltage limit, as the basis of laws that compensate friction."""

from __future__ import annotations

import math

import sympy as sp

from ..solver.component import Parameter, State, symbol
from .limited import U_MAX, tracked_integral, tracking_time
from .pid import gain_parameters, simc

ERROR = symbol("x_d") - symbol("x")
PID_VOLTAGE = symbol("Kp") * ERROR + symbol("w") - symbol("Kd") * symbol("v")
"""Proportional, integral and derivative part [V]."""


def pid_parameters() -> tuple[Parameter, ...]:
    """The gains of `pid`, the tracking time and the limit."""
    gains = simc()
    times = gains.proportional / gains.integral, gains.derivative / gains.proportional
    return (
        *gain_parameters(),
        tracking_time(math.sqrt(times[0] * times[1]), "sqrt(Ti Td), Astrom and Hagglund (2006)"),
        U_MAX,
    )


def pid_integral(command: sp.Expr) -> State:
    """The integral part of a law with this command."""
    return tracked_integral(symbol("Ki") * ERROR, command)
