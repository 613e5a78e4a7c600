"""A motion for the machine at hand that tells a cause from those that it is mistaken for.

It stays within what the records show that the machine can do.
"""

from __future__ import annotations

from .drive_model import DriveModel
from .experiment_motions import MOTIONS, UNNAMED, Motion, constant_speeds
from .machine_reach import Reach


def motion_for(cause: str, reach: Reach, model: DriveModel) -> Motion:
    """The motion that tells a cause, or what has no name, on the machine of these records.

    Parameters
    ----------
    cause : str
        A name of `CAUSES`, or `UNNAMED`.
    reach : Reach
    model : DriveModel
        As far as it is known: friction, and the force of the command.
    """
    made = MOTIONS.get(cause, constant_speeds)
    return made(cause, reach, model)


def trial_for(cause: str) -> str:
    """The trial of the virtual rig, by name, that does the same there."""
    return TRIALS_FOR.get(cause, TRIALS_FOR[UNNAMED])


TRIALS_FOR = {
    "direction_asymmetry": "viscous",
    "load_bias": "viscous",
    "position_periodic_friction": "2.3.1/1",
    "position_trend_friction": "2.3.1/16",
    "torque_ripple": "2.3.1/1",
    "nonlinear_viscous": "viscous",
    "stribeck_mismatch": "2.3.1",
    "presliding_hysteresis": "presliding",
    "compliance": "presliding",
    "backlash": "2.4/1",
    "unmodelled_inertia": "2.6/9",
    "input_delay": "2.10/1",
    "friction_drift": "viscous/1",
    "resistance_drift": "viscous/1",
    "voltage_saturation": "viscous/60",
    "parameter_error": "2.3.1",
    UNNAMED: "2.3.1",
}
"""Trials of `ballscrew rig` that tell a cause from those that it is mistaken for."""
