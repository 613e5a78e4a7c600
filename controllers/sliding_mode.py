"""Sliding mode with a boundary layer.

J.-J. E. Slotine and W. Li, "Applied Nonlinear Control", Prentice Hall (1991), section 7.2:
``u = u_eq - level sat(s/layer)``. Outside the layer ``|s|`` falls at ``(b/lag) level`` or, against
friction, by ``(b/lag) (level - Fs R/(kt 2 pi p))``; within it ``s`` decays with the pole
``(b/lag) level/layer``. The law has no integral: the block sticks if friction balances the
remaining command, at errors up to ``Fs/(m slope pole)``.

With ``s = v + slope (x - x_d)`` and the rigid axis ``lag dv/dt = b u - v``, ``ds/dt = 0`` needs
``u_eq = (1 - lag slope) v / b``; every additional volt changes ``s`` at ``b/lag``
(V. Utkin, "Sliding Modes in Control and Optimization", Springer (1992)). On ``s = 0`` the error
decays with ``slope``.
"""

from __future__ import annotations

from ..plant.instruments.amplifier import saturate
from ..solver.component import Component, Parameter, symbol
from .limited import U_MAX, voltage_law
from .rigid_axis import model_parameters, nominal, rigid_axis

_B, _LAG, _SLOPE, _SPEED = map(symbol, ("b", "lag", "slope", "v"))

SURFACE = _SPEED + _SLOPE * (symbol("x") - symbol("x_d"))
"""s [m/s]."""
EQUIVALENT_VOLTAGE = (1 - _LAG * _SLOPE) * _SPEED / _B
VOLTS_PER_RATE = _LAG / _B
"""Voltage that changes s by one metre per second squared."""

FASTEST_SHARE = 0.25
"""Fastest pole within the boundary layer, as a share of the electrical one, R/L: critical damping
of the layer's lag with the electrical one as second."""

LEVEL_RATIO = 2.0
"""Ratio of the level to the voltage for static friction."""

TUNABLE = {"slope": (0.5, 50.0), "level": (0.22, 36.0), "layer": (1e-4, 1.0)}


def surface_parameters() -> tuple[Parameter, ...]:
    """``slope`` and the model of the rigid axis."""
    meaning = "decay of the position error on the sliding surface"
    source = "the slowest pole of Eq. 3.21, -5 1/s"
    return (Parameter("slope", 5.0, "1/s", meaning, source, minimum=1e-6), *model_parameters())


def sliding_mode() -> Component:
    """`u` [V] from x, v and x_d."""
    plant = rigid_axis()
    level = LEVEL_RATIO * nominal("Fs") / plant.force_per_volt
    pole = FASTEST_SHARE / plant.electrical_time
    layer = plant.speed_per_volt / plant.lag * level / pole
    command = EQUIVALENT_VOLTAGE - symbol("level") * saturate(SURFACE / symbol("layer"), 1)
    times = f"{LEVEL_RATIO:g} times what static friction takes: Fs R/(kt 2 pi p)"
    within = f"pole of {FASTEST_SHARE:g} R/L within it"
    parameters = (
        *surface_parameters(),
        Parameter("level", level, "V", "magnitude of the switched part", times, minimum=0.0),
        Parameter("layer", layer, "m/s", "half width of the boundary layer", within, minimum=1e-9),
        U_MAX,
    )
    description = "Sliding mode control with a boundary layer"
    return voltage_law("sliding_mode", description, parameters, command)
