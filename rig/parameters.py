"""The rig's parameter file: what a trial was run with, and what a file gives the next one."""

from __future__ import annotations

from collections.abc import Mapping

from ..orchestration.parameter_file import (
    BALL_SCREW,
    BadParameters,
    ParameterFile,
    Value,
    check_values,
    list_used,
)
from ..orchestration.parts import Part
from ..solver.kernel import ParameterInfo
from .rig_wiring import PLANT, WIRINGS

DRAWN = ("encoder.phase", "capacitance_sensor.separation")  # each trial draws them by its seed


def values_for(
    told: ParameterFile, law: str, control: str, known: Mapping[str, ParameterInfo]
) -> dict[str, float]:
    """A file's values for one trial, as ``part.name``.

    Parameters
    ----------
    told : ParameterFile
    law : str
        Friction law of the rig, which may be another than the file's.
    control : str
        Kind of the trial; only its parts get values.
    known : mapping of str to ParameterInfo
        Parameters of the trial, as ``part.name``.

    Raises
    ------
    BadParameters
    """
    if told.kind != BALL_SCREW:
        raise BadParameters(f"{told.path}: kind is {told.kind!r}, expected {BALL_SCREW!r}: the rig")
    parts = {part.name for wiring in WIRINGS.values() for part in wiring.parts}
    head = f"{PLANT}."
    plant = {n.removeprefix(head): p for n, p in known.items() if n.startswith(head)}
    others = Part(told.plant_name).parameters
    if (told.law or law) == law:  # initial states alone: a trial begins at rest
        others = {n: p for n, p in others.items() if n.endswith("_start")}
    values, _ = told.plant_values(plant, others)
    found = {head + n: v for n, v in values.items()}
    for name, own in told.rig.items():
        if name not in parts:
            raise BadParameters(
                f"{told.path}: [rig.{name}]: the rig has no such part; it has "
                f"{', '.join(sorted(parts))}"
            )
        if any(part.name == name for part in WIRINGS[control].parts):
            head = f"{name}."
            theirs = {n.removeprefix(head): p for n, p in known.items() if n.startswith(head)}
            numbers = check_values(own, theirs, f"{told.path}: [rig.{name}]")
            found |= {head + n: v for n, v in numbers.items()}
    return found


def used_by_trial(
    law: str,
    known: Mapping[str, ParameterInfo],
    given: Mapping[str, float],
    told: ParameterFile | None,
) -> ParameterFile:
    """All parameters of a trial, as a parameter file that the other commands read.

    What the seed draws is not among them, unless it was given.
    """
    file = told or ParameterFile()
    parts: dict[str, dict[str, Value]] = {}
    for part in dict.fromkeys(name.partition(".")[0] for name in known):
        head = f"{part}."
        kept = {
            n.removeprefix(head): p
            for n, p in known.items()
            if n.startswith(head) and (n not in DRAWN or n in given)
        }
        values = {n.removeprefix(head): v for n, v in given.items() if n.startswith(head)}
        said = file.plant if part == PLANT else file.rig.get(part, {})
        parts[part] = list_used(kept, values, said, "given to this trial")
    plant = parts.pop(PLANT)
    return ParameterFile(law=law, plant=plant, controllers=file.controllers, rig=parts)
