"""Nominal characteristic trajectory following (Eqs. 3.23-3.28 of the thesis), and its design.

The thesis prints the inclination ``m = -h/A`` and divides by it; with this sign both gains are
negative and the loop diverges. So the magnitude is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from ..plant.axis import axis
from ..solver.arrays import Vector
from ..solver.component import Component, Parameter, State, symbol
from ..solver.kernel import Model
from ..solver.stored import stored_kernel
from .limited import measurements_of, plain_output

STEP_VOLTAGE = 30.0  # V, 85 % of the motor's nominal voltage
NATURAL_FREQUENCY = 3.0  # 1/s
DAMPING = 0.3
PRINTED_SPEED = 0.1193  # m/s
PRINTED_STOPPING_TIME = 0.1  # s
PRINTED_COEFFICIENT = 13.25  # 1/m
STOPPED_SPEED = 3.48e-5
"""Speed [m/s] that the nominal model has 0.1 s after the step ends: the thesis' "stopped"."""

TUNABLE = {"h": (0.01, 0.3), "c": (1.0, 500.0), "Kp": (10.0, 5e3), "Ki": (0.0, 5e4)}


@dataclass(frozen=True)
class NctfDesign:
    """Results of the open-loop step, and the controller computed from them."""

    mode: str
    speed: float  # steady speed h under the step voltage [m/s]
    stopping_time: float  # A [s]
    coefficient: float  # c in ``h tanh(c e)`` [1/m]
    proportional: float  # Kp [V*s/m]
    integral: float  # Ki [V/m]
    # root mean square distance of the tanh to the simulated deceleration, as a share of h; NaN if
    # nothing was fitted
    fit_error: float

    def parameters(self) -> dict[str, float]:
        """The controller's parameters by name."""
        values = self.speed, self.coefficient, self.proportional, self.integral
        return dict(zip(("h", "c", "Kp", "Ki"), values, strict=True))


def _gains(speed: float, stopping_time: float) -> tuple[float, float]:
    scale = STEP_VOLTAGE / (speed / stopping_time * speed)
    return 2 * DAMPING * NATURAL_FREQUENCY * scale, NATURAL_FREQUENCY**2 * scale


def nctf() -> Component:
    """The controller with the printed design's values as defaults."""
    kp, ki = _gains(PRINTED_SPEED, PRINTED_STOPPING_TIME)
    h, c, error_integral = symbol("h"), symbol("c"), symbol("w")
    error = symbol("x") - symbol("x_d")
    trajectory_error = -h * sp.tanh(c * error) - symbol("v")
    source = "Section 3.4.2.1"
    return Component(
        name="nctf",
        description="Nominal characteristic trajectory following with a PI compensator",
        parameters=(
            Parameter("h", PRINTED_SPEED, "m/s", "steady speed under 30 V", source, minimum=0.0),
            Parameter("c", PRINTED_COEFFICIENT, "1/m", "slope of the tanh", source, minimum=0.0),
            Parameter("Kp", kp, "V*s/m", "proportional gain, Eq. 3.24 with |m|", source),
            Parameter("Ki", ki, "V/m", "integral gain, Eq. 3.25 with |m|", source),
        ),
        inputs=measurements_of(axis()),
        states=(State("w", "m", "integral of u_p (x5)", trajectory_error, nominal=1e-3),),
        outputs=(plain_output(symbol("Kp") * trajectory_error + symbol("Ki") * error_integral),),
    )


def design(
    plant_parameters: Mapping[str, float] | None = None,
    mode: str = "printed",
    stopped_speed: float = STOPPED_SPEED,
) -> NctfDesign:
    """Design the controller for a plant from its simulated open-loop step (Section 3.4.2.1).

    Parameters
    ----------
    plant_parameters : mapping of str to float, optional
        Parameters of the plant with other than nominal values.
    mode : {"printed", "fitted"}
        ``printed`` keeps the thesis' h = 0.1193 m/s, uses for A the time until the speed is below
        `stopped_speed`, and scales the thesis' tanh with it. ``fitted`` takes everything from the
        simulated step: h is the steady speed, A the time until it has fallen to 1 %, and c the
        least-squares fit of ``h tanh(c e)`` to speed against the distance still to go.
    stopped_speed : float
        For ``printed`` [m/s].

    Returns
    -------
    NctfDesign

    Raises
    ------
    ValueError
        For an unknown mode, or a plant that does not reach or lose the speed.
    """
    if mode not in ("printed", "fitted"):
        raise ValueError(f"design mode is {mode!r}, expected 'printed' or 'fitted'")
    plant = Model(stored_kernel("plant", axis, "ballscrew.plant.axis"), plant_parameters)
    plant.set_input("u", STEP_VOLTAGE)
    steady = plant.simulate(np.linspace(0.0, 1.0, 101)).outputs["v"]
    if not steady[-1] > 0 or abs(steady[-1] - steady[-11]) > 1e-6 * steady[-1]:
        raise ValueError(f"the plant has no steady speed 1 s after a step of {STEP_VOLTAGE} V")
    plant.set_input("u", 0.0)
    coast = plant.simulate(np.linspace(0.0, 1.0, 200_001))
    speed, position = coast.outputs["v"], coast.outputs["x"]
    if mode == "printed":
        stop = _stopping(coast.time, speed, stopped_speed)
        kp, ki = _gains(PRINTED_SPEED, stop)
        slope = PRINTED_COEFFICIENT * PRINTED_STOPPING_TIME / stop
        return NctfDesign(mode, PRINTED_SPEED, stop, slope, kp, ki, float("nan"))
    h = float(steady[-1])
    stop = _stopping(coast.time, speed, 0.01 * h)
    moving = coast.time <= stop
    to_go = float(np.interp(stop, coast.time, position)) - position[moving]
    slope, fit_error = _fit_tanh(to_go, speed[moving] / h)
    kp, ki = _gains(h, stop)
    return NctfDesign(mode, h, stop, slope, kp, ki, fit_error)


def _stopping(time: Vector, speed: Vector, threshold: float) -> float:
    """Time after which the magnitude stays below `threshold`; the block springs back first."""
    above = np.flatnonzero(np.abs(speed) >= threshold)
    if not len(above) or above[-1] + 1 == len(speed):
        raise ValueError(
            f"the speed does not fall below {threshold:.3g} m/s permanently within 1 s"
        )
    k = above[-1] + 1
    share = (abs(speed[k - 1]) - threshold) / (abs(speed[k - 1]) - abs(speed[k]))
    return float(time[k - 1] + share * (time[k] - time[k - 1]))


def _fit_tanh(distance: Vector, relative_speed: Vector) -> tuple[float, float]:
    from scipy.optimize import curve_fit

    guess = relative_speed[0] / max(distance[0], 1e-12)
    (slope,), _ = curve_fit(lambda e, c: np.tanh(c * e), distance, relative_speed, p0=[guess])
    residual = np.tanh(slope * distance) - relative_speed
    return float(slope), float(np.sqrt(np.mean(residual**2)))
