"""The elements and connections of an SSP system, flattened: source of each port, and conversion."""

from __future__ import annotations

import posixpath
import zipfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree as ET

from .model_xml import check_archive, check_lines
from .reading import attributes_of, defined_units, is_relative, unit_name
from .system_xml import (
    SSC,
    SSD,
    BadSystem,
    Scaled,
    Scaling,
    Unit,
    near_or_all,
    plain_type,
    scaling_of,
)

DEEPEST = 2  # levels of systems within the system

_FMU = "application/x-fmu-sharedlibrary"


@dataclass(frozen=True)
class SystemPort:
    """A variable of an element."""

    element: str
    connector: str

    def __str__(self) -> str:
        return f"{self.element}.{self.connector}" if self.element else self.connector


@dataclass(frozen=True)
class SystemConnection:
    """Target = factor * source + offset, unit conversion included."""

    source: SystemPort
    target: SystemPort
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class SystemOutput:
    """A connected output of the whole system; the target's element is empty."""

    name: str
    unit: str
    driven_by: SystemConnection


@dataclass(frozen=True)
class Connector:
    """Data of a connector; `type` is empty and `unit` is None if not given."""

    kind: str
    type: str
    unit: Unit | None


@dataclass(frozen=True)
class Component:
    """An FMU of the system: its connectors, its own variables, and other names of these."""

    path: str
    node: ET.Element
    fmu: Path
    connectors: dict[str, Connector]
    variables: dict[str, Connector]
    aliases: dict[str, str]


@dataclass(frozen=True)
class System:
    """The whole system, whose path is empty, or a system within it."""

    path: str
    node: ET.Element
    connectors: dict[str, Connector]
    children: dict[str, Component | System] = field(default_factory=dict)


@dataclass(frozen=True)
class Edge:
    """A link of a chain of connections, in the direction of the data flow."""

    source: SystemPort
    scaling: Scaling
    where: str


