"""The elements and connections of an SSP system, flattened: source of each port, and conversion."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass, field, replace
from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree as ET

from ..solver.errors import FmuError
from .archive import check_lines
from .reading import Description, describe
from .system_xml import FMU_TYPE, SSC, SSD, Scaled, Scaling, near_or_all, plain_type, scaling_of
from .units import Unit

DEEPEST = 2  # levels of systems within the system

_SIGNALS = ("Real", "Integer", "Boolean", "Enumeration", "")


@dataclass(frozen=True)
class SystemPort:
    """A variable of an element; the element of the whole system is the empty string."""

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
class Element:
    """The whole system, a system within it, or an FMU."""

    path: str  # empty: the whole system
    node: ET.Element
    connectors: dict[str, Connector]  # as the system describes them
    variables: dict[str, Connector]  # as the FMU does; of a system its connectors
    fmu: Path | None = None
    aliases: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        return repr(self.path) if self.path else "the system"

    def port(self, name: str) -> SystemPort | None:
        name = self.aliases.get(name, name)
        return SystemPort(self.path, name) if name in self.variables else None


@dataclass(frozen=True)
class Edge:
    """A link of a chain of connections, in the direction of the data flow."""

    source: SystemPort
    scaling: Scaling
    where: str


class Network:
    """All elements and connections of a system, found in one walk.

    Attributes
    ----------
    elements : dict
        By path.
    bindings : list of (Element, XML element)
        Of parameters, those of inner elements first.
    edges : dict
        Links by the port that they drive.
    """

    def __init__(self, folder: Path, units: dict[str, Unit]) -> None:
        self.folder = folder
        self.units = units
        self.elements: dict[str, Element] = {}
        self.bindings: list[tuple[Element, ET.Element]] = []
        self.edges: dict[SystemPort, Edge] = {}
        self._described: dict[Path, Description] = {}

    def add_system(self, node: ET.Element, path: str = "", level: int = 0) -> Element:
        """Add a system, its elements and their connections; return it."""
        if level > DEEPEST:
            raise FmuError(
                f"system {path!r} lies {level} levels deep, expected at most {DEEPEST}; move its "
                "elements up"
            )
        connectors = self._connectors(node, path)
        system = self.elements[path] = Element(path, node, connectors, connectors)
        for child in node.iterfind(f"{SSD}Elements/*"):
            kind = child.tag.rpartition("}")[2]
            name = child.get("name", "")
            below = _joined(path, name)
            if not name:
                raise FmuError(f"a {kind} of {system} has no name")
            check_lines([name])
            if below in self.elements:
                raise FmuError(f"two elements are called {below!r}")
            if child.tag == SSD + "System":
                self.add_system(child, below, level + 1)
            elif child.tag == SSD + "Component":
                self._add_fmu(child, below)
            else:
                raise FmuError(
                    f"element {below!r} is a {kind}; only components and systems are supported"
                )
        for k, connection in enumerate(node.iterfind(f"{SSD}Connections/{SSD}Connection"), 1):
            self._connect(system, connection, f"connection {k} of {system}")
        self._bind(system)
        return system

    def _add_fmu(self, node: ET.Element, path: str) -> None:
        where = f"element {path!r}"
        kind = node.get("type") or FMU_TYPE
        if kind != FMU_TYPE:
            raise FmuError(f"{where} is of type {kind}; only FMUs ({FMU_TYPE}) are supported")
        fmu = self.file(node.get("source"), where)
        if fmu not in self._described:
            try:
                self._described[fmu], _ = describe(fmu)
            except FmuError as error:
                raise FmuError(f"{where}: {fmu.name}: {error}") from error
        read = self._described[fmu]
        variables = {
            v.name: Connector(v.causality, plain_type(v.type), read.unit(v.name))
            for v in read.variables
        }
        variables |= {name: Connector("parameter", "String", None) for name in read.strings}
        given = self._connectors(node, path)
        own = {read.aliases.get(name, name): c for name, c in given.items()}
        self.elements[path] = Element(path, node, own, variables, fmu, read.aliases)
        self._bind(self.elements[path])

    def _bind(self, element: Element) -> None:
        found = element.node.iterfind(f"{SSD}ParameterBindings/{SSD}ParameterBinding")
        self.bindings += [(element, node) for node in found]

    def _connectors(self, node: ET.Element, path: str) -> dict[str, Connector]:
        connectors: dict[str, Connector] = {}
        for entry in node.iterfind(f"{SSD}Connectors/{SSD}Connector"):
            name, kind, unit = entry.get("name", ""), "", None
            port = SystemPort(path, name)
            if name in connectors:
                raise FmuError(f"there are two connectors {port}")
            for child in entry:
                if child.tag == SSC + "Dimension":
                    raise FmuError(f"{port} is an array; only scalars are supported")
                if child.tag.startswith(SSC):
                    kind = plain_type(child.tag.removeprefix(SSC))
                    unit = unit_in(child, self.units)
            connectors[name] = Connector(entry.get("kind", ""), kind, unit)
        return connectors

    def file(self, source: str | None, where: str) -> Path:
        """The file in the archive that a URI names."""
        if not source:
            raise FmuError(f"{where} has no source")
        try:
            uri = urlsplit(source)
        except ValueError as error:
            raise FmuError(f"{where} has the source {source!r}, which is no URI") from error
        name = posixpath.normpath(unquote(uri.path).replace("\\", "/"))
        inside = not (uri.scheme or uri.netloc or name.startswith(("/", "..")) or "\0" in name)
        if not inside or name == ".":
            raise FmuError(f"{where} has the source {source!r}, expected a file in the archive")
        file = self.folder / name
        if not file.is_file():
            files = (p for p in self.folder.rglob("*") if p.is_file())
            hint = near_or_all(name, (p.relative_to(self.folder).as_posix() for p in files))
            raise FmuError(f"{where} has the source {source!r}, which is not in the archive{hint}")
        return file

    def _connect(self, system: Element, node: ET.Element, where: str) -> None:
        first, second = (self._end(system, node, end, where) for end in ("start", "end"))
        if node.get("startIndices") or node.get("endIndices"):
            raise FmuError(f"{where} is between parts of arrays; only scalars are supported")
        gives = self._gives(system, first, where)
        if gives == self._gives(system, second, where):
            raise FmuError(
                f"{where} joins {first} and {second}, which "
                f"{'both give' if gives else 'both take'} a value"
            )
        # not start and end, but the kinds of the connectors give the direction in the standard
        source, target = (first, second) if gives else (second, first)
        edge = Edge(source, scaling_of(node, where), f"{where}, {source} to {target}")
        if target in self.edges:
            raise FmuError(f"{target} is driven twice, by {self.edges[target].source} and {source}")
        self.edges[target] = edge

    def _end(self, system: Element, node: ET.Element, end: str, where: str) -> SystemPort:
        name, connector = node.get(f"{end}Element"), node.get(f"{end}Connector")
        if not connector:
            raise FmuError(f"{where} lacks a connector's name")
        element = self.elements.get(_joined(system.path, name)) if name else system
        if element is None:
            inside = (p for p in self.elements if p.startswith(_joined(system.path, "")))
            children = [p.removeprefix(_joined(system.path, "")) for p in inside]
            raise FmuError(
                f"{where} names the element {name!r}, which does not exist"
                f"{near_or_all(str(name), children)}"
            )
        port = element.port(connector)
        if port is None:
            raise FmuError(
                f"{where} names the connector {connector!r} of {element}, which does not exist or "
                f"is no number{near_or_all(connector, element.variables)}"
            )
        return port

    def port(self, element: Element, name: str) -> SystemPort | None:
        """The port of a hierarchical name, seen from an element; None if there is none."""
        words = name.split(".")
        for k in range(len(words)):
            place = self.elements.get(_joined(element.path, *words[:k]))
            port = place.port(".".join(words[k:])) if place else None
            if port:
                return port
        return None

    def in_fmu(self, port: SystemPort) -> bool:
        """Whether it is a variable of an FMU, not a connector of a system."""
        return self.elements[port.element].fmu is not None

    def connector(self, port: SystemPort) -> Connector:
        """Data of a port; missing data of a connector come from the FMU's own description."""
        element = self.elements[port.element]
        variable = element.variables[port.connector]
        said = element.connectors.get(port.connector, variable)
        fmu = element.fmu.name if element.fmu else ""
        kinds = {"kind": (said.kind, variable.kind), "type": (said.type, variable.type)}
        for what, (ours, theirs) in kinds.items():
            if ours != theirs and (ours or what == "kind"):
                raise FmuError(f"{port} is of {what} {ours}, but in {fmu} it is {theirs}")
        if said.unit and variable.unit and not said.unit.same_as(variable.unit):
            raise FmuError(
                f"{port} is in {said.unit.name!r}, but in {fmu} it is in {variable.unit.name!r}, "
                "which is a different unit"
            )
        unit = said.unit or variable.unit
        if unit and variable.unit and variable.unit.relative:
            unit = replace(unit, relative=True)
        return Connector(variable.kind, variable.type, unit)

    def _gives(self, system: Element, port: SystemPort, where: str) -> bool:
        """Whether a port is a source of a connection inside a system."""
        kind = self.connector(port).kind
        if kind not in ("input", "output", "parameter", "calculatedParameter"):
            raise FmuError(
                f"{where} joins {port} of kind {kind or 'nothing'}; expected an input, output or "
                "parameter"
            )
        return (kind in ("output", "calculatedParameter")) != (port.element == system.path)

    def check_rings(self) -> None:
        """Reject connections that form a ring through connectors of systems."""
        for target in self.edges:
            port, passed = target, set()
            while port in self.edges and not self.in_fmu(port):
                if port in passed:
                    raise FmuError(f"the connections through {port} form a ring without an FMU")
                passed.add(port)
                port = self.edges[port].source

    def signals(self) -> tuple[list[SystemConnection], tuple[SystemOutput, ...]]:
        """Connections into FMUs, those from the system's inputs included, and the outputs."""
        connections, outputs = [], []
        for target in self.edges:
            inside = target.element and not self.in_fmu(target)
            if inside or self.connector(target).kind == "calculatedParameter":
                continue
            connection = self._traced(target)
            if connection is None:
                continue
            if target.element:
                connections.append(connection)
            elif connection.source.element:
                unit = self.connector(target).unit
                name = unit.name if unit else ""
                outputs.append(SystemOutput(target.connector, name, connection))
            else:
                raise FmuError(
                    f"the system's output {target} is its input {connection.source}; they cannot "
                    "be connected directly"
                )
        return connections, tuple(outputs)

    def _traced(self, target: SystemPort) -> SystemConnection | None:
        """The whole chain to a port; None if it has no source or is for a parameter."""
        chain, source = [], target
        while source in self.edges and (source == target or not self.in_fmu(source)):
            chain.append(source)
            source = self.edges[source].source
        ends = self.connector(source), self.connector(target)
        if not self.in_fmu(source) and (source.element or ends[0].kind != "input"):
            return None
        where = self.edges[target].where
        if not {c.kind for c in ends} <= {"input", "output"}:
            raise FmuError(
                f"{where}: {source} is of kind {ends[0].kind} and {target} of kind {ends[1].kind}; "
                "only outputs and inputs can be connected while a system runs"
            )
        for end, connector in zip((source, target), ends, strict=True):
            if connector.type not in _SIGNALS:
                raise FmuError(
                    f"{where}: {end} is of type {connector.type}; only numbers and truth values "
                    "are signals here"
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


def _joined(*names: str) -> str:
    return ".".join(names[not names[0] :])
