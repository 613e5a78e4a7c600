"""The sliding variable of the position, and the voltage that keeps it constant.

With ``s = v + slope (x - x_d)`` and the rigid axis ``lag dv/dt = b u - v``, ``ds/dt = 0`` needs
``u_eq = (1 - lag slope) v / b``; every additional volt changes ``s`` at ``b/lag``
(V. Utkin, "Sliding Modes in Control and Optimization", Springer (1992)). On ``s = 0`` the error
decays with ``slope``.
"""

from __future__ import annotations

from ..solver.component import Parameter, symbol
from .rigid_axis import model_parameters

_B, _LAG, _SLOPE, _SPEED = map(symbol, ("b", "lag", "slope", "v"))

SURFACE = _SPEED + _SLOPE * (symbol("x") - symbol("x_d"))
"""s [m/s]."""
EQUIVALENT_VOLTAGE = (1 - _LAG * _SLOPE) * _SPEED / _B
VOLTS_PER_RATE = _LAG / _B
"""Voltage that changes s by one metre per second squared."""

FASTEST_SHARE = 0.25
"""Fastest pole within the boundary layer, as a share of the electrical one, R/L: critical damping
of the layer's lag with the electrical one as second."""


def surface_parameters() -> tuple[Parameter, ...]:
    """``slope`` and the model of the rigid axis."""
    return (
        Parameter(
            "slope",
            5.0,
            "1/s",
            "decay of the position error on the sliding surface",
            "the slowest pole of Eq. 3.21, -5 1/s",
            minimum=1e-6,
        ),
        *model_parameters(),
    )
