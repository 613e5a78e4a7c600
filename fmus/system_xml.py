"""The XML of System Structure and Parameterization: parsing, numbers, units and scalings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from ..solver.errors import FmuError, nearest
from .archive import first_element, number
from .units import Unit, conversion

# Versions 1.0 and 2.0 have the same namespaces.
SSC, SSD, SSM, SSV = (
    "{http://ssp-standard.org/SSP1/SystemStructure" + part + "}"
    for part in ("Common", "Description", "ParameterMapping", "ParameterValues")
)
VERSIONS = ("1.0", "2.0")
FMU_TYPE = "application/x-fmu-sharedlibrary"


@dataclass(frozen=True)
class Scaling:
    """Transformation of a connection or a mapping: target = factor * source + offset."""

    factor: float = 1.0
    offset: float = 0.0
    converts: bool = True  # units, before


@dataclass(frozen=True)
class Scaled:
    """A value in a chain: factor * (value at the start of the chain) + offset, in a unit."""

    factor: float
    offset: float
    unit: Unit | None

    def through(self, scaling: Scaling, unit: Unit | None, where: str) -> Scaled:
        """The value after the next link, in `unit`, or in the previous unit if that is None.

        Raises `FmuError` if the units cannot be converted.
        """
        factor, offset, before = self.factor, self.offset, self.unit
        after = unit or (before if scaling.converts else None)
        if scaling.converts and before is not None and unit is not None:
            ratio, shift = conversion(before, unit, where)
            factor, offset = ratio * factor, ratio * offset + shift
        return Scaled(scaling.factor * factor, scaling.factor * offset + scaling.offset, after)


def parse(file: Path, tag: str) -> ET.Element:
    """The root element of a file, which must be `tag` in a supported version.

    Raises
    ------
    FmuError
        If it cannot be read, is not XML, declares a document type, or has another root element.
    """
    try:
        with file.open("rb") as stream:
            first_element(stream, file.stat().st_size, file.name)
        root = ET.fromstring(file.read_bytes())
    except OSError as error:
        raise FmuError(f"{file.name} cannot be read: {error.strerror or error}") from error
    except FmuError:
        raise
    except (ET.ParseError, LookupError, ValueError) as error:
        raise FmuError(f"{file.name} is no XML: {error}") from error
    check_root(root, tag, file.name)
    return root


def check_root(root: ET.Element, tag: str, where: str) -> None:
    """Check an element's name and the version that it gives; raises `FmuError`."""
    if root.tag != tag:
        raise FmuError(f"{where} is a {root.tag}, expected {tag}")
    version = root.get("version", "").strip()
    if version not in VERSIONS:
        raise FmuError(
            f"{where} is SSP version {version or 'nothing'}, expected {' or '.join(VERSIONS)}"
        )


def truth(text: str | None, what: str) -> bool:
    """An XML Boolean; raises `FmuError`."""
    if text not in ("true", "false", "1", "0"):
        raise FmuError(f"{what} is {text!r}, expected true or false")
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
    """The linear transformation of a connection or of a mapping entry; raises `FmuError`."""
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
            raise FmuError(f"{where} has a {name}; only a LinearTransformation is supported")
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
