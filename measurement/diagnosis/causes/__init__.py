"""The catalogue of causes, one file for each kind. To add a cause, add it here."""

from __future__ import annotations

from .cause import Cause
from .command import (
    INPUT_DELAY,
    PARAMETER_ERROR,
    SCALE_OF_I,
    SCALE_OF_U,
    SCALE_OF_X,
    SIGN_OF_U,
    SIGN_OF_X,
    TIME_SHIFT,
    UNMODELLED_INERTIA,
    VOLTAGE_SATURATION,
)
from .friction import (
    DIRECTION_ASYMMETRY,
    FRICTION_DRIFT,
    LOAD_BIAS,
    NONLINEAR_VISCOUS,
    RESISTANCE_DRIFT,
    STRIBECK_MISMATCH,
)
from .reversals import BACKLASH, COMPLIANCE, PRESLIDING_HYSTERESIS
from .travel import POSITION_PERIODIC_FRICTION, POSITION_TREND_FRICTION, TORQUE_RIPPLE

OUTSIDE = "outside the catalogue"  # name of a free curve


def _named(*causes: Cause) -> dict[str, Cause]:
    return {c.name: c for c in causes}


CAUSES = _named(
    DIRECTION_ASYMMETRY,
    POSITION_PERIODIC_FRICTION,
    POSITION_TREND_FRICTION,
    TORQUE_RIPPLE,
    LOAD_BIAS,
    NONLINEAR_VISCOUS,
    STRIBECK_MISMATCH,
    PRESLIDING_HYSTERESIS,
    UNMODELLED_INERTIA,
    INPUT_DELAY,
    FRICTION_DRIFT,
    RESISTANCE_DRIFT,
    BACKLASH,
    COMPLIANCE,
    VOLTAGE_SATURATION,
    PARAMETER_ERROR,
)
"""Errors of the plant."""

SIGNALS = _named(SCALE_OF_U, SCALE_OF_I, SCALE_OF_X, SIGN_OF_U, SIGN_OF_X, TIME_SHIFT)
"""Errors of recorded signals: they correct the record and not the plant."""

EVERY = {**CAUSES, **SIGNALS}


def entry_of(name: str) -> str:
    """Entry of the catalogue to which a cause, a signal or a free curve belongs."""
    return EVERY[name].entry or name if name in EVERY else name