class Network:
    """All elements and connections of a system.

    Attributes
    ----------
    places : dict
        Components and systems by path; the whole system's path is the empty string.
    edges : dict
        Links by the port that they drive.
    """

    def __init__(self, folder: Path, units: dict[str, Unit]) -> None:
        self.folder = folder
        self.units = units
        self.places: dict[str, Component | System] = {}
        self.edges: dict[SystemPort, Edge] = {}  # by target
        self._read_fmus: dict[Path, tuple[dict[str, Connector], dict[str, str]]] = {}

    def add_system(self, node: ET.Element, path: str, levels: int = DEEPEST) -> System:
        """Add a system, its elements and their connections; return it."""
        if levels < 0:
            raise BadSystem(
                f"system {path!r} lies {DEEPEST + 1} levels deep, expected at most {DEEPEST}; move "
                "its elements up"
            )
        system = System(path, node, self._connectors(node, path))
        self.places[path] = system
        elements = node.find(SSD + "Elements")
        for child in elements if elements is not None else ():
            kind = child.tag.rpartition("}")[2]
            name = child.get("name", "")
            below = f"{path}.{name}" if path else name
            if not name:
                raise BadSystem(f"a {kind} of {called(path)} has no name")
            check_lines([name])
            if name in system.children or below in self.places:
                raise BadSystem(f"two elements are called {below!r}")
            if child.tag == SSD + "System":
                system.children[name] = self.add_system(child, below, levels - 1)
            elif child.tag == SSD + "Component":
                system.children[name] = self._component(child, below)
            else:
                raise BadSystem(
                    f"element {below!r} is a {kind}; only components and systems are supported"
                )
        for k, connection in enumerate(node.iterfind(f"{SSD}Connections/{SSD}Connection"), 1):
            self._connect(system, connection, f"connection {k} of {called(path)}")
        return system

    def _component(self, node: ET.Element, path: str) -> Component:
        where = f"element {path!r}"
        kind = node.get("type") or _FMU
        if kind != _FMU:
            raise BadSystem(f"{where} is of type {kind}; only FMUs ({_FMU}) are supported")
        fmu = self.file(node.get("source"), where)
        if fmu not in self._read_fmus:
            self._read_fmus[fmu] = _variables(fmu, where)
        variables, aliases = self._read_fmus[fmu]
        own = {aliases.get(n, n): c for n, c in self._connectors(node, path).items()}
        component = Component(path, node, fmu, own, variables, aliases)
        self.places[path] = component
        return component

    def _connectors(self, node: ET.Element, path: str) -> dict[str, Connector]:
        connectors: dict[str, Connector] = {}
        for entry in node.iterfind(f"{SSD}Connectors/{SSD}Connector"):
            name, kind, unit = entry.get("name", ""), "", None
            if name in connectors:
                raise BadSystem(f"{called(path)} has two connectors {name!r}")
            for child in entry:
                if child.tag == SSC + "Dimension":
                    raise BadSystem(
                        f"{SystemPort(path, name)} is an array; only scalars are supported"
                    )
                if child.tag.startswith(SSC):
                    kind = plain_type(child.tag.removeprefix(SSC))
                    unit = unit_in(child, self.units)
            connectors[name] = Connector(entry.get("kind", ""), kind, unit)
        return connectors

    def file(self, source: str | None, where: str) -> Path:
        """The file in the archive that a URI names."""
        if not source:
            raise BadSystem(f"{where} has no source")
        try:
            uri = urlsplit(source)
        except ValueError as error:
            raise BadSystem(f"{where} has the source {source!r}, which is no URI") from error
        name = posixpath.normpath(unquote(uri.path).replace("\\", "/"))
        inside = not (uri.scheme or uri.netloc or name.startswith(("/", "..")) or "\0" in name)
        if not inside or name == ".":
            raise BadSystem(f"{where} has the source {source!r}, expected a file in the archive")
        file = self.folder / name
        if not file.is_file():
            present = [
                p.relative_to(self.folder).as_posix() for p in self.folder.rglob("*") if p.is_file()
            ]
            raise BadSystem(
                f"{where} has the source {source!r}, which is not in the archive"
                f"{near_or_all(name, present)}"
            )
        return file

    def _connect(self, system: System, node: ET.Element, where: str) -> None:
        ends = [
            (
                self._port(system, node.get(f"{end}Element"), node.get(f"{end}Connector"), where),
                not node.get(f"{end}Element"),
            )
            for end in ("start", "end")
        ]
        if node.get("startIndices") or node.get("endIndices"):
            raise BadSystem(f"{where} is between parts of arrays; only scalars are supported")
        (first, _), (second, _) = ends
        flows = [self._gives(port, own, where) for port, own in ends]
        if flows[0] == flows[1]:
            raise BadSystem(
                f"{where} joins {first} and {second}, which "
                f"{'both give' if flows[0] else 'both take'} a value"
            )
        # The start and end in the standard do not give the direction; the kinds of the connectors
        # do.
        source, target = (first, second) if flows[0] else (second, first)
        edge = Edge(source, scaling_of(node, where), f"{where}, {source} to {target}")
        if target in self.edges:
            raise BadSystem(
                f"{target} is driven twice, by {self.edges[target].source} and {source}"
            )
        self.edges[target] = edge

    def _port(
        self, system: System, element: str | None, connector: str | None, where: str
    ) -> SystemPort:
        if not connector:
            raise BadSystem(f"{where} lacks a connector's name")
        place: Component | System = system
        if element:
            if element not in system.children:
                raise BadSystem(
                    f"{where} names the element {element!r}, which does not exist"
                    f"{near_or_all(element, system.children)}"
                )
            place = system.children[element]
        known = set(place.connectors)
        if isinstance(place, Component):
            known |= set(place.variables)
            connector = place.aliases.get(connector, connector)
        if connector not in known:
            raise BadSystem(
                f"{where} names the connector {connector!r} of {called(place.path)}, which does "
                f"not exist{near_or_all(connector, known)}"
            )
        return SystemPort(place.path, connector)

    def connector(self, port: SystemPort) -> Connector:
        """Data of a port; missing data of a connector come from the FMU's own description."""
        place = self.places[port.element]
        if isinstance(place, System):
            return place.connectors[port.connector]
        variable = place.variables.get(port.connector)
        if variable is None:
            raise BadSystem(
                f"{port} is a connector, but {place.fmu.name} has no such variable"
                f"{near_or_all(port.connector, place.variables)}"
            )
        said = place.connectors.get(port.connector, variable)
        for what, ours, theirs in (
            ("kind", said.kind, variable.kind),
            ("type", said.type or variable.type, variable.type),
        ):
            if ours != theirs:
                raise BadSystem(
                    f"{port} is of {what} {ours}, but in {place.fmu.name} it is {theirs}"
                )
        if said.unit and variable.unit and not said.unit.same_as(variable.unit):
            raise BadSystem(
                f"{port} is in {said.unit.name!r}, but in {place.fmu.name} it is in "
                f"{variable.unit.name!r}, which is a different unit"
            )
        unit = said.unit or variable.unit
        if unit and variable.unit and variable.unit.relative:
            unit = replace(unit, relative=True)
        return Connector(variable.kind, variable.type, unit)

    def _gives(self, port: SystemPort, own: bool, where: str) -> bool:
        """Whether a connector is a source of a connection; `own`: of the system, from inside."""
        kind = self.connector(port).kind
        if kind not in ("input", "output", "parameter", "calculatedParameter"):
            raise BadSystem(
                f"{where} joins {port} of kind {kind or 'nothing'}; expected an input, output or "
                "parameter"
            )
        return (kind in ("output", "calculatedParameter")) != own

    def check_rings(self) -> None:
        """Reject connections that form a ring through connectors of systems."""
        for target in self.edges:
            port, passed = target, set()
            while port in self.edges and isinstance(self.places[port.element], System):
                if port in passed:
                    raise BadSystem(f"the connections through {port} form a ring without an FMU")
                passed.add(port)
                port = self.edges[port].source

    def signals(self) -> tuple[list[SystemConnection], tuple[SystemOutput, ...]]:
        """Connections into FMUs, those from the system's inputs included, and the outputs."""
        connections, outputs = [], []
        for target in self.edges:
            place = self.places[target.element]
            inside = isinstance(place, System) and place.path
            if inside or self.connector(target).kind == "calculatedParameter":
                continue
            connection = self._traced(target)
            if connection is None:
                continue
            if place.path:
                connections.append(connection)
            elif connection.source.element:
                unit = self.connector(target).unit
                outputs.append(
                    SystemOutput(target.connector, unit.name if unit else "", connection)
                )
            else:
                raise BadSystem(
                    f"the system's output {target} is its input {connection.source}; they cannot "
                    "be connected directly"
                )
        return connections, tuple(outputs)

    def _traced(self, target: SystemPort) -> SystemConnection | None:
        """The whole chain to a port; None if it has no source or is for a parameter."""
        chain, port = [], target
        while port in self.edges:
            chain.append(port)
            port = self.edges[port].source
            if isinstance(self.places[port.element], Component):
                break
        source, ends = port, (self.connector(port), self.connector(target))
        if isinstance(self.places[source.element], System) and (
            source.element or ends[0].kind != "input"
        ):
            return None
        kinds = {c.kind for c in ends}
        if not kinds <= {"input", "output"}:
            raise BadSystem(
                f"{self.edges[target].where}: {source} is of kind {ends[0].kind} and {target} of "
                f"kind {ends[1].kind}; only outputs and inputs can be connected while a system runs"
            )
        for end, connector in zip((source, target), ends, strict=True):
            if connector.type not in ("Real", "Integer", "Boolean", "Enumeration", ""):
                raise BadSystem(
                    f"{self.edges[target].where}: {end} is of type {connector.type}; only numbers "
                    "and truth values are signals here"
                )
        signal = Scaled(1.0, 0.0, ends[0].unit)
        for port in reversed(chain):
            signal = self.link(signal, port)
        return SystemConnection(source, target, signal.factor, signal.offset)

    def link(self, signal: Scaled, target: SystemPort) -> Scaled:
        """A value at a port, after the last connection of its chain."""
        edge = self.edges[target]
        return signal.through(edge.scaling, self.connector(target).unit, edge.where)


