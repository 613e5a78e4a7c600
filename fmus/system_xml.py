"""The XML of System Structure and Parameterization: safe parsing, numbers, units and scalings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from ..solver.nearest import nearest
from .model_xml import BadXml, check_file

# Versions 1.0 and 2.0 have the same namespaces.
SSC, SSD, SSM, SSV = (
    "{http://ssp-standard.org/SSP1/SystemStructure" + part + "}"
    for part in ("Common", "Description", "ParameterMapping", "ParameterValues")
)
VERSIONS = ("1.0", "2.0")
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


class BadSystem(ValueError):
    """The file is not a system that can run here; the message says what is wrong with it."""


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
        """A unit from the attributes of its BaseUnit."""
        what = f"unit {name!r}"
        exponents = [
            number(base.get(key, "0"), f"the exponent of {key} of {what}") for key in BASE_UNITS
        ]
        factor = number(base.get("factor", "1"), f"the factor of {what}")
        if factor == 0:
            raise BadSystem(f"the factor of {what} is 0")
        return cls(
            name,
            tuple(round(e) for e in exponents),
            factor,
            number(base.get("offset", "0"), f"the offset of {what}"),
        )

    @property
    def is_plain(self) -> bool:
        """Whether its values are bare numbers."""
        return self.exponents == (0,) * len(BASE_UNITS) and (self.factor, self.offset) == (1, 0)

    def same_as(self, other: Unit) -> bool:
        """Whether both units have the same numbers; undefined units are compared by name."""
        if self.exponents is None or other.exponents is None:
            return self.name == other.name
        return self.exponents == other.exponents and conversion(self, other, "") == (1.0, 0.0)


@dataclass(frozen=True)
class Scaling:
    """Transformation of a connection or a mapping: target = factor * source + offset.

    Attributes
    ----------
    converts : bool
        Whether units are converted first.
    """

    factor: float = 1.0
    offset: float = 0.0
    converts: bool = True


@dataclass(frozen=True)
class Scaled:
    """A value in a chain: factor * (value at the start of the chain) + offset, in a unit."""

    factor: float
    offset: float
    unit: Unit | None

    def through(self, scaling: Scaling, unit: Unit | None, where: str) -> Scaled:
        """The value after the next link, in `unit`, or in the previous unit if that is None.

        Raises
        ------
        BadSystem
            If the units cannot be converted.
        """
        factor, offset, before = self.factor, self.offset, self.unit
        after = unit or (before if scaling.converts else None)
        if scaling.converts and before is not None and unit is not None:
            ratio, shift = conversion(before, unit, where)
            factor, offset = ratio * factor, ratio * offset + shift
        return Scaled(scaling.factor * factor, scaling.factor * offset + scaling.offset, after)


def conversion(before: Unit, after: Unit, where: str) -> tuple[float, float]:
    """Factor and offset from one unit to another.

    Raises
    ------
    BadSystem
        If they are of different quantities, or one of them is not defined.
    """
    for unit in (before, after):
        if unit.exponents is None and before.name != after.name:
            raise BadSystem(
                f"{where}: the unit {unit.name!r} is not defined, so {before.name!r} cannot be "
                f"converted to {after.name!r}"
            )
    if before.exponents is None or after.exponents is None:
        return 1.0, 0.0
    if before.exponents != after.exponents:
        raise BadSystem(
            f"{where}: {before.name!r} cannot be converted to {after.name!r}: they are units "
            "of different quantities"
        )
    shift = 0.0 if before.relative or after.relative else before.offset - after.offset
    return before.factor / after.factor, shift / after.factor


def parse(file: Path, tag: str) -> ET.Element:
    """The root element of a file, which must be `tag` in a supported version.

    Raises
    ------
    BadSystem
        If it cannot be read, is not XML, declares a document type, or has another root element.
    """
    try:
        check_file(file)
        root = ET.fromstring(file.read_bytes())
    except OSError as error:
        raise BadSystem(f"{file.name} cannot be read: {error.strerror or error}") from error
    except BadXml as error:
        raise BadSystem(str(error)) from error
    except (ET.ParseError, LookupError, ValueError) as error:
        raise BadSystem(f"{file.name} is no XML: {error}") from error
    check_root(root, tag, file.name)
    return root


def check_root(root: ET.Element, tag: str, where: str) -> None:
    """Check an element's name and the version that it gives.

    Raises
    ------
    BadSystem
    """
    if root.tag != tag:
        raise BadSystem(f"{where} is a {root.tag}, expected {tag}")
    version = root.get("version", "").strip()
    if version not in VERSIONS:
        raise BadSystem(
            f"{where} is SSP version {version or 'nothing'}, expected {' or '.join(VERSIONS)}"
        )


def number(text: str | None, what: str) -> float:
    """A finite number.

    Raises
    ------
    BadSystem
    """
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or "_" in str(text):
        raise BadSystem(f"{what} is {text!r}, expected a finite number")
    return value


def truth(text: str | None, what: str) -> bool:
    """An XML Boolean.

    Raises
    ------
    BadSystem
    """
    if text not in ("true", "false", "1", "0"):
        raise BadSystem(f"{what} is {text!r}, expected true or false")
    return text in ("true", "1")


def units_of(node: ET.Element | None) -> dict[str, Unit]:
    """The units that a Units element defines, by name."""
    units = {}
    for unit in node if node is not None else ():
        name, base = unit.get("name", ""), unit.find(SSC + "BaseUnit")
        if base is not None:
            units[name] = Unit.defined(name, dict(base.attrib))
    return units


def scaling_of(node: ET.Element, where: str) -> Scaling:
    """The transformation of a connection or of a mapping entry.

    Raises
    ------
    BadSystem
        If it is not linear.
    """
    converts = not truth(
        node.get("suppressUnitConversion", "false"), f"{where}: suppressUnitConversion"
    )
    for child in node:
        # by its local name: some tools write it in another namespace than the standard
        name = child.tag.rpartition("}")[2]
        if name == "LinearTransformation":
            factor = number(child.get("factor", "1"), f"{where}: the factor")
            offset = number(child.get("offset", "0"), f"{where}: the offset")
            return Scaling(factor, offset, converts)
        if name.endswith("Transformation"):
            raise BadSystem(f"{where} has a {name}; only a LinearTransformation is supported")
    return Scaling(1.0, 0.0, converts)


def plain_type(name: str) -> str:
    """A type of SSP 2.0 by the name that 1.0 has for it."""
    if name.startswith("Float"):
        return "Real"
    return "Integer" if name.startswith(("Int", "UInt")) else name


def near_or_all(name: str, names: Iterable[str]) -> str:
    """A hint that ends a message about an unknown name."""
    names = list(names)
    return nearest(name, names) or f"; there are {', '.join(sorted(names)[:20]) or 'none'}"
