"""Tables of a TOML file, read value by value: an error is one line with the place."""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from ...solver.errors import nearest

LONGEST = 80  # characters of a value in a message


class BadTable(ValueError):
    """A value of a TOML file is invalid; the message says what was got and what was expected.

    All functions of this module raise it.
    """


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BadTable(f"cannot be read: {error.strerror or error}") from error
    except RecursionError:
        raise BadTable("is not a TOML file: it is nested too deeply") from None
    except ValueError as error:  # of TOML, of UTF-8, or an integer of too many digits
        raise BadTable(f"is not a TOML file: {error}") from error


def as_table(where: str, given: Any) -> dict[str, Any]:
    """A copy of a table."""
    if not isinstance(given, dict):
        raise BadTable(f"{where} is {_shown(given)}, expected a table")
    return dict(given)


def as_list(where: str, given: Any) -> list[Any]:
    if not isinstance(given, list):
        raise BadTable(f"{where} is {_shown(given)}, expected a list")
    return given


def as_flag(where: str, given: Any) -> bool:
    if not isinstance(given, bool):
        raise BadTable(f"{where} is {_shown(given)}, expected true or false")
    return given


def as_choice(where: str, given: Any, names: Iterable[str]) -> str:
    """One of these names."""
    names = list(names)
    if not isinstance(given, str) or given not in names:
        raise BadTable(f"{where} is {given!r}, expected one of {', '.join(names)}")
    return given


def is_number(value: Any) -> bool:
    """Whether it is a finite number; an integer may have more digits than a float can hold."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and abs(value) <= sys.float_info.max


def as_finite(where: str, given: Any) -> float:
    """A finite number."""
    if not is_number(given):
        large = type(given) is int
        shown = "a number beyond 1e308" if large else _shown(given)
        raise BadTable(f"{where} is {shown}, expected a finite number in SI units")
    return float(given)


def as_range(where: str, name: str, given: Any) -> tuple[float, float]:
    """Two finite numbers, the lower one first."""
    pair = list(given) if isinstance(given, list | tuple) else []
    if len(pair) != 2 or not all(map(is_number, pair)):
        raise BadTable(f"{where}: {name} is {_shown(given)}, expected two finite numbers")
    if not pair[0] < pair[1]:
        raise BadTable(f"{where}: {name} is {given!r}, an empty range; give the lower bound first")
    return float(pair[0]), float(pair[1])


def as_numbers(
    where: str, given: Any, whole: Mapping[str, tuple[int, int]] | None = None
) -> dict[str, Any]:
    """A table of finite numbers; those in `whole` are integers within these limits."""
    found: dict[str, Any] = {}
    for name, value in as_table(where, given).items():
        number = as_finite(f"{where}: {name}", value)
        least, most = (whole or {}).get(name, (-math.inf, math.inf))
        is_whole = name in (whole or {})
        if is_whole and (value != int(value) or not least <= value <= most):
            raise BadTable(
                f"{where}: {name} is {value!r}, expected a whole number, {least} to {most}"
            )
        found[name] = int(value) if is_whole else number
    return found


def check_names(where: str, given: Iterable[str], known: Collection[str]) -> None:
    """Make sure that all names are known."""
    for name in given:
        if name not in known:
            hint = nearest(name, known)
            raise BadTable(f"{where} has no {name!r}{hint}; it has {', '.join(sorted(known))}")


def _shown(given: Any) -> str:
    text = repr(given)
    return text if len(text) < LONGEST else f"{text[:LONGEST]}..."
