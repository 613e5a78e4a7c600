"""A trial with everything that decides its outcome: parameters, random numbers, calibration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..solver.kernel import ParameterInfo
from ..solver.nearest import did_you_mean
from .calibration import POINTS, Calibration, calibrate
from .compiled_rig import plant_kernel, program_kernel
from .noise import Draw, Noise, draw
from .parameters import used_by_trial, values_for
from .rig_trials import FORCE, Trial
from .rig_wiring import PLANT, REFERENCE, WIRINGS

if TYPE_CHECKING:
    from ..orchestration.parameter_file import ParameterFile


Vector = npt.NDArray[np.float64]


class BadRig(ValueError):
    """A parameter that the rig does not have, or a value out of its range; the message says so."""


# -- what is run -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Setup:
    """A trial with everything that decides its outcome.

    Attributes
    ----------
    parameters : dict of str to float
        All parameters of all parts, as ``part.name``.
    starts : dict of str to float
        Start values of discrete states, as ``part.state``.
    external : dict of str to ndarray, shape (m,)
        Signals from outside at each sample: noise and reference.
    used : ParameterFile
        The parameters as a file, without what the seed drew.
    """

    trial: Trial
    law: str
    seed: int
    noise: Noise
    parameters: dict[str, float]
    starts: dict[str, float]
    external: dict[str, Vector]
    calibration: Calibration | None
    used: ParameterFile

    def values_of(self, part: str) -> dict[str, float]:
        """Parameters and start values of one part, under its own names."""
        head = f"{part}."
        values = {n.removeprefix(head): v for n, v in self.parameters.items() if n.startswith(head)}
        starts = {n.removeprefix(head): v for n, v in self.starts.items() if n.startswith(head)}
        return values | {f"{name}_start": value for name, value in starts.items()}


def set_up(
    trial: Trial,
    law: str,
    parameters: Mapping[str, float] | None,
    seed: int,
    noise: Noise,
    told: ParameterFile | None = None,
) -> Setup:
    """Draw the trial's random numbers, calibrate its sensor, and collect all parameters.

    Raises
    ------
    UnknownLaw, BadRig, BadParameters
    """
    drawn = draw(trial, seed, noise)
    known = {f"{PLANT}.{p.name}": p for p in plant_kernel(law).parameters}
    known |= {_dotted(trial.control, p.name): p for p in program_kernel(trial.control).parameters}
    for fixed in ("sample_time", *_CALIBRATED):
        known.pop(fixed, None)
    given = values_for(told, law, trial.control, known) if told else {}
    given |= {
        name if "." in name else f"{PLANT}.{name}": float(value)
        for name, value in (parameters or {}).items()
    }
    for name, value in given.items():
        _check(name, value, known, law)
    if f"{PLANT}.p" in given:  # one screw
        given.setdefault("encoder.p", given[f"{PLANT}.p"])
    values = {name: p.default for name, p in known.items()}
    values["encoder.phase"] = drawn.encoder_phase
    calibration, starts = None, {}
    if trial.control == FORCE:
        values["capacitance_sensor.separation"] += drawn.separation
    values |= given
    if trial.control == FORCE:
        calibration = _calibrate(values, drawn)
        values |= dict(zip(_CALIBRATED, calibration.coefficients.tolist(), strict=True))
        at_rest = float(_capacitance(values, np.zeros(1))[0])
        before = math.ceil(values["capacitance_sensor.samples"]) - 1.0
        # the converter has been running before the trial begins, with the block at rest
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
    return Setup(trial, law, seed, noise, values, starts, external, calibration, used)


_CALIBRATED = tuple(f"capacitance_sensor.c{k}" for k in range(3))


def _check(name: str, value: float, known: Mapping[str, ParameterInfo], law: str) -> None:
    if name not in known:
        hint = did_you_mean(name, known)
        owner = name.partition(".")[0]
        theirs = [k for k in known if k.startswith(f"{owner}.")] or list(
            dict.fromkeys(k.partition(".")[0] + ".*" for k in known if "." in k)
        )
        raise BadRig(f"the rig with {law} has no {name!r}; it has {', '.join(theirs)}{hint}")
    p = known[name]
    if not (math.isfinite(value) and p.minimum <= value <= p.maximum):
        raise BadRig(
            f"{name} is {value:g} {p.unit}, expected a value within [{p.minimum:g}, {p.maximum:g}]"
        )


def _dotted(control: str, name: str) -> str:
    """``part.name`` of a parameter that the program calls ``part_name``."""
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
        raise BadRig(
            f"the plates have {found.min():.3g} to {found.max():.3g} F in the calibration, which "
            f"the converter's {largest:.3g} F cannot resolve; change capacitance_sensor.area or "
            "capacitance_sensor.separation"
        )
    return calibrate(found)
