"""Random values of one trial from a seed: noise, offsets and errors of calibration."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .calibration import POINTS
from .rig_trials import Trial

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Sizes of the random values.

    Attributes
    ----------
    load_cell : float
        Standard deviation before the converter [N]. Not printed: a third of the resolution.
    capacitance : float
        Standard deviation of a conversion [F]. AD7747's data sheet: resolution down to 20 aF.
    micrometer : float
        Standard deviation of setting the micrometer by hand [m]. Not printed; with half a
        micrometre the identified stiffness scatters by a few percent, as in Table 2.9.
    separation : float
        Half the range of the plates' initial separation [m]. Not printed.
    """

    load_cell: float = 0.03
    capacitance: float = 20e-18
    micrometer: float = 0.5e-6
    separation: float = 10e-6


@dataclass(frozen=True)
class Draw:
    """Random values of one trial from a seed.

    Attributes
    ----------
    encoder_phase : float
        Position of the origin between two counts.
    separation : float
        Deviation of the plates' initial separation [m].
    micrometer : ndarray, shape (8,)
        Errors of the micrometer's positions [m]; the first defines zero, so its error is zero.
    calibration : ndarray, shape (8,)
        Noise of the calibration's average capacitances [F].
    force, capacitance : ndarray, shape (m,)
        Noise at each sample [N], [F].
    """

    encoder_phase: float
    separation: float
    micrometer: Vector
    calibration: Vector
    force: Vector
    capacitance: Vector


CALIBRATION_AVERAGE = 25
"""Number of conversions averaged at each point of the calibration: one second."""


def draw(trial: Trial, seed: int, noise: Noise) -> Draw:
    """The random numbers of one trial; the same for the same seed, name and noise."""
    rng = np.random.default_rng([seed, zlib.crc32(trial.name.encode())])
    phase = rng.random()
    separation = noise.separation * rng.uniform(-1.0, 1.0)
    micrometer = noise.micrometer * rng.standard_normal(len(POINTS))
    micrometer[0] = 0.0
    calibration = noise.capacitance / CALIBRATION_AVERAGE**0.5 * rng.standard_normal(len(POINTS))
    return Draw(
        phase,
        separation,
        micrometer,
        calibration,
        noise.load_cell * rng.standard_normal(trial.samples),
        noise.capacitance * rng.standard_normal(trial.samples),
    )
