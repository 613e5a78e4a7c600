"""Unit strings such as ``N*s/m`` or ``V/(m/s)`` to the exponents of FMI's base units."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

_SI: dict[str, dict[str, int]] = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "K": {"K": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
}
DISPLAYED = {"m": {"mm": 1e3, "um": 1e6}, "m/s": {"mm/s": 1e3}}
"""Factors of display units: displayed value = factor * value."""
_SMALL = 1e-4  # [m] lengths with a smaller nominal value are displayed in micrometres
TYPES = {
    "Position": ("Length", "m", "mm"),
    "Deflection": ("Length", "m", "um"),
    "Velocity": ("Velocity", "m/s", "mm/s"),
}
"""Quantity, unit and display unit of each declared type."""


class BadUnit(ValueError):
    """A unit that cannot be read; the message quotes it."""


_TOKEN = re.compile(r"\s*([A-Za-z]+|\d+|[*/^()]|-)")


def base_exponents(unit: str) -> dict[str, int]:
    """Exponents of the SI base units (and rad) of a unit string; zero ones left out.

    Raises
    ------
    BadUnit
        If the string does not parse or names an unknown unit.
    """
    tokens = _TOKEN.findall(unit)
    if "".join(tokens) != unit.replace(" ", ""):
        raise BadUnit(f"unit {unit!r} has characters that are not allowed in a unit")
    result = _product(unit, tokens)
    if tokens:
        raise BadUnit(f"unit {unit!r} has a syntax error at {tokens[0]!r}")
    return {base: power for base, power in result.items() if power}


def type_of(unit: str, nominal: float) -> str:
    """The declared type of a variable; empty if it needs none."""
    if unit == "m":
        return "Deflection" if nominal < _SMALL else "Position"
    return "Velocity" if unit == "m/s" else ""


def write_units(parent: ET.Element, names: set[str]) -> None:
    """Definitions of units by base units, with their display units."""
    for name in sorted(names):
        unit = ET.SubElement(parent, "Unit", name=name)
        powers = {base: str(power) for base, power in base_exponents(name).items()}
        ET.SubElement(unit, "BaseUnit", powers)
        for shown, factor in DISPLAYED.get(name, {}).items():
            ET.SubElement(unit, "DisplayUnit", name=shown, factor=repr(factor))


def _product(unit: str, tokens: list[str]) -> dict[str, int]:
    result: dict[str, int] = {}
    sign = 1
    while True:
        for base, power in _factor(unit, tokens).items():
            result[base] = result.get(base, 0) + sign * power
        if not tokens or tokens[0] not in "*/":
            return result
        sign = 1 if tokens.pop(0) == "*" else -1


def _factor(unit: str, tokens: list[str]) -> dict[str, int]:
    if not tokens:
        raise BadUnit(f"unit {unit!r} ends too early")
    head = tokens.pop(0)
    if head == "(":
        inner = _product(unit, tokens)
        if not tokens or tokens.pop(0) != ")":
            raise BadUnit(f"unit {unit!r} lacks a closing bracket")
    elif head in _SI:
        inner = dict(_SI[head])
    else:
        raise BadUnit(f"unit {unit!r}: {head!r} is not known; known are {', '.join(_SI)}")
    if tokens and tokens[0] == "^":
        tokens.pop(0)
        sign = -1 if tokens and tokens[0] == "-" else 1
        if sign < 0:
            tokens.pop(0)
        if not tokens or not tokens[0].isdigit():
            raise BadUnit(f"unit {unit!r} has an exponent that is no integer")
        power = sign * int(tokens.pop(0))
        return {base: p * power for base, p in inner.items()}
    return inner
