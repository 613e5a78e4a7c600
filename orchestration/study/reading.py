"""Parts of a study file, read with one line on what is wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ...solver.nearest import nearest


class BadPlan(ValueError):
    """An invalid study file; the message says what was got and what was expected."""


def as_table(where: str, given: Any) -> dict[str, Any]:
    """A table of the file. Raises `BadPlan`."""
    if not isinstance(given, dict):
        raise BadPlan(f"{where} is {given!r}, expected a table")
    return dict(given)


def as_list(where: str, given: Any) -> list[Any]:
    """A list of the file. Raises `BadPlan`."""
    if not isinstance(given, list):
        raise BadPlan(f"{where} is {given!r}, expected a list")
    return given


def as_range(where: str, name: str, given: Any) -> tuple[float, float]:
    """Two finite numbers, the lower one first. Raises `BadPlan`."""
    pair = list(given) if isinstance(given, list | tuple) else []
    numbers = [float(v) for v in pair if isinstance(v, int | float) and math.isfinite(v)]
    if len(pair) != 2 or len(numbers) != 2:
        raise BadPlan(f"{where}: {name} is {given!r}, expected two finite numbers")
    if not numbers[0] < numbers[1]:
        raise BadPlan(f"{where}: {name} is {given!r}, an empty range; give the lower bound first")
    return numbers[0], numbers[1]


def as_numbers(where: str, given: Mapping[str, Any], whole: Mapping[str, int]) -> dict[str, Any]:
    """Finite numbers; those in `whole` are integers with this lower bound. Raises `BadPlan`."""
    found: dict[str, Any] = {}
    for name, value in given.items():
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if not plain or not math.isfinite(value):
            raise BadPlan(f"{where}: {name} is {value!r}, expected a finite number")
        if name in whole and (value != int(value) or value < whole[name]):
            raise BadPlan(f"{where}: {name} is {value!r}, expected a whole number >= {whole[name]}")
        found[name] = int(value) if name in whole else float(value)
    return found


def check_names(where: str, given: Mapping[str, Any], known: Sequence[str] | set[str]) -> None:
    """Make sure that all names are known. Raises `BadPlan`."""
    for name in given:
        if name not in known:
            hint = nearest(name, known)
            raise BadPlan(f"{where} has no {name!r}{hint}; it has {', '.join(sorted(known))}")
