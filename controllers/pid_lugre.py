"""Position PID with friction compensation by a LuGre observer.

C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, "A new model for control of systems
with friction", IEEE Transactions on Automatic Control 40, 419 (1995), section IV.A: the bristles'
deflection is computed by their own equation, corrected by the position error,

    dz_hat/dt = r(v, z_hat) - k (x - x_d),
    F_hat = sigma0 z_hat + sigma1 dz_hat/dt,

and the command gets ``F_hat`` in volts. The error of the observer and that of the position go to
zero if ``(sigma1 s + sigma0)/(m s^2 + H(s))`` is strictly positive real, where ``H`` is the effect
of the rest of the command and of the back-EMF on the position error. ``r`` is the plant's own
equation with estimates for its parameters. The viscous friction is left to the PID, whose tuning
rule includes it.
"""

from __future__ import annotations

import sympy as sp

from ..plant.ball_screw import ball_screw
from ..solver.component import Component, Parameter, State, symbol
from .limited import ramp, voltage_law
from .linearization import estimates_of
from .pid import ERROR, PID_VOLTAGE, pid_integral, pid_parameters, simc
from .pid import TUNABLE as PID_TUNABLE
from .rigid_axis import nominal, rigid_axis

TUNABLE = {**PID_TUNABLE, "k": (0.0, 10.0)}

LAST_SHARE = sp.Rational(1, 10)
"""Share of static friction at which the correction decreases to zero."""


def pid_lugre() -> Component:
    """`u` [V] from x, v and x_d."""
    friction = next(t for t in ball_screw().terms if t.name == "friction")
    (bristles,) = friction.states
    hats, estimates, sharpness = estimates_of(friction)
    seen = {**hats, symbol("z"): symbol("z_hat")}
    # remaining share of static friction, in the direction of the correction
    room = 1 - sp.sign(ERROR) * symbol("sigma0_hat") * symbol("z_hat") / symbol("Fs_hat")
    bounded = ramp(room, sp.S.Zero, LAST_SHARE)
    rate = sp.sympify(bristles.derivative).xreplace(seen) + symbol("k") * ERROR * bounded
    force = symbol("sigma0_hat") * symbol("z_hat") + symbol("sigma1_hat") * rate
    command = PID_VOLTAGE + force / symbol("force_per_volt")
    plant = rigid_axis()
    k = simc().integral * plant.force_per_volt / nominal("sigma0")
    same = "adds at rest as much integral action as the PID has: Ki kt 2 pi p/(R sigma0)"
    at_rest = "force of the motor that stands still under one volt"
    source = "the plant's parameters: kt 2 pi p/R"
    return voltage_law(
        "pid_lugre",
        "Position PID with friction compensation by a LuGre observer",
        (
            *pid_parameters(),
            Parameter("k", k, "1/s", "correction of the observer by the position error", same, 0.0),
            Parameter("force_per_volt", plant.force_per_volt, "N/V", at_rest, source, minimum=1e-9),
            *(p for p in estimates if p.name != "sigma2_hat"),
            sharpness,
        ),
        command,
        (
            pid_integral(command),
            State("z_hat", "m", "estimated bristle deflection", rate, nominal=bristles.nominal),
        ),
    )
