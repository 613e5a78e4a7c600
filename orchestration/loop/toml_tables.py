"""Tables of a TOML file, read value by value: an error is one line with the place.

All functions raise `BadParameters`.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from ...solver.errors import BadParameters, did_you_mean

Reader: TypeAlias = Callable[[str, Any], Any]
"""Reads a value; the text is its place, for messages."""
LONGEST = 80  # characters of a value in a message


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BadParameters(f"cannot be read: {error.strerror or error}") from error
    except RecursionError:
        raise BadParameters("is not a TOML file: it is nested too deeply") from None
    except ValueError as error:  # of TOML, of UTF-8, or an integer of too many digits
        raise BadParameters(f"is not a TOML file: {error}") from error


def as_table(where: str, given: Any) -> dict[str, Any]:
    """A copy of a table."""
    return dict(_as(dict, "a table", where, given))


def as_list(where: str, given: Any) -> list[Any]:
    return list(_as(list, "a list", where, given))


def as_flag(where: str, given: Any) -> bool:
    return bool(_as(bool, "true or false", where, given))


def _as(kind: type, called: str, where: str, given: Any) -> Any:
    if not isinstance(given, kind):
        raise BadParameters(f"{where} is {_shown(given)}, expected {called}")
    return given


def as_text(where: str, given: Any) -> str:
    return str(_as(str, "a text", where, given))


def as_texts(where: str, given: Any) -> tuple[str, ...]:
    return tuple(as_text(where, name) for name in as_list(where, given))


def as_choice(where: str, given: Any, names: Iterable[str]) -> str:
    """One of these names."""
    names = list(names)
    if not isinstance(given, str) or given not in names:
        raise BadParameters(f"{where} is {given!r}, expected one of {', '.join(names)}")
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
        raise BadParameters(f"{where} is {shown}, expected a finite number in SI units")
    return float(given)


def as_range(where: str, name: str, given: Any) -> tuple[float, float]:
    """Two finite numbers, the lower one first."""
    pair = list(given) if isinstance(given, list | tuple) else []
    if len(pair) != 2 or not all(map(is_number, pair)):
        raise BadParameters(f"{where}: {name} is {_shown(given)}, expected two finite numbers")
    if not pair[0] < pair[1]:
        raise BadParameters(
            f"{where}: {name} is {given!r}, an empty range; give the lower bound first"
        )
    return float(pair[0]), float(pair[1])


def as_numbers(where: str, given: Any) -> dict[str, float]:
    """A table of finite numbers."""
    return {n: as_finite(f"{where}: {n}", v) for n, v in as_table(where, given).items()}


def as_whole(least: int, most: int) -> Reader:
    """The reader of a whole number within limits."""

    def read(where: str, given: Any) -> int:
        number = as_finite(where, given)
        if number != int(number) or not least <= number <= most:
            raise BadParameters(f"{where} is {given!r}, expected a whole number, {least} to {most}")
        return int(given)

    return read


def check_names(where: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Make sure that all names are known."""
    known = list(known)
    for name in given:
        if name not in known:
            hint = did_you_mean(name, known) or f"; there are {', '.join(known)}"
            raise BadParameters(f"{where} there is no {name!r}{hint}".lstrip())


def as_record(
    where: str, given: Any, readers: Mapping[str, Reader], *required: str
) -> dict[str, Any]:
    """A table with known keys, each value read by its reader; `required` are there."""
    table = as_table(where, given)
    check_names(where, table, readers)
    for name in required:
        if name not in table:
            raise BadParameters(f"{where} has no {name}")
    return {name: readers[name](f"{where} {name}".lstrip(), v) for name, v in table.items()}


def _shown(given: Any) -> str:
    text = repr(given)
    return text if len(text) < LONGEST else f"{text[:LONGEST]}..."
