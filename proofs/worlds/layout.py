"""Inputs of the compiled simulator, by their index in one vector.

The default is zero, and zero always means "not present".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

(
    # bodies; MOTOR_MASS includes the rotor, reflected through the screw
    MOTOR_MASS,  # kg
    BLOCK_MASS,  # kg
    SPRING,  # N/m between motor and block; 0: one rigid body
    SPRING_DAMPING,  # N*s/m
    GAP,  # m, total width
    FRICTION_AT_MOTOR,  # 1: all friction acts before the spring
    # the motor
    IS_DRIVE,  # 1: force is GAIN*u, no electrical part
    GAIN,  # N/V
    KT,  # N/A
    KE,  # V*s/m
    R,  # ohm
    L,  # H
    R_DRIFT,  # share of R
    R_FORM,  # 0 linear, 1 exponential, 2 step, 3 heated by its own current
    R_TIME,  # s
    R_CURRENT,  # A, that warms the winding by R_DRIFT
    # the amplifier
    DELAY,  # s, pure
    LAG,  # s, first order
    LAG_TWICE,  # 1: the lag acts twice
    WINDOW,  # s, moving mean
    LIMIT,  # V
    LIMIT_FORM,  # 0 hard, 1 tanh, 2 sags with the current
    SAG,  # ohm
    MAINS,  # V
    MAINS_FREQUENCY,  # Hz
    RAMPED,  # 1: the command is linear between its values, else it is held
    # friction
    LAW,
    FALL,
    SIGMA0,
    SIGMA1,
    SIGMA2,
    FC,
    FS,
    VS,
    KV,
    LEAST_SPEED,  # m/s, of the double: slower motion is rest for its set-valued law
    ASYMMETRY,  # half the difference of the two directions, dry part
    ASYMMETRY_VISCOUS,
    PERIODIC,  # share of the dry part
    PERIODIC_VISCOUS,
    PERIOD,  # m
    PERIOD_PHASE,
    PERIOD_SECOND,  # second harmonic, share of the first
    TREND,  # share from the middle to the end of the travel, dry part
    TREND_VISCOUS,
    TREND_FORM,  # 0 linear, 1 quadratic, 2 one end worn
    DRIFT,
    DRIFT_VISCOUS,
    DRIFT_FORM,  # 0 linear, 1 exponential, 2 step
    DRIFT_TIME,  # s
    QUADRATIC,  # N*s^2/m^2
    CUBIC,  # N*s^3/m^3
    ROOT,  # N/(m/s)^0.5
    THINNING,  # s/m: viscous force over 1 + THINNING*|v|
    NOISE_GROWTH,  # s/m
    # forces
    LOAD,  # N, against +x
    LOAD_SLOPE,  # N/m
    RIPPLE,  # N
    RIPPLE_OF_CURRENT,  # share of the motor's force
    RIPPLE_PERIOD,  # m
    RIPPLE_PHASE,
    RIPPLE_SECOND,
    RIPPLE_FRICTION,  # share of the dry part, same period
    # effects outside the catalogue
    DETENT,  # N
    DETENT_PLACE,  # m
    DETENT_WIDTH,  # m
    MEMORY,  # share of the dry part after a reversal
    MEMORY_WAY,  # m
    AGEING,  # share of the dry part per e-fold of rest
    AGEING_WAY,  # m
    RESONATOR,  # kg
    RESONATOR_SPRING,  # N/m
    RESONATOR_DAMPING,  # N*s/m
    # sensor in the loop
    RESOLUTION,  # m
    FLOORS,  # 1: floor, else round
    INTERPOLATION,  # m
    SIGNAL_PERIOD,  # m
    SCALE_ERROR,  # m of reading at the end of the travel
    SCALE_FORM,  # 0 quadratic along the travel, 1 one slow wave
    TRAVEL,  # m, half
    DURATION,  # s
) = range(81)
COUNT = 81

SET_VALUED, LUGRE, MODIFIED_LUGRE, ELASTO_PLASTIC, MAXWELL = range(5)
GAUSSIAN, EXPONENTIAL, LORENTZ, POLYNOMIAL = range(4)

# columns of the log, one row per logging period
(
    X,  # m, at the period's start
    CURRENT,  # A, at the period's start
    COMMAND,  # V, mean
    V,  # m/s, mean
    A,  # m/s^2, mean
    CURRENT_MEAN,  # A
    CURRENT_BELIEVED,  # A, by the command along this motion, mean
    DRY,  # N, dry friction of the faultless law along this motion, mean
    FRICTION,  # N, all friction, mean
    NEED,  # N, force of the command beyond that of the motion, without a current, mean
    NEED_FORCE,  # N, the same from the current, mean
    NEED_VOLTAGE,  # V, the same for the armature, mean
) = range(12)
LOGGED = 12


def blank() -> Vector:
    """A vector with nothing present."""
    return np.zeros(COUNT)
