"""Read a parameter file: every line is checked, and errors name their place."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from ...plant import LAWS
from ...solver.errors import BadParameters
from . import toml_tables as toml
from .parameter_file import (
    BALL_SCREW,
    COMMANDS,
    COMMANDS_OF,
    DRIVE,
    FORMAT,
    KINDS,
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


def read_parameters(path: Path | str) -> ParameterFile:
    """Read a parameter file; the names of parameters are checked where they are used.

    Raises `BadParameters`, in one line: what cannot be used and why.
    """
    path = Path(path)
    try:
        return _read(path, toml.read_toml(path))
    except (toml.BadTable, BadParameters) as error:
        raise BadParameters(f"{path}: {error}") from error


def _read(path: Path, data: dict[str, Any]) -> ParameterFile:
    known_name("", data, _KEYS)
    if data.get("format", FORMAT) != FORMAT:
        raise toml.BadTable(f"format is {data['format']!r}, expected {FORMAT!r}")
    kind = toml.as_choice("kind", data.get("kind", BALL_SCREW), KINDS)
    reasons = toml.as_table("[not_identified]", data.get("not_identified", {}))
    return ParameterFile(
        path,
        kind,
        toml.as_choice("law", data["law"], LAWS) if "law" in data else "",
        _values("plant", data.get("plant", {})),
        _values("found", data.get("found", {})),
        _groups("controller", data.get("controller", {})),
        _groups("rig", data.get("rig", {})),
        toml.as_numbers("[tolerance]", data.get("tolerance", {})),
        {name: str(reason) for name, reason in reasons.items()},
        _diagnosed(data["diagnosis"]) if "diagnosis" in data else None,
        _command(kind, data["command"]) if "command" in data else "",
    )


def _command(kind: str, given: Any) -> str:
    if kind not in COMMANDS_OF:
        raise toml.BadTable(
            f"has the key command, and a plant of the kind {kind!r} has its own; remove it, or set "
            f"kind to one of {', '.join(COMMANDS_OF)}"
        )
    command = toml.as_choice("command", given, COMMANDS_OF[kind])
    return "" if command == COMMANDS[0] else command


def _groups(key: str, given: Any) -> dict[str, Values]:
    groups = toml.as_table(f"[{key}]", given)
    return {name: _values(f"{key}.{name}", values) for name, values in groups.items()}


def _values(table: str, given: Any) -> dict[str, Value]:
    found = toml.as_table(f"[{table}]", given)
    return {name: _value(f"[{table}] {name}", value) for name, value in found.items()}


def _diagnosed(given: Any) -> Diagnosed:
    table = toml.as_table("[diagnosis]", given)
    known_name("[diagnosis]", table, _DIAGNOSIS_KEYS)
    missing = [key for key in _DIAGNOSIS_KEYS if key not in table]
    if missing:
        raise toml.BadTable(f"[diagnosis] has no {missing[0]!r}; diagnose writes this key")
    records = toml.as_list("[diagnosis] records", table["records"])
    if not all(isinstance(name, str) for name in records):
        raise toml.BadTable(f"[diagnosis] records is {records!r}, expected a list of names")
    causes = toml.as_table("[diagnosis.causes]", table["causes"])
    return Diagnosed(
        tuple(records),
        toml.as_choice("[diagnosis] command", table["command"], COMMANDS_OF[DRIVE]),
        toml.as_finite("[diagnosis] command_shift", table["command_shift"]),
        toml.as_choice("[diagnosis] law", table["law"], LAWS),
        toml.as_numbers("[diagnosis.prior]", table["prior"]),
        toml.as_numbers("[diagnosis.adjusted]", table["adjusted"]),
        {n: toml.as_numbers(f"[diagnosis.causes.{n}]", values) for n, values in causes.items()},
    )


def _value(where: str, given: Any) -> Value:
    if not isinstance(given, dict):
        return Value(toml.as_finite(where, given))
    known_name(f"{where}:", given, _VALUE_KEYS)
    if "value" not in given:
        raise toml.BadTable(f"{where} has no value; write {where.split()[-1]}.value = ...")
    value = toml.as_finite(where, given["value"])
    for key in ("unit", "source"):
        if not isinstance(given.get(key, ""), str):
            raise toml.BadTable(f"{where}: {key} is {given[key]!r}, expected a text")
    interval = given.get("interval")
    if interval is not None:
        interval = _interval(where, interval, value)
    return Value(value, given.get("unit", ""), interval, given.get("source", ""))


def _interval(where: str, given: Any, value: float) -> tuple[float, float]:
    """Its ends may be infinite."""
    pair: list[Any] = given if isinstance(given, list) and len(given) == 2 else [None]
    numbers = all(isinstance(end, float) or toml.is_number(end) for end in pair)
    if not numbers or not pair[0] <= value <= pair[1]:
        raise toml.BadTable(
            f"{where}: the interval is not of the form [low, high] with the value {value:g} "
            "between them"
        )
    return float(pair[0]), float(pair[1])
