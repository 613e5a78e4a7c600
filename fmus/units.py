"""Units: strings such as ``N*s/m`` or ``V/(m/s)``, definitions by FMI's base units, conversion."""

from __future__ import annotations

import ast
import re
import warnings
from collections import Counter
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from ..solver.errors import FmuError
from .archive import number

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_SI: dict[str, dict[str, int]] = {
    "1": {},
    **{base: {base: 1} for base in BASE_UNITS if base not in ("mol", "cd")},
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
_ALLOWED = re.compile(r"[A-Za-z0-9*/^() -]{0,100}")


@dataclass(frozen=True)
class Unit:
    """A unit: base value = factor * value + offset; `exponents` is None if it is not defined.

    The offset is not for differences of two values, which are `relative`.
    """

    name: str
    exponents: tuple[int, ...] | None
    factor: float = 1.0
    offset: float = 0.0
    relative: bool = False

    @classmethod
    def defined(cls, name: str, base: dict[str, str]) -> Unit:
        """A unit from the attributes of its BaseUnit; raises `FmuError`."""
        what = f"unit {name!r}"
        exponents = (number(base.get(n, "0"), f"the exponent of {n} of {what}") for n in BASE_UNITS)
        powers = tuple(round(e) for e in exponents)
        factor = number(base.get("factor", "1"), f"the factor of {what}")
        if factor == 0:
            raise FmuError(f"the factor of {what} is 0")
        return cls(name, powers, factor, number(base.get("offset", "0"), f"the offset of {what}"))

    @classmethod
    def named(cls, name: str) -> Unit:
        """A unit that is not defined in base units, by its name, also in Modelica spelling."""
        powers = re.sub(r"(?<=[A-Za-z])(-?\d)", r"^\1", name).replace(".", "*")
        try:
            exponents = base_exponents(powers)
        except FmuError:
            return cls(name, None)
        return cls(name, tuple(exponents.get(base, 0) for base in BASE_UNITS))

    @property
    def is_plain(self) -> bool:
        """Whether its values are bare numbers."""
        return self.exponents == (0,) * len(BASE_UNITS) and (self.factor, self.offset) == (1, 0)

    def same_as(self, other: Unit) -> bool:
        """Whether both units have the same numbers; undefined units are compared by name."""
        if self.exponents is None or other.exponents is None:
            return self.name == other.name
        return self.exponents == other.exponents and conversion(self, other, "") == (1.0, 0.0)


def conversion(before: Unit, after: Unit, where: str) -> tuple[float, float]:
    """Factor and offset from one unit to another.

    Raises
    ------
    FmuError
        If they are of different quantities, or one of them is not defined.
    """
    for unit in (before, after):
        if unit.exponents is None and before.name != after.name:
            raise FmuError(
                f"{where}: the unit {unit.name!r} is not defined, so {before.name!r} cannot be "
                f"converted to {after.name!r}"
            )
    if before.exponents is None or after.exponents is None:
        return 1.0, 0.0
    if before.exponents != after.exponents:
        raise FmuError(
            f"{where}: {before.name!r} cannot be converted to {after.name!r}: they are units "
            "of different quantities"
        )
    shift = 0.0 if before.relative or after.relative else before.offset - after.offset
    return before.factor / after.factor, shift / after.factor


def base_exponents(unit: str) -> dict[str, int]:
    """Exponents of the SI base units (and rad) of a unit string; zero ones left out.

    Raises
    ------
    FmuError
        If the string does not parse or names an unknown unit.
    """
    if not _ALLOWED.fullmatch(unit):
        raise FmuError(f"unit {unit!r} has characters that are not allowed in a unit")
    try:  # the syntax is that of Python, but for the sign of powers
        with warnings.catch_warnings(action="ignore"):
            tree = ast.parse(unit.strip().replace("^", "**"), mode="eval")
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise FmuError(
            f"unit {unit!r} has a syntax error; expected a product as N*s/m^2"
        ) from error
    return {base: power for base, power in _powers(unit, tree.body).items() if power}


def _powers(unit: str, node: ast.expr) -> Counter[str]:
    match node:
        case ast.Constant(value=1):
            return Counter()
        case ast.Name(id=name) if name in _SI:
            return Counter(_SI[name])
        case ast.Name(id=name):
            raise FmuError(f"unit {unit!r}: {name!r} is not known; known are {', '.join(_SI)}")
        case ast.BinOp(left=base, op=ast.Pow(), right=exponent):
            text = ast.unparse(exponent)
            if not re.fullmatch(r"-?\d{1,3}", text):
                raise FmuError(f"unit {unit!r} has the exponent {text}, expected an integer")
            return Counter({n: p * int(text) for n, p in _powers(unit, base).items()})
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div() as sign, right=right):
            found = _powers(unit, left)
            join = found.update if isinstance(sign, ast.Mult) else found.subtract
            join(_powers(unit, right))
            return found
    raise FmuError(f"unit {unit!r} is no product of units and whole powers, such as N*s/m^2")


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
