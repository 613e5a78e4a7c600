"""Parts of a study file, read with one line on what is wrong."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from ...solver.nearest import nearest

LONGEST = 80  # characters of a value in a message


class BadPlan(ValueError):
    """An invalid study file; the message says what was got and what was expected."""


def as_table(where: str, given: Any) -> dict[str, Any]:
    """A table of the file. Raises `BadPlan`."""
    if not isinstance(given, dict):
        raise BadPlan(f"{where} is {_shown(given)}, expected a table")
    return dict(given)


def as_list(where: str, given: Any) -> list[Any]:
    """A list of the file. Raises `BadPlan`."""
    if not isinstance(given, list):
        raise BadPlan(f"{where} is {_shown(given)}, expected a list")
    return given


def as_flag(where: str, given: Any) -> bool:
    """True or false. Raises `BadPlan`."""
    if not isinstance(given, bool):
        raise BadPlan(f"{where} is {_shown(given)}, expected true or false")
    return given


def as_range(where: str, name: str, given: Any) -> tuple[float, float]:
    """Two finite numbers, the lower one first. Raises `BadPlan`."""
    pair = list(given) if isinstance(given, list | tuple) else []
    if len(pair) != 2 or not all(map(is_number, pair)):
        raise BadPlan(f"{where}: {name} is {_shown(given)}, expected two finite numbers")
    if not pair[0] < pair[1]:
        raise BadPlan(f"{where}: {name} is {given!r}, an empty range; give the lower bound first")
    return float(pair[0]), float(pair[1])


def as_numbers(
    where: str, given: Mapping[str, Any], whole: Mapping[str, tuple[int, int]]
) -> dict[str, Any]:
    """Finite numbers; those in `whole` are integers within these limits. Raises `BadPlan`."""
    found: dict[str, Any] = {}
    for name, value in given.items():
        if not is_number(value):
            raise BadPlan(f"{where}: {name} is {_shown(value)}, expected a finite number")
        least, most = whole.get(name, (-math.inf, math.inf))
        if name in whole and (value != int(value) or not least <= value <= most):
            raise BadPlan(
                f"{where}: {name} is {value!r}, expected a whole number, {least} to {most}"
            )
        found[name] = int(value) if name in whole else float(value)
    return found


def is_number(value: Any) -> bool:
    """Whether it is a finite number; an integer may have more digits than a float can hold."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and abs(value) <= sys.float_info.max


def _shown(given: Any) -> str:
    text = repr(given)
    return text if len(text) < LONGEST else f"{text[:LONGEST]}..."


def check_names(where: str, given: Mapping[str, Any], known: Sequence[str] | set[str]) -> None:
    """Make sure that all names are known. Raises `BadPlan`."""
    for name in given:
        if name not in known:
            hint = nearest(name, known)
            raise BadPlan(f"{where} has no {name!r}{hint}; it has {', '.join(sorted(known))}")
