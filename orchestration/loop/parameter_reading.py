"""Read a parameter file: every line is checked, and errors name their place."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

from ...plant import LAWS
from .parameter_file import (
    BALL_SCREW,
    COMMANDS,
    COMMANDS_OF,
    DRIVE,
    FORMAT,
    KINDS,
    BadParameters,
    Diagnosed,
    ParameterFile,
    Value,
    Values,
    known_name,
)

_KEYS = (
    "format",
    "kind",
    "command",
    "law",
    "plant",
    "found",
    "controller",
    "rig",
    "tolerance",
    "not_identified",
    "diagnosis",
)
_DIAGNOSIS_KEYS = [f.name for f in fields(Diagnosed)]
_VALUE_KEYS = [f.name for f in fields(Value)]


# -- reading ---------------------------------------------------------------------------------


def read_parameters(path: Path | str) -> ParameterFile:
    """Read a parameter file; the names of parameters are checked where they are used.

    Raises `BadParameters`, in one line: what cannot be used and why.
    """
    path = Path(path)
    data = _toml(path)
    known_name(f"{path}:", data, _KEYS)
    if data.get("format", FORMAT) != FORMAT:
        raise BadParameters(f"{path}: format is {data['format']!r}, expected {FORMAT!r}")
    kind = _choice(path, "kind", data.get("kind", BALL_SCREW), KINDS)
    law = _choice(path, "law", data["law"], LAWS) if "law" in data else ""
    reasons = _table(path, "not_identified", data.get("not_identified", {}))
    return ParameterFile(
        path,
        kind,
        law,
        _values(path, "plant", data.get("plant", {})),
        _values(path, "found", data.get("found", {})),
        _groups(path, "controller", data.get("controller", {})),
        _groups(path, "rig", data.get("rig", {})),
        _numbers(path, "tolerance", data.get("tolerance", {})),
        {name: str(reason) for name, reason in reasons.items()},
        _diagnosed(path, data["diagnosis"]) if "diagnosis" in data else None,
        _command(path, kind, data["command"]) if "command" in data else "",
    )


def _command(path: Path, kind: str, given: Any) -> str:
    if kind not in COMMANDS_OF:
        raise BadParameters(
            f"{path}: has the key command, and a plant of the kind {kind!r} has its own; "
            f"remove it, or set kind to one of {', '.join(COMMANDS_OF)}"
        )
    command = _choice(path, "command", given, COMMANDS_OF[kind])
    return "" if command == COMMANDS[0] else command


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BadParameters(f"{path} cannot be read: {error.strerror or error}") from error
    except RecursionError:
        raise BadParameters(f"{path} is not a parameter file: it is nested too deeply") from None
    except ValueError as error:  # of TOML, of UTF-8, or an integer of too many digits
        raise BadParameters(f"{path} is not a TOML file: {error}") from error


def _table(path: Path, name: str, given: Any) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise BadParameters(f"{path}: {name} is {given!r}, expected a table [{name}]")
    return given


def _groups(path: Path, key: str, given: Any) -> dict[str, Values]:
    groups = _table(path, key, given)
    return {name: _values(path, f"{key}.{name}", values) for name, values in groups.items()}


def _values(path: Path, table: str, given: Any) -> dict[str, Value]:
    return {
        name: _value(path, f"[{table}] {name}", value)
        for name, value in _table(path, table, given).items()
    }


def _numbers(path: Path, table: str, given: Any) -> dict[str, float]:
    return {
        name: _number(path, f"[{table}] {name}", value)
        for name, value in _table(path, table, given).items()
    }


def _diagnosed(path: Path, given: Any) -> Diagnosed:
    table = _table(path, "diagnosis", given)
    known_name(f"{path}: [diagnosis]", table, _DIAGNOSIS_KEYS)
    missing = [key for key in _DIAGNOSIS_KEYS if key not in table]
    if missing:
        raise BadParameters(f"{path}: [diagnosis] has no {missing[0]!r}; diagnose writes this key")
    records = table["records"]
    if not isinstance(records, list) or not all(isinstance(name, str) for name in records):
        raise BadParameters(f"{path}: [diagnosis] records is {records!r}, expected a list of names")
    causes = _table(path, "diagnosis.causes", table["causes"])
    return Diagnosed(
        tuple(records),
        _choice(path, "[diagnosis] command", table["command"], COMMANDS_OF[DRIVE]),
        _number(path, "[diagnosis] command_shift", table["command_shift"]),
        _choice(path, "[diagnosis] law", table["law"], LAWS),
        _numbers(path, "diagnosis.prior", table["prior"]),
        _numbers(path, "diagnosis.adjusted", table["adjusted"]),
        {n: _numbers(path, f"diagnosis.causes.{n}", values) for n, values in causes.items()},
    )


def _value(path: Path, where: str, given: Any) -> Value:
    if not isinstance(given, dict):
        return Value(_number(path, where, given))
    known_name(f"{path}: {where}:", given, _VALUE_KEYS)
    if "value" not in given:
        raise BadParameters(f"{path}: {where} has no value; write {where.split()[-1]}.value = ...")
    value = _number(path, where, given["value"])
    for key in ("unit", "source"):
        if not isinstance(given.get(key, ""), str):
            raise BadParameters(f"{path}: {where}: {key} is {given[key]!r}, expected a text")
    interval = given.get("interval")
    if interval is not None:
        interval = _interval(path, where, interval, value)
    return Value(value, given.get("unit", ""), interval, given.get("source", ""))


def _interval(path: Path, where: str, given: Any, value: float) -> tuple[float, float]:
    numbers = isinstance(given, list) and len(given) == 2 and all(map(_is_number, given))
    if not numbers or not given[0] <= value <= given[1]:
        raise BadParameters(
            f"{path}: {where}: the interval is not of the form [low, high] with the value "
            f"{value:g} between them"
        )
    try:
        return float(given[0]), float(given[1])
    except OverflowError:
        raise BadParameters(f"{path}: {where}: the interval reaches beyond 1e308") from None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(path: Path, where: str, given: Any) -> float:
    shown = ""
    try:
        number = float(given) if _is_number(given) else math.nan
    except OverflowError:  # an integer that is too large for a float
        number, shown = math.inf, "a number beyond 1e308"
    if not math.isfinite(number):
        raise BadParameters(
            f"{path}: {where} is {shown or repr(given)}, expected a finite number in SI units"
        )
    return number


def _choice(path: Path, key: str, value: Any, names: Iterable[str]) -> str:
    names = list(names)
    if not isinstance(value, str) or value not in names:
        raise BadParameters(f"{path}: {key} is {value!r}, expected one of {', '.join(names)}")
    return value
