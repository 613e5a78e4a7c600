"""A trial with all its inputs: parameters, random numbers, and its sensor's calibration."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

from ...orchestration.loop.loop import list_used
from ...orchestration.loop.parameter_file import ParameterFile, Value
from ...plant.instruments.acquisition import SAMPLE_TIME
from ...plant.instruments.capacitance_sensor import CONVERSION_SAMPLES, PER_PICOFARAD
from ...solver.arrays import Vector
from ...solver.component import in_units
from ...solver.errors import BadParameter
from .machine import SIZED, Machine
from .program import DEVICES, PLANT, REFERENCE, of_part, program_kernel
from .trials import BREAK_AWAY, Trial

POINTS = np.arange(0.0, 75e-6, 10e-6)
"""Displacements at which the capacitance is measured [m]: 0 to 70 um in steps of 10 um."""
_SENSOR = "capacitance_sensor"
_DRAWN = ("encoder.phase", f"{_SENSOR}.separation")  # random in each trial, by its seed
_CALIBRATED = tuple(f"{_SENSOR}.c{k}" for k in range(3))


@dataclass(frozen=True)
class Noise:
    """Sizes of the random values; only that of a conversion is printed (AD7747's data sheet)."""

    load_cell: float = 0.03  # standard deviation before the converter [N]: a third of a step
    capacitance: float = 20e-18  # standard deviation of a conversion [F]: resolution down to 20 aF
    micrometer: float = 0.5e-6
    """Standard deviation of setting the micrometer by hand [m]: with half a micrometre the
    identified stiffness scatters by a few percent, as in Table 2.9."""
    separation: float = 10e-6  # half the range of the plates' initial separation [m]


@dataclass(frozen=True)
class Calibration:
    """A quadratic polynomial from capacitance to displacement, and its uncertainty."""

    coefficients: Vector  # c0, c1, c2 [m] in c0 + c1 C + c2 C^2 with the capacitance C in pF
    covariance: npt.NDArray[np.float64]  # of the coefficients [m^2], from the scatter about the fit
    displacements: Vector  # readings of the micrometer [m], shape (8,)
    capacitances: Vector  # readings of the sensor [F], shape (8,)
    residual: float  # root mean square distance of the points, with its degrees of freedom [m]

    def displacement(self, capacitance: npt.ArrayLike) -> Vector:
        """Displacement [m] for capacitances [F]."""
        return _powers(np.asarray(capacitance, dtype=float)) @ self.coefficients

    def uncertainty(self, capacitance: npt.ArrayLike) -> Vector:
        """Half width of the fit's 95 % interval [m] at capacitances [F]."""
        powers = _powers(np.asarray(capacitance, dtype=float))
        variance = np.einsum("...i,ij,...j->...", powers, self.covariance, powers)
        freedom = len(self.displacements) - len(self.coefficients)
        return np.asarray(stdtrit(freedom, 0.975) * np.sqrt(variance))

    @property
    def error(self) -> float:
        """Largest half width of the 95 % interval over the calibrated points [m]."""
        return float(self.uncertainty(self.capacitances).max())


def _powers(capacitance: Vector) -> npt.NDArray[np.float64]:
    relative = capacitance * PER_PICOFARAD
    return np.stack([np.ones_like(relative), relative, relative**2], axis=-1)


def calibrate(capacitance: npt.ArrayLike, displacements: npt.ArrayLike = POINTS) -> Calibration:
    """Fit the polynomial to average capacitances [F] at the micrometer's displacements [m]."""
    x, c = np.asarray(displacements, dtype=float), np.asarray(capacitance, dtype=float)
    powers = _powers(c)
    # Nearly equal columns lose digits, so orthogonalize them first.
    q, r = np.linalg.qr(powers)
    coefficients = np.linalg.solve(r, q.T @ x)
    rest = x - powers @ coefficients
    variance = float(rest @ rest) / (len(x) - 3)
    inverse = np.linalg.inv(r)
    return Calibration(coefficients, variance * inverse @ inverse.T, x, c, variance**0.5)


@dataclass(frozen=True)
class Setup:
    """A trial with all its inputs."""

    trial: Trial
    machine: Machine
    seed: int
    noise: Noise
    parameters: dict[str, float]  # of all parts, as ``part.name``
    starts: dict[str, float]  # of discrete states, as ``part.state_start``
    external: dict[str, Vector]  # signals from outside at each sample: noise and reference
    calibration: Calibration | None  # of the capacitance sensor, if it is used
    used: ParameterFile  # the parameters as a file, without values drawn by the seed


def set_up(trial: Trial, machine: Machine, seed: int = 0, noise: Noise | None = None) -> Setup:
    """Draw the trial's random numbers, calibrate its sensor, and collect all parameters.

    Raises
    ------
    BadParameter, BadParameters
    """
    noise = noise or Noise(load_cell=Noise.load_cell * machine.sizes["force"] / BREAK_AWAY)
    random = np.random.default_rng([seed, zlib.crc32(trial.name.encode())])
    phase, separation = random.random(), noise.separation * random.uniform(-1.0, 1.0)
    micrometer = noise.micrometer * random.standard_normal(len(POINTS))
    micrometer[0] = 0.0  # the first position defines zero
    averaged = 1.0 / (CONVERSION_SAMPLES * SAMPLE_TIME)  # conversions of a second at each point
    readings = noise.capacitance / averaged**0.5 * random.standard_normal(len(POINTS))
    external = {
        "force_noise": noise.load_cell * random.standard_normal(trial.samples),
        "capacitance_noise": noise.capacitance * random.standard_normal(trial.samples),
        REFERENCE[trial.control]: trial.reference(),
    }
    known = _known(trial, machine)
    given = machine.given(known, complete=True)
    if f"{PLANT}.p" in given:  # the encoder has the same screw
        given.setdefault("encoder.p", given[f"{PLANT}.p"])
    values = {name: p.default for name, p in known.items()} | {"encoder.phase": phase}
    plates = f"{_SENSOR}.separation" in known
    if plates:
        values[f"{_SENSOR}.separation"] += separation
    values |= given
    machine.check_trial(trial, values)
    calibration, starts = None, {}
    if plates:
        calibration = calibrate(_readings(values, POINTS + micrometer, readings))
        values |= dict(zip(_CALIBRATED, calibration.coefficients.tolist(), strict=True))
        at_rest = float(_capacitance(values, np.zeros(1))[0])
        before = math.ceil(values[f"{_SENSOR}.samples"]) - 1.0
        # the converter runs before the trial begins, with the block at rest
        held = {"count": before, "total": before * at_rest, "held": at_rest}
        starts = {f"{_SENSOR}.{name}_start": value for name, value in held.items()}
    used = _used(machine, known, given)
    shown = calibration if trial.fine else None
    return Setup(trial, machine, seed, noise, values, starts, external, shown, used)


def _known(trial: Trial, machine: Machine) -> dict[str, Any]:
    """All parameters as ``part.name``, with the defaults of this machine."""
    known = dict(machine.known)
    for p in program_kernel(trial.control, machine.is_axis).parameters:
        part = next((name for name in DEVICES if p.name.startswith(f"{name}_")), "")
        name = f"{part}.{p.name.removeprefix(f'{part}_')}"
        if part and name not in _CALIBRATED:  # the sampling period has no part
            known[name] = in_units(p, machine.words)
    own = {n: v for n, v in machine.defaults.items() if n in known}
    return known | {n: replace(known[n], default=v, source=SIZED) for n, v in own.items()}


def _capacitance(values: Mapping[str, float], displacement: Vector) -> Vector:
    """Eq. 2.1 with the sensor's values [F]."""
    sensor = of_part(_SENSOR, values)
    area = sensor["permittivity"] * sensor["area"]
    return np.asarray(area / (sensor["separation"] + displacement))


def _readings(values: Mapping[str, float], displacement: Vector, noise: Vector) -> Vector:
    """Capacitances of the calibration [F]."""
    found = _capacitance(values, displacement) + noise
    largest = values[f"{_SENSOR}.range"]
    if not (found.max() <= largest and np.ptp(found) > 1e-3 * largest):
        raise BadParameter(
            f"the plates have {found.min():.3g} to {found.max():.3g} F in the calibration, which "
            f"the converter's {largest:.3g} F cannot resolve; change capacitance_sensor.area or "
            "capacitance_sensor.separation"
        )
    return found


def _used(machine: Machine, known: Mapping[str, Any], given: Mapping[str, float]) -> ParameterFile:
    """All parameters of a trial, as a parameter file that the other commands read.

    Values drawn by the seed are not included, unless they were given.
    """
    file = machine.file or ParameterFile()
    kept = {n: p for n, p in known.items() if n not in _DRAWN or n in given}
    parts: dict[str, dict[str, Value]] = {}
    for part in dict.fromkeys(name.partition(".")[0] for name in known):
        said = file.plant if part == PLANT else file.rig.get(part, {})
        values = of_part(part, given)
        parts[part] = list_used(of_part(part, kept), values, said, "given to this trial")
    return ParameterFile(
        kind=file.kind,
        law=machine.law,
        command=file.command,
        plant=parts.pop(PLANT),
        rig=parts,
        controllers=file.controllers,
    )
