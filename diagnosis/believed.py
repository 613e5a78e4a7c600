"""The parameter file: a drive as its user believes it to be."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..plant.ball_screw import bare_ball_screw
from ..plant.direct_drive import bare_direct_drive
from ..plant.law import law as friction_law
from ..solver.component import Parameter
from .along_record import LAWS
from .drive_model import DIRECT, MOTOR, DriveModel

TOLERANCE = 0.03
"""Relative doubt of a value of whose doubt nothing is said."""

_PLANTS = {"ball_screw": bare_ball_screw, "drive": bare_direct_drive}
_LAW = "modified_lugre"
_KEYS = ("plant", "law", "parameters", "tolerance", "found")
_NEVER_ADJUSTED = ("L", "p", "Kv", "offset")


class BadParameters(ValueError):
    """The parameter file makes no sense; the message says where, why and what to do."""


def read_believed(path: Path | str | None = None, law: str | None = None) -> DriveModel:
    """Read a parameter file.

    A TOML file with ``plant`` ("ball_screw", the default, or "drive"), ``law`` and the tables
    ``[parameters]``, SI, and ``[tolerance]``, the relative doubt of values that may be adjusted.
    What is not in it is the plant's default, except that a file with Fc and without Fs means a
    break-away force of Fc. A table ``[found]``, of an extended plant, is left aside.

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
    given = {} if path is None else _read(Path(path))
    path = Path(path or "the nominal axis")
    _known(f"{path}:", given, _KEYS)
    kind = _choice(path, "plant", given.get("plant", "ball_screw"), _PLANTS)
    own = _choice(path, "law", given.get("law", law or _LAW), LAWS)
    used = _choice(path, "law", law or own, LAWS)
    described = {p.name: p for p in _parameters(kind, used)}
    # a file may be read with another law: what only its own law has is then of no use
    told = {p.name: p for p in _parameters(kind, own)} | described
    numbers = _numbers(path, "parameters", given.get("parameters", {}), told)
    for name, value in numbers.items():
        _within(path, f"{name} is {value:g} {told[name].unit}", value, told[name])
    values = {n: numbers.get(n, p.default) for n, p in described.items()}
    for side in ("", "_pos", "_neg"):
        coulomb, breakaway = f"Fc{side}", f"Fs{side}"
        if breakaway in values and coulomb in numbers and breakaway not in numbers:
            values[breakaway] = numbers[coulomb]
    return DriveModel(kind, used, values, _tolerance(path, kind, used, own, given))


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadParameters(f"{path} cannot be read: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadParameters(f"{path} is no TOML file: {error}") from error


def _parameters(kind: str, law: str) -> tuple[Parameter, ...]:
    return _PLANTS[kind](friction_law(law)).all_parameters


def _adjusted(kind: str, law: str) -> list[str]:
    drive = MOTOR if kind == "ball_screw" else DIRECT
    names = (*drive, *DriveModel(kind, law, {}).law_parameters)
    return [n for n in names if n not in _NEVER_ADJUSTED]


def _tolerance(
    path: Path, kind: str, used: str, own: str, given: Mapping[str, Any]
) -> dict[str, float]:
    adjusted = _adjusted(kind, used)
    table = given.get("tolerance", {})
    for name in table if isinstance(table, dict) else ():
        if name in _NEVER_ADJUSTED:
            raise BadParameters(
                f"{path}: [tolerance] has {name}, which is never adjusted; leave it out"
            )
    numbers = _numbers(path, "tolerance", table, [*adjusted, *_adjusted(kind, own)])
    for name, value in numbers.items():
        if not 0 <= value < 1:
            raise BadParameters(
                f"{path}: the tolerance of {name} is {value:g}, expected a share of its value, "
                "from 0 to below 1"
            )
    return {n: numbers.get(n, TOLERANCE) for n in adjusted}


def _numbers(path: Path, table: str, given: Any, names: Iterable[str]) -> dict[str, float]:
    if not isinstance(given, dict):
        raise BadParameters(f"{path}: {table} is {given!r}, expected a table [{table}]")
    _known(f"{path}: [{table}]", given, names)
    for name, value in given.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            raise BadParameters(
                f"{path}: [{table}] {name} is {value!r}, expected a finite number in SI units"
            )
    return {name: float(value) for name, value in given.items()}


def _within(path: Path, what: str, value: float, parameter: Parameter) -> None:
    if not parameter.minimum <= value <= parameter.maximum:
        raise BadParameters(
            f"{path}: {what}, expected {parameter.minimum:g} to {parameter.maximum:g} "
            f"({parameter.meaning})"
        )


def _known(where: str, given: Iterable[str], names: Iterable[str]) -> None:
    names = list(names)
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
            hint = f", did you mean {near[0]}?" if near else f"; there are {', '.join(names)}"
            raise BadParameters(f"{where} there is no {name!r}{hint}")


def _choice(path: Path, key: str, value: Any, names: Iterable[str]) -> str:
    if not isinstance(value, str) or value not in names:
        raise BadParameters(f"{path}: {key} is {value!r}, expected one of {', '.join(names)}")
    return value
