"""The catalogue of causes. To add a cause, add a file and a line here."""

from __future__ import annotations

from importlib import import_module

from .cause import Cause

_FILES = (
    "direction_asymmetry",
    "position_periodic_friction",
    "position_trend_friction",
    "torque_ripple",
    "load_bias",
    "nonlinear_viscous",
    "stribeck_mismatch",
    "presliding_hysteresis",
    "unmodelled_inertia",
    "input_delay",
    "friction_drift",
    "resistance_drift",
    "backlash",
    "compliance",
    "voltage_saturation",
    "parameter_error",
)
CAUSES: dict[str, Cause] = {name: import_module(f".{name}", __name__).CAUSE for name in _FILES}
