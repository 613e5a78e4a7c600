"""Fuzzy PD and an integral.

J. Jantzen, "Foundations of Fuzzy Control", 2nd ed., Wiley (2013), chapter 4, the structure FPD+I:
the position error and the velocity, each scaled to -1 ... 1, belong to five triangular sets that
add up to one; a rule's weight is the product of its two memberships, its conclusion a number
(Sugeno form of order zero), and the command is their weighted sum. The integral grows in proportion
to the membership of the error in "zero".
"""

from __future__ import annotations

import itertools
import math

import sympy as sp

from ..plant.instruments import NOMINAL_VOLTAGE
from ..solver.component import Component, Parameter, symbol
from .limited import U_MAX, ramp, tracked_integral, tracking_time, voltage_law
from .rigid_axis import rigid_axis

PEAKS = (-1, sp.Rational(-1, 3), 0, sp.Rational(1, 3), 1)
"""Where each set's membership is one: negative large and small, zero, positive small and large."""

_HALF = sp.Rational(1, 2)
RULES = (
    (-1, -1, -1, -_HALF, 0),
    (-1, -1, -_HALF, 0, _HALF),
    (-1, -_HALF, 0, _HALF, 1),
    (-_HALF, 0, _HALF, 1, 1),
    (0, _HALF, 1, 1, 1),
)
"""Share of `full` by rule: rows are the error's sets, columns those of the velocity reversed."""

ERROR_RANGE = 0.02  # m

TUNABLE = {"range_e": (1e-3, 0.2), "range_v": (0.01, 2.0), "full": (5.0, 100.0), "Ki": (0.0, 5e4)}


def memberships(value: sp.Expr) -> list[sp.Expr]:
    """Membership of a scaled value in each of the sets: triangles that add up to one."""
    left = [ramp(value, low, high) for low, high in itertools.pairwise(PEAKS)]
    return [a - b for a, b in itertools.pairwise((1, *left, 0))]


def integral_gain(top_speed: float) -> tuple[float, float]:
    """Ki [V/(m*s)] and the tracking time [s] for the PD controller that the rules equal near zero.

    With its gains the closed loop of the rigid axis is like a lag of ``(1 + b Kd)/(b Kp)``; the
    integral time is four times this (SIMC).
    """
    steepness = float(RULES[2][3] / PEAKS[3]) * NOMINAL_VOLTAGE
    proportional, derivative = steepness / ERROR_RANGE, steepness / top_speed
    b = rigid_axis().speed_per_volt
    integral_time = 4 * (1 + b * derivative) / (b * proportional)
    return proportional / integral_time, math.sqrt(integral_time * derivative / proportional)


def fuzzy_pd_i() -> Component:
    """`u` [V] from x, v and x_d."""
    error = symbol("x_d") - symbol("x")
    of_error = memberships(error / symbol("range_e"))
    of_speed = memberships(-symbol("v") / symbol("range_v"))
    surface = sp.Add(
        *(
            conclusion * e * s
            for row, e in zip(RULES, of_error, strict=True)
            for conclusion, s in zip(row, of_speed, strict=True)
        )
    )
    command = symbol("full") * surface + symbol("w")
    top = NOMINAL_VOLTAGE * rigid_axis().speed_per_volt
    integral, tracking = integral_gain(top)
    large, quarter = "from which on it is wholly large", "a quarter of the nominal step"
    near_zero = "SIMC integral time of the PD that the rules are near zero"
    parameters = (
        Parameter("range_e", ERROR_RANGE, "m", f"error {large}", quarter, minimum=1e-9),
        Parameter("range_v", top, "m/s", f"speed {large}", "steady speed under 36 V", minimum=1e-9),
        Parameter("full", NOMINAL_VOLTAGE, "V", "command of the largest conclusion", "Table 2.1"),
        Parameter("Ki", integral, "V/(m*s)", "integral gain", near_zero, minimum=0.0),
        tracking_time(tracking, "sqrt(Ti Td) of the same PD"),
        U_MAX,
    )
    state = tracked_integral(symbol("Ki") * of_error[2] * error, command)
    return voltage_law("fuzzy_pd_i", "Fuzzy PD with an integral", parameters, command, (state,))
