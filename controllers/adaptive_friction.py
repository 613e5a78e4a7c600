"""Position PID with adaptive compensation of Coulomb friction.

B. Friedland and Y.-J. Park, "On adaptive friction compensation", IEEE Transactions on Automatic
Control 37, 1609 (1992), with their exponent mu = 2 and a sign that is smooth: for
``m dv/dt = F - a S(v)``, ``S(v) = v/sqrt(v^2 + slow^2)``, where ``F`` is the total force without
this friction, the estimate

    a_hat = y - rate m v^2/2,   dy/dt = rate v (F - a_hat S(v))

obeys ``d(a - a_hat)/dt = -rate v S(v) (a - a_hat)``, and ``v S(v) >= 0``: ``(a - a_hat)^2/2`` is a
Lyapunov function for any command. Above the speed `slow` the error decays with the distance
travelled, by ``exp(-rate distance)``; at rest the estimate does not change. ``F`` is
computed from the measured current: ``kt 2 pi p i - sigma2 v``. ``a_hat S(v)``, in volts, is added
to the command.
"""

from __future__ import annotations

import sympy as sp

from ..plant.axis import axis
from ..solver.component import Component, Parameter, State, symbol
from .limited import voltage_law
from .pid import PID_VOLTAGE, pid_integral, pid_parameters
from .pid import TUNABLE as PID_TUNABLE

TUNABLE = {**PID_TUNABLE, "rate": (1.0, 1e3), "slow": (5e-4, 0.05)}

LEARNING = 50.0
"""Decay of the estimate's error by distance [1/m]: 2 % are left after the nominal step."""

_MODEL = ("m", "kt", "p", "R", "sigma2")


def adaptive_friction() -> Component:
    """`u` [V] from x, v, i and x_d."""
    v, m, rate, slow = map(symbol, ("v", "m", "rate", "slow"))
    sign = v / sp.sqrt(v**2 + slow**2)
    per_ampere = symbol("kt") * 2 * sp.pi * symbol("p")
    estimate = symbol("y") - rate * m * v**2 / 2
    force = per_ampere * symbol("i") - symbol("sigma2") * v
    command = PID_VOLTAGE + estimate * sign * symbol("R") / per_ampere
    model = {p.name: p for p in axis().all_parameters}
    slow_speed = model["Fc"].default / model["sigma2"].default
    meaning = "decay of the estimate's error by the distance that the block slides"
    left = "2 % are left after the nominal step of 8 cm"
    smooth = "speed at which the smooth sign is 0.71"
    least = "Fc/sigma2: the compensation undoes no more damping than viscous friction gives"
    learned = rate * v * (force - estimate * sign)
    about = "estimated friction and the part that the speed explains"
    return voltage_law(
        "adaptive_friction",
        "Position PID with adaptive compensation of Coulomb friction",
        (
            *pid_parameters(),
            Parameter("rate", LEARNING, "1/m", meaning, left, minimum=0.0),
            Parameter("slow", slow_speed, "m/s", smooth, least, minimum=1e-9),
            *(model[n] for n in _MODEL),
        ),
        command,
        (pid_integral(command), State("y", "N", about, learned, nominal=1.0)),
    )
