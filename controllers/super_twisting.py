"""Super-twisting control, smoothed at the surface.

A. Levant, "Sliding order and sliding accuracy in sliding mode control", International Journal of
Control 58, 1247 (1993): ``ds/dt = -k1 sqrt(C |s|) sign(s) + y + d``, ``dy/dt = -k2 C sign(s)``
reaches ``s = ds/dt = 0`` in finite time for every ``|dd/dt| <= C`` with ``k1 = 1.5`` and ``k2 =
1.1`` (A. Levant, International Journal of Control 76, 924 (2003)). ``C`` is the rate caused by
bristles that bend at the Stribeck velocity: ``sigma0 Vs/m``.

Within ``|s| <= layer`` the root is the chord ``s/sqrt(layer)`` and the sign is ``s/layer``, so that
the law has no infinite slope: there it is linear with the natural frequency
``sqrt(k2 C/layer)`` and the damping ``k1/(2 sqrt(k2)) = 0.72``.
"""

from __future__ import annotations

import sympy as sp

from ..plant.instruments.amplifier import saturate
from ..solver.component import Component, Parameter, symbol
from .limited import U_MAX, tracked_integral, tracking_time, voltage_law
from .rigid_axis import nominal, rigid_axis
from .sliding_mode import (
    EQUIVALENT_VOLTAGE,
    FASTEST_SHARE,
    SURFACE,
    VOLTS_PER_RATE,
    surface_parameters,
)

ROOT_GAIN, INTEGRAL_GAIN = 1.5, 1.1

TUNABLE = {
    "slope": (0.5, 50.0),
    "C": (1.0, 1e4),
    "k1": (0.5, 5.0),
    "k2": (0.1, 5.0),
    "layer": (1e-7, 1.0),
}


def smoothed_root(s: sp.Expr, layer: sp.Expr) -> sp.Expr:
    """sqrt(|s|) sign(s), and the chord s/sqrt(layer) within the layer."""
    return s / sp.sqrt(sp.Max(sp.Abs(s), layer))


def super_twisting() -> Component:
    """`u` [V] from x, v and x_d."""
    plant = rigid_axis()
    bound = nominal("sigma0") * nominal("Vs") / plant.inertia
    frequency = FASTEST_SHARE / plant.electrical_time
    layer = INTEGRAL_GAIN * bound / frequency**2
    switched = saturate(SURFACE / symbol("layer"), 1)
    root = symbol("k1") * sp.sqrt(symbol("C")) * smoothed_root(SURFACE, symbol("layer"))
    rate = symbol("k2") * symbol("C") * switched
    command = EQUIVALENT_VOLTAGE - VOLTS_PER_RATE * root + symbol("w")
    source, bent = "Levant (2003)", "bristles that bend at the Stribeck velocity: sigma0 Vs/m"
    within = f"natural frequency of {FASTEST_SHARE:g} R/L within it"
    return voltage_law(
        "super_twisting",
        "Super-twisting sliding mode control, smoothed at the surface",
        (
            *surface_parameters(),
            Parameter("C", bound, "m/s^3", "bound of the rate of what disturbs ds/dt", bent, 1e-9),
            Parameter("k1", ROOT_GAIN, "1", "gain on the root of s, by sqrt(C)", source),
            Parameter("k2", INTEGRAL_GAIN, "1", "gain on the integral of its sign, by C", source),
            Parameter(
                "layer", layer, "m/s", "where the root and the sign are linear", within, 1e-12
            ),
            tracking_time(1e-2, "short against the surface's time constant, 1/slope"),
            U_MAX,
        ),
        command,
        (tracked_integral(-VOLTS_PER_RATE * rate, command),),
    )
