"""The catalogue of causes, one file for each kind. To add a cause, add it here."""

from __future__ import annotations

from . import command, friction, travel
from .cause import Cause

OUTSIDE = "outside the catalogue"  # name of a free curve


def _named(*causes: Cause) -> dict[str, Cause]:
    return {c.name: c for c in causes}


CAUSES = _named(
    friction.DIRECTION_ASYMMETRY,
    travel.POSITION_PERIODIC_FRICTION,
    travel.POSITION_TREND_FRICTION,
    travel.TORQUE_RIPPLE,
    friction.LOAD_BIAS,
    friction.NONLINEAR_VISCOUS,
    friction.STRIBECK_MISMATCH,
    friction.PRESLIDING_HYSTERESIS,
    command.UNMODELLED_INERTIA,
    command.INPUT_DELAY,
    friction.FRICTION_DRIFT,
    friction.RESISTANCE_DRIFT,
    friction.BACKLASH,
    friction.COMPLIANCE,
    command.VOLTAGE_SATURATION,
    command.PARAMETER_ERROR,
)
"""Errors of the plant."""

SIGNALS = _named(
    command.SCALE_OF_U,
    command.SCALE_OF_I,
    command.SCALE_OF_X,
    command.SIGN_OF_U,
    command.SIGN_OF_X,
    command.TIME_SHIFT,
)
"""Errors of recorded signals: they correct the record and not the plant."""

EVERY = {**CAUSES, **SIGNALS}


def entry_of(name: str) -> str:
    """Entry of the catalogue to which a cause, a signal or a free curve belongs."""
    return EVERY[name].entry or name if name in EVERY else name
