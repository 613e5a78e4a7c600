"""A trial with all its inputs: parameters, random numbers, calibration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ...solver.component import in_units
from ...solver.errors import BadParameter
from .calibration import POINTS, Calibration, calibrate
from .compiled_rig import program_kernel
from .machine import SIZED, Machine
from .noise import Draw, Noise, draw
from .parameters import check, given_values, used_by_trial
from .rig_trials import FORCE, Trial
from .rig_wiring import PLANT, REFERENCE, WIRINGS, Wiring, wirings

if TYPE_CHECKING:
    from ...orchestration.loop.parameter_file import ParameterFile


Vector = npt.NDArray[np.float64]


# -- inputs of a run -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Setup:
    """A trial with all its inputs.

    Attributes
    ----------
    parameters : dict of str to float
        All parameters of all parts, as ``part.name``.
    starts : dict of str to float
        Start values of discrete states, as ``part.state``.
    external : dict of str to ndarray, shape (m,)
        Signals from outside at each sample: noise and reference.
    used : ParameterFile
        The parameters as a file, without values drawn by the seed.
    """

    trial: Trial
    machine: Machine
    seed: int
    noise: Noise
    parameters: dict[str, float]
    starts: dict[str, float]
    external: dict[str, Vector]
    calibration: Calibration | None
    used: ParameterFile

    @property
    def wiring(self) -> Wiring:
        """Wiring of the trial's program."""
        return wirings(self.machine.is_axis)[self.trial.control]

    def values_of(self, part: str) -> dict[str, float]:
        """Parameters and start values of one part, with its own names."""
        head = f"{part}."
        values = {n.removeprefix(head): v for n, v in self.parameters.items() if n.startswith(head)}
        starts = {n.removeprefix(head): v for n, v in self.starts.items() if n.startswith(head)}
        return values | {f"{name}_start": value for name, value in starts.items()}


def set_up(
    trial: Trial,
    machine: Machine,
    parameters: Mapping[str, float] | None = None,
    seed: int = 0,
    noise: Noise | None = None,
    told: ParameterFile | None = None,
) -> Setup:
    """Draw the trial's random numbers, calibrate its sensor, and collect all parameters.

    Raises
    ------
    UnknownName, BadParameter, BadParameters
    """
    law, noise = machine.law, noise or machine.noise
    plates = machine.is_axis and trial.control == FORCE
    drawn = draw(trial, seed, noise)
    program = program_kernel(trial.control, machine.is_axis).parameters
    known = machine.known
    known |= {_dotted(trial.control, p.name): in_units(p, machine.words) for p in program}
    for fixed in ("sample_time", *_CALIBRATED):
        known.pop(fixed, None)
    for name, default in machine.defaults.items():
        if name in known:
            known[name] = replace(known[name], default=default, source=SIZED)
    given = given_values(known, law, parameters, told)
    for name, value in given.items():
        check(name, value, known, law)
    if f"{PLANT}.p" in given:  # the encoder has the same screw
        given.setdefault("encoder.p", given[f"{PLANT}.p"])
    values = {name: p.default for name, p in known.items()}
    values["encoder.phase"] = drawn.encoder_phase
    calibration, starts = None, {}
    if plates:
        values["capacitance_sensor.separation"] += drawn.separation
    values |= given
    machine.check_trial(trial, values)
    if plates:
        calibration = _calibrate(values, drawn)
        values |= dict(zip(_CALIBRATED, calibration.coefficients.tolist(), strict=True))
        at_rest = float(_capacitance(values, np.zeros(1))[0])
        before = math.ceil(values["capacitance_sensor.samples"]) - 1.0
        # the converter runs before the trial begins, with the block at rest
        starts = {
            "capacitance_sensor.count": before,
            "capacitance_sensor.total": before * at_rest,
            "capacitance_sensor.held": at_rest,
        }
    external = {
        "force_noise": drawn.force,
        "capacitance_noise": drawn.capacitance,
        REFERENCE[trial.control]: trial.reference(),
    }
    used = used_by_trial(law, known, given, told)
    return Setup(trial, machine, seed, noise, values, starts, external, calibration, used)


_CALIBRATED = tuple(f"capacitance_sensor.c{k}" for k in range(3))


def _dotted(control: str, name: str) -> str:
    """``part.name`` of a parameter with the name ``part_name`` in the program."""
    for part in WIRINGS[control].parts:
        if name.startswith(f"{part.name}_"):
            return f"{part.name}.{name.removeprefix(part.name + '_')}"
    return name


def _capacitance(values: Mapping[str, float], displacement: Vector) -> Vector:
    """Eq. 2.1 with the sensor's values [F]."""
    area = values["capacitance_sensor.permittivity"] * values["capacitance_sensor.area"]
    return np.asarray(area / (values["capacitance_sensor.separation"] + displacement))


def _calibrate(values: Mapping[str, float], drawn: Draw) -> Calibration:
    found = _capacitance(values, POINTS + drawn.micrometer) + drawn.calibration
    largest = values["capacitance_sensor.range"]
    if not (found.max() <= largest and np.ptp(found) > 1e-3 * largest):
        raise BadParameter(
            f"the plates have {found.min():.3g} to {found.max():.3g} F in the calibration, which "
            f"the converter's {largest:.3g} F cannot resolve; change capacitance_sensor.area or "
            "capacitance_sensor.separation"
        )
    return calibrate(found)
