"""A drive as its user believes it to be, out of a parameter file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from ..fmus.interface import START
from ..instruments.amplifier import PARAMETERS as AMPLIFIER
from ..orchestration.parameter_file import (
    BALL_SCREW,
    DRIVE,
    BadParameters,
    ParameterFile,
    Value,
)
from ..orchestration.parameter_reading import read_parameters
from ..plant import DEFAULT_LAW
from ..plant.ball_screw import bare_ball_screw
from ..plant.direct_drive import bare_direct_drive
from ..plant.law import law as friction_law
from ..solver.component import Component, Parameter
from .drive_model import DIRECT, MOTOR, DriveModel

TOLERANCE = 0.03
"""Relative tolerance of a value of which nothing is said."""

_PLANTS = {BALL_SCREW: bare_ball_screw, DRIVE: bare_direct_drive}
_NEVER_ADJUSTED = ("L", "p", "Kv", "offset")
_WIDEST = 0.9  # relative tolerance of a value whose interval is wider than the value itself


def read_prior_model(path: Path | str | None = None, law: str | None = None) -> DriveModel:
    """Read a parameter file as the model of a drive.

    What is not in it is the plant's default. The tolerance of a value is that in ``[tolerance]``,
    else half of its interval, else `TOLERANCE`. Values that only a closed loop needs (amplifier,
    initial states, controllers) and the table ``[found]``, of an extended plant, are left aside.

    Parameters
    ----------
    path : path-like, optional
        Without a file, the nominal axis.
    law : str, optional
        Friction law in place of the file's.

    Returns
    -------
    DriveModel

    Raises
    ------
    BadParameters
    """
    return prior_model_from(ParameterFile() if path is None else read_parameters(path), law)


def prior_model_from(file: ParameterFile, law: str | None = None) -> DriveModel:
    """The model of a parameter file that was read already; see `read_prior_model`."""
    if file.kind not in _PLANTS:
        raise BadParameters(
            f"{file.path}: kind is {file.kind!r}, expected one of {', '.join(_PLANTS)}: a "
            "diagnosis needs the equations"
        )
    own = file.law or law or DEFAULT_LAW
    used = law or own
    plant = _plant(file.kind, used)
    described = {p.name: p for p in plant.all_parameters}
    # a file may be read with another law: what only its own law has is then of no use
    known: Mapping[str, Parameter] = {
        p.name: p for p in _plant(file.kind, own).all_parameters
    } | described
    elsewhere = [p.name for p in AMPLIFIER]
    elsewhere += [
        s.name + START for kind in (own, used) for s in _plant(file.kind, kind).all_states
    ]
    numbers, _ = file.plant_values(known, elsewhere)
    values = {n: numbers.get(n, p.default) for n, p in described.items()}
    adjusted = _adjusted(file.kind, used)
    _check_tolerance(file, {*adjusted, *_adjusted(file.kind, own)})
    tolerance = {
        n: file.tolerance[n] if n in file.tolerance else _tolerance_of(file.plant.get(n))
        for n in adjusted
    }
    return DriveModel(file.kind, used, values, tolerance)


def with_lead(file: ParameterFile, lead: float | None) -> ParameterFile:
    """The file with the way of the screw per turn [m], where its plant has a screw.

    Raises
    ------
    BadParameters
        If the file says the lead, too.
    """
    if lead is None:
        return file
    if "p" in file.plant:
        raise BadParameters(
            f"--lead and p of {file.path} both say what a turn of the screw is; expected one of "
            "them"
        )
    if file.kind != BALL_SCREW:
        return file
    return replace(file, plant={**file.plant, "p": Value(1 / lead, "1/m", None, "--lead")})


def lead_of(file: ParameterFile | None, lead: float | None) -> float | None:
    """The lead as it is given [m], else by `p` of the file; None if neither says it."""
    if lead is None and file is not None and "p" in file.plant:
        return 1 / file.plant["p"].value
    return lead


def _plant(kind: str, law: str) -> Component:
    return _PLANTS[kind](friction_law(law))


def _adjusted(kind: str, law: str) -> list[str]:
    drive = MOTOR if kind == BALL_SCREW else DIRECT
    names = (*drive, *DriveModel(kind, law, {}).law_parameters)
    return [n for n in names if n not in _NEVER_ADJUSTED]


def _tolerance_of(value: Value | None) -> float:
    """Half of a value's interval as a share of the value."""
    if value is None or value.interval is None or value.value == 0:
        return TOLERANCE
    low, high = value.interval
    half = max(high - value.value, value.value - low) / abs(value.value)
    return half if math.isfinite(half) and half < _WIDEST else _WIDEST


def _check_tolerance(file: ParameterFile, adjusted: Iterable[str]) -> None:
    for name, share in file.tolerance.items():
        if name in _NEVER_ADJUSTED:
            raise BadParameters(
                f"{file.path}: [tolerance] has {name}, which is never adjusted; leave it out"
            )
        if name not in adjusted:
            raise BadParameters(
                f"{file.path}: [tolerance] there is no {name!r}; there are "
                f"{', '.join(sorted(adjusted))}"
            )
        if not 0 <= share < 1:
            raise BadParameters(
                f"{file.path}: the tolerance of {name} is {share:g}, expected a share of its "
                "value, from 0 to below 1"
            )
