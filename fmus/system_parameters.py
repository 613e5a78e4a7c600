"""The parameter bindings of an SSP system: values for variables of FMUs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from .archive import number
from .system_network import Element, Network, SystemPort, unit_in
from .system_xml import (
    SSD,
    SSM,
    SSV,
    BadSystem,
    Scaled,
    Scaling,
    check_root,
    parse,
    plain_type,
    scaling_of,
    truth,
    units_of,
)
from .units import Unit

_SET = "application/x-ssp-parameter-set"
_MAPPING = "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class _Parameter:
    """A value of a parameter set; text for a String, the item's name for an Enumeration."""

    name: str
    type: str
    value: float | str | None  # of a Binary
    unit: Unit | None


class Bindings:
    """The parameter sets of a system, resolved.

    Attributes
    ----------
    values : dict
        Start values of variables, by FMU.
    starts : dict
        Of the whole system's own inputs and parameters.
    ignored : list of str
        Names of unknown parameters.
    """

    def __init__(self, network: Network) -> None:
        self._network = network
        self.values: dict[str, dict[str, float | str]] = {
            path: {} for path, element in network.elements.items() if element.fmu
        }
        self.starts: dict[str, float] = {}
        self.ignored: list[str] = []
        for element, node in network.bindings:  # the last one has priority
            self._bind(element, node)

    def _bind(self, place: Element, node: ET.Element) -> None:
        where = f"a parameter binding of {place}"
        holder = node.find(SSD + "ParameterValues")
        root, source = self._document(node, holder, SSV + "ParameterSet", _SET, where)
        units = self._network.units | units_of(root.find(SSV + "Units"))
        prefix = node.get("prefix", "")
        parameters = [
            _parameter(entry, prefix, units, source)
            for entry in root.iterfind(f"{SSV}Parameters/{SSV}Parameter")
        ]
        for name, count in Counter(p.name for p in parameters).most_common(1):
            if count > 1:
                raise BadSystem(f"{source}: has two values for parameter {name!r}")
        mapping = node.find(SSD + "ParameterMapping")
        entries: list[ET.Element] = []
        if mapping is not None:
            found, _ = self._document(mapping, mapping, SSM + "ParameterMapping", _MAPPING, where)
            entries = list(found.iterfind(SSM + "MappingEntry"))
        named = {p.name for p in parameters}
        self.ignored += [
            f"{entry.get('source')} of a mapping of {place}"
            for entry in entries
            if entry.get("source") not in named
        ]
        for parameter in parameters:
            renamed = [e for e in entries if e.get("source") == parameter.name]
            for entry in renamed:
                scaling = scaling_of(entry, f"{source}: the mapping of {parameter.name!r}")
                self._set(place, entry.get("target", ""), parameter, scaling, source)
            # A mapping renames the listed names; the others are unchanged.
            if not renamed:
                self._set(place, parameter.name, parameter, Scaling(), source)

    def _document(
        self, node: ET.Element, holder: ET.Element | None, tag: str, kind: str, where: str
    ) -> tuple[ET.Element, str]:
        """A parameter set or mapping, from its own file or inline, and its name in messages."""
        if node.get("type", kind) != kind:
            raise BadSystem(f"{where} is of type {node.get('type')}, expected {kind}")
        if node.get("sourceBase", "SSD") != "SSD":
            raise BadSystem(f"{where} is inside an FMU (sourceBase), which is not supported")
        if node.get("source") is not None:
            file = self._network.file(node.get("source"), where)
            return parse(file, tag), file.name
        inner = next(iter(holder), None) if holder is not None else None
        if inner is None:
            raise BadSystem(f"{where} has neither a source nor a {tag.rpartition('}')[2]} in it")
        check_root(inner, tag, f"{where}: its content")
        return inner, where

    def _set(
        self,
        place: Element,
        name: str,
        parameter: _Parameter,
        scaling: Scaling,
        source: str,
    ) -> None:
        port = self._network.port(place, name)
        if port is None:
            within = f" in {place.path}" if place.path else ""
            self.ignored.append(f"{name}{within} ({source})")
            return
        where = f"{source}: parameter {parameter.name!r} for {port}"
        if parameter.value is None:
            raise BadSystem(
                f"{where} is a {parameter.type}; only numbers, truth values and texts can be set"
            )
        if isinstance(parameter.value, str) and not self._network.in_fmu(port):
            raise BadSystem(
                f"{where} is a {parameter.type}, which a connector of a system does not pass on; "
                "name the FMU's own parameter"
            )
        begun = Scaled(1.0, 0.0, parameter.unit)
        value = begun.through(scaling, self._network.connector(port).unit, where)
        for reached, scaled in self._reached(port, value):
            self._store(reached, parameter, scaled, where)

    def _reached(self, port: SystemPort, value: Scaled) -> Iterator[tuple[SystemPort, Scaled]]:
        """The ports that get a value set at this port, including itself."""
        yield port, value
        if not self._network.in_fmu(port):
            for target, edge in self._network.edges.items():
                if edge.source == port:
                    yield from self._reached(target, self._network.link(value, target))

    def _store(self, port: SystemPort, parameter: _Parameter, scaled: Scaled, where: str) -> None:
        assert parameter.value is not None
        exact = scaled.factor == 1.0 and scaled.offset == 0.0
        connector = self._network.connector(port)
        wanted = connector.type or parameter.type
        if wanted == "Real" and parameter.type in ("Real", "Integer"):
            text = repr(scaled.factor * float(parameter.value) + scaled.offset)
            value: float | str = number(text, where)
        elif wanted == parameter.type and exact:
            value = parameter.value
        else:
            raise BadSystem(
                f"{where} is a {parameter.type}{'' if exact else ', scaled'}, but {port} is a "
                f"{wanted}"
            )
        if self._network.in_fmu(port):
            self.values[port.element][port.connector] = value
        elif connector.kind not in ("input", "parameter"):
            raise BadSystem(f"{where} sets a system's {connector.kind}, which its FMUs compute")
        elif not port.element and not isinstance(value, str):
            self.starts[port.connector] = value


def _parameter(node: ET.Element, prefix: str, units: dict[str, Unit], source: str) -> _Parameter:
    name = prefix + node.get("name", "")
    what = f"{source}: parameter {name!r}"
    for child in node:
        kind, text = plain_type(child.tag.removeprefix(SSV)), child.get("value")
        value: float | str | None = None
        if kind in ("Real", "Integer"):
            value = number(text, what)
            if kind == "Integer":
                if not value.is_integer():
                    raise BadSystem(f"{what} is {text!r}, expected an integer")
                value = int(value)
        elif kind == "Boolean":
            value = truth(text, what)
        elif kind in ("String", "Enumeration") and text is not None:
            value = text
        elif kind != "Binary":
            continue
        return _Parameter(name, kind, value, unit_in(child, units) if kind == "Real" else None)
    raise BadSystem(f"{what} has no value")
