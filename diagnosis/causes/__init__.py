"""The catalogue of causes; adding one is a file and a line here."""

from __future__ import annotations

from . import (
    backlash,
    compliance,
    direction_asymmetry,
    friction_drift,
    input_delay,
    load_bias,
    nonlinear_viscous,
    parameter_error,
    position_periodic_friction,
    position_trend_friction,
    presliding_hysteresis,
    resistance_drift,
    stribeck_mismatch,
    torque_ripple,
    unmodelled_inertia,
    voltage_saturation,
)
from .cause import Cause

CAUSES: dict[str, Cause] = {
    module.CAUSE.name: module.CAUSE
    for module in (
        direction_asymmetry,
        position_periodic_friction,
        position_trend_friction,
        torque_ripple,
        load_bias,
        nonlinear_viscous,
        stribeck_mismatch,
        presliding_hysteresis,
        unmodelled_inertia,
        input_delay,
        friction_drift,
        resistance_drift,
        backlash,
        compliance,
        voltage_saturation,
        parameter_error,
    )
}
