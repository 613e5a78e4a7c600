"""The rig's velocity and force PID controllers, which run at 200 Hz.

The thesis prints no gains. Both are tuned by the SIMC rule (S. Skogestad, Journal of Process
Control 13, 291 (2003)) in its series form, for a plant with two lags and a delay:

    Kc = lag1 / (gain (tc + delay)),  Ti = min(lag1, 4 (tc + delay)),  Td = lag2

with one choice each, the closed loop's time constant tc. For the velocity it is three times the
delay, so that the block follows slow sines but not the encoder's steps. For the force it is 1 s,
because the thesis' force "takes approximately 4 seconds to reach the steady state" (Section
2.3.4.2), which is four time constants. The response has no overshoot, so the block is loaded
without slipping.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import sympy as sp

from ...plant.ball_screw import PARAMETERS as AXIS
from ...plant.instruments import NOMINAL_VOLTAGE
from ...plant.instruments.acquisition import SAMPLE_TIME, filter_lag, sampling_period
from ...plant.lugre import PARAMETERS as FRICTION
from ...solver.arrays import Vector
from ...solver.component import Component, DiscreteState, Input, Output, Parameter, symbol

Gains: TypeAlias = tuple[float, float, float]
"""Kp, Ki and Kd of the parallel form: command per unit of the error, its integral, its rate."""

ROTOR_INERTIA = next(p.nominal for p in AXIS if p.name == "Jm")  # kg*m^2, Table 2.1
CUTOFF = 20.0  # of the filters on position and force [Hz]; the same, so that both lags are equal
VELOCITY_DELAYS = 3.0  # closed-loop time constant of the velocity over the delay of its loop
FORCE_TIME = 1.0  # closed-loop time constant of the force [s]


def simc(gain: float, lag: float, second_lag: float, delay: float, closed_loop: float) -> Gains:
    """The rule's gains [per unit of the error]; all times in seconds."""
    kc = lag / (gain * (closed_loop + delay))
    ti = min(lag, 4 * (closed_loop + delay))
    return kc * (1 + second_lag / ti), kc / ti, kc * second_lag


def _nominal() -> dict[str, float]:
    values = {p.name: p.default for p in (*AXIS, *FRICTION)} | {"Jm": ROTOR_INERTIA}
    angle = 2 * math.pi * values["p"]
    torque = values["kt"] * angle
    return values | {
        "mass": values["m"] + values["Jm"] * angle**2,
        "force_per_volt": torque / values["R"],
        "back_emf": torque * values["ke"] * angle / values["R"],
    }


def velocity_gains(mass: float, force_per_command: float, damping: float) -> Gains:
    """Gains for the sliding block: lags are those of mass and filter; the rest is delay."""
    lag, filtering = mass / damping, filter_lag(CUTOFF)
    delay = filtering / 2 + SAMPLE_TIME  # half a period to form the difference, half to hold
    return simc(force_per_command / damping, lag, filtering / 2, delay, VELOCITY_DELAYS * delay)


def static_force_gains(force_per_command: float) -> Gains:
    """Gains for a force proportional to the command: half of the filter is lag, the rest delay."""
    filtering = filter_lag(CUTOFF)
    delay = (filtering + SAMPLE_TIME) / 2
    return simc(force_per_command, filtering / 2, 0.0, delay, FORCE_TIME)


def force_gains() -> Gains:
    """Gains for the stuck block: lags of mass, bristles and back-EMF; filter and hold delay."""
    n = _nominal()
    damping = n["sigma1"] + n["sigma2"] + n["back_emf"]
    root = math.sqrt(damping**2 - 4 * n["mass"] * n["sigma0"])
    slow, fast = 2 * n["mass"] / (damping - root), 2 * n["mass"] / (damping + root)
    delay = filter_lag(CUTOFF) + SAMPLE_TIME / 2
    return simc(n["force_per_volt"], slow, fast, delay, FORCE_TIME)


def loading_voltage(rate: float, time: Vector) -> Vector:
    """Voltage [V] that loads the stuck block at a constant rate [N/s] from t = 0.

    The bristles move at rate/sigma0. The voltage for back-EMF and damping at that speed is added to
    the ramp, as a constant.
    """
    n = _nominal()
    damping = n["sigma1"] + n["sigma2"] + n["back_emf"]
    return rate * (time + damping / n["sigma0"]) / n["force_per_volt"]


def velocity_pid() -> Component:
    """Command `u` [V] from `v_ref` and the differentiated filtered position `x` [m]."""
    n, x = _nominal(), symbol("x")
    return _pid(
        "velocity_pid",
        "Velocity PID on the difference of the filtered position",
        velocity_gains(n["mass"], n["force_per_volt"], n["sigma2"] + n["back_emf"]),
        (x - symbol("x_last")) / symbol("sample_time"),
        (
            Input("x", "m", "filtered position of the block", nominal=1e-3),
            Input("v_ref", "m/s", "desired velocity", nominal=1e-3),
        ),
        (DiscreteState("x_last", "m", "position at the last sample", x, nominal=1e-3),),
    )


def force_pid() -> Component:
    """Command `u` [V] from the filtered `force` [N] and `force_ref` [N]."""
    return _pid(
        "force_pid",
        "Force PID on the filtered force of the load cell",
        force_gains(),
        symbol("force"),
        (
            Input("force", "N", "filtered force on the block"),
            Input("force_ref", "N", "desired force"),
        ),
    )


def _pid(
    name: str,
    description: str,
    gains: Gains,
    measured: sp.Expr,
    inputs: tuple[Input, Input],
    memory: tuple[DiscreteState, ...] = (),
) -> Component:
    """A PID on ``inputs[1] - measured`` with its derivative on the measurement.

    Its integral is constant while the command is at its limit.
    """
    unit, period, limit = inputs[1].unit, symbol("sample_time"), symbol("limit")
    error = symbol(inputs[1].name) - measured
    integral = symbol("integral") + period * error
    rate = (measured - symbol("last")) / period
    demand = symbol("Kp") * error + symbol("Ki") * integral - symbol("Kd") * rate
    command = sp.Piecewise((-limit, demand < -limit), (limit, demand > limit), (demand, True))
    limited = sp.Or(demand < -limit, demand > limit)
    total = sp.Piecewise((symbol("integral"), limited), (integral, True))
    source = "SIMC rule, measurement/rig/regulators.py"
    end = "largest command, either sign", "Table 2.1: nominal voltage"
    return Component(
        name=name,
        description=description,
        parameters=(
            Parameter("Kp", gains[0], f"V/({unit})", "proportional gain", source),
            Parameter("Ki", gains[1], f"V/({unit}*s)", "integral gain", source),
            Parameter("Kd", gains[2], f"V*s/({unit})", "derivative gain", source),
            Parameter("limit", NOMINAL_VOLTAGE, "V", *end, minimum=0.0),
        ),
        inputs=inputs,
        discrete=(
            *memory,
            DiscreteState("integral", f"{unit}*s", "sum of the error", total),
            DiscreteState("last", unit, "measurement at the last sample", measured),
            DiscreteState("u_held", "V", "command since the last sample", command),
        ),
        outputs=(Output("u", "V", "voltage command", symbol("u_held"), nominal=10.0),),
        sample_time=sampling_period(),
    )
