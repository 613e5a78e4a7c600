"""The rig's parameter file: values of a trial, and values for the next one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from ...orchestration.loop.parameter_file import ParameterFile, Value, check_values, list_used
from ...orchestration.loop.parts import Part
from ...solver.errors import BadParameter, BadParameters, did_you_mean
from ...solver.kernel import ParameterInfo
from .rig_wiring import PLANT, WIRINGS

TRIAL = "trial"
"""Prefix of the names of sizes of trials; names of parts have the part's name as prefix."""

DRAWN = ("encoder.phase", "capacitance_sensor.separation")  # random in each trial, by its seed


def given_values(
    known: Mapping[str, ParameterInfo],
    law: str,
    parameters: Mapping[str, float] | None,
    told: ParameterFile | None,
) -> dict[str, float]:
    """Values for the rig from a file and a user, as ``part.name``; the user's have priority.

    Parameters
    ----------
    known : mapping of str to ParameterInfo
        Parameters as ``part.name``; only these are used from the file.
    law : str
        Friction law of the rig; it may differ from the file's.
    parameters : mapping of str to float, optional
        The user's; a name without its part is the plant's.
    told : ParameterFile, optional

    Raises
    ------
    BadParameters
    """
    given = {
        name if "." in name else f"{PLANT}.{name}": float(value)
        for name, value in (parameters or {}).items()
    }
    return (_values_for(told, law, known, given) if told else {}) | given


def _values_for(
    told: ParameterFile,
    law: str,
    known: Mapping[str, ParameterInfo],
    given: Mapping[str, float],
) -> dict[str, float]:
    parts = {TRIAL, *(part.name for wiring in WIRINGS.values() for part in wiring.parts)}
    head = f"{PLANT}."
    plant = {n.removeprefix(head): p for n, p in known.items() if n.startswith(head)}
    others = Part(told.plant_name).parameters
    if (told.law or law) == law:  # only initial states are ignored: a trial begins at rest
        others = {n: p for n, p in others.items() if n.endswith("_start")}
    values, _ = told.plant_values(plant, others)
    told.check_complete(plant, {*values, *(n.removeprefix(head) for n in given)})
    found = {head + n: v for n, v in values.items()}
    for name, own in told.rig.items():
        if name not in parts:
            raise BadParameters(
                f"{told.path}: [rig.{name}]: the rig has no such part; it has "
                f"{', '.join(sorted(parts))}"
            )
        head = f"{name}."
        theirs = {n.removeprefix(head): p for n, p in known.items() if n.startswith(head)}
        if theirs:
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

    Values drawn by the seed are not included, unless they were given.
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
    used = ParameterFile(kind=file.kind, law=law, command=file.command, plant=plant, rig=parts)
    return replace(used, controllers=file.controllers)


def check(name: str, value: float, known: Mapping[str, ParameterInfo], law: str) -> None:
    """Raise BadParameter for an unknown parameter, or a value out of range.

    Raises
    ------
    BadParameter
    """
    if name not in known:
        hint = did_you_mean(name, known)
        owner = name.partition(".")[0]
        theirs = [k for k in known if k.startswith(f"{owner}.")] or list(
            dict.fromkeys(k.partition(".")[0] + ".*" for k in known if "." in k)
        )
        raise BadParameter(f"the rig with {law} has no {name!r}; it has {', '.join(theirs)}{hint}")
    p = known[name]
    if not (math.isfinite(value) and p.minimum <= value <= p.maximum):
        raise BadParameter(
            f"{name} is {value:g} {p.unit}, expected a value within [{p.minimum:g}, {p.maximum:g}]"
        )