def unit_in(node: ET.Element, units: dict[str, Unit]) -> Unit | None:
    """The unit that an element names."""
    name = node.get("unit")
    return units.get(name, Unit(name, None)) if name else None


def _variables(fmu: Path, where: str) -> tuple[dict[str, Connector], dict[str, str]]:
    """Variables of an FMU as connectors, by name; and these names by their aliases."""
    from fmpy import read_model_description

    try:
        with fmu.open("rb") as stream:  # which the parser does not close if it is not a zip file
            check_archive(stream)
            read: Any = read_model_description(stream, validate=False)
            with zipfile.ZipFile(stream) as archive, archive.open("modelDescription.xml") as text:
                told = attributes_of(text)
    except Exception as error:  # the parser raises many kinds
        reason = str(error) or type(error).__name__
        raise BadSystem(f"{where}: {fmu.name} is not an FMU that can be read: {reason}") from error
    if not str(read.fmiVersion).startswith(("2.", "3.")):
        raise BadSystem(f"{where}: {fmu.name} is FMI {read.fmiVersion}, expected FMI 2.0 or 3.0")
    units = {name: Unit.defined(name, base) for name, base in defined_units(read).items()}

    def unit_of(variable: Any) -> Unit | None:
        if not (name := unit_name(variable)):
            return None
        return replace(units.get(name, Unit(name, None)), relative=is_relative(variable, told))

    variables = {
        v.name: Connector(str(v.causality), plain_type(str(v.type)), unit_of(v))
        for v in read.modelVariables
        if v.alias is None
    }
    return variables, {v.name: v.alias.name for v in read.modelVariables if v.alias is not None}


def called(path: str) -> str:
    """An element's name in a message."""
    return repr(path) if path else "the system"
