"""Read an .ssp (System Structure and Parameterization) of any origin into plain data.

Nested systems are flattened: connections are followed through them to the ports of the FMUs, units
are converted, and parameter sets are assigned to variables.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from ..solver.errors import FmuError
from . import system_xml
from .archive import LARGEST_OF_ALL, number, unpack_archive, unpacked_size
from .system_network import Element, Network, SystemConnection, SystemOutput, SystemPort, unit_in
from .system_xml import SSD, SSM, SSV, Scaled, Scaling, parse, plain_type, units_of
from .units import Unit

DESCRIPTION = "SystemStructure.ssd"
_SET = "application/x-ssp-parameter-set"
_MAPPING = "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class SystemElement:
    """One FMU of the system."""

    name: str  # of the enclosing systems and its own, joined with dots
    fmu: Path  # in the folder of the unpacked system
    # from parameter sets, in the variables' units: a float for a Real, an int for an Integer, a
    # bool for a Boolean, a str for a String and for the name of an Enumeration's item
    start_values: dict[str, float | str]


@dataclass(frozen=True)
class SystemInput:
    """An input of the whole system; in `drives` the element of the source is the empty string."""

    name: str
    unit: str  # empty if the system gives none
    start: float | None  # from parameter sets, in its own unit
    drives: tuple[SystemConnection, ...]
    defined: Unit | None = None  # that unit, if the system defines it


@dataclass(frozen=True)
class SystemStructure:
    """A system; `remove` deletes the folder it was unpacked to.

    Attributes
    ----------
    path : Path
        The file it was read from.
    elements, connections : tuple
        FMUs, and the signals between them; each port is driven at most once.
    inputs, outputs : tuple
        Of the system as a whole.
    start, stop : float
        [s] The default experiment; `stop` is None if it gives none.
    ignored : tuple of str
        Unknown parameters. The standard says to ignore them, since one set may be
        for several systems; they are reported, since a name may be misspelt.
    """

    path: Path
    name: str
    folder: Path
    elements: tuple[SystemElement, ...]
    connections: tuple[SystemConnection, ...]
    inputs: tuple[SystemInput, ...]
    outputs: tuple[SystemOutput, ...]
    start: float
    stop: float | None
    ignored: tuple[str, ...]

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)


def read_system(path: Path | str) -> SystemStructure:
    """Check, unpack and read an .ssp, SSP 1.0 or 2.0.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    SystemStructure
        Call `remove` at the end.

    Raises
    ------
    FmuError
        If the file is missing, is no .ssp, contains a path outside its folder, is inconsistent,
        or needs something that is not supported; the message says which.
    """
    path = Path(path)
    folder = None
    try:
        folder = unpack_archive(path)
        return _read(path, folder)
    except BaseException as error:
        if folder:
            shutil.rmtree(folder, ignore_errors=True)
        if not isinstance(error, FmuError):
            raise
        # names in the file may hold line breaks
        raise FmuError(f"{path}: {' '.join(str(error).split())}") from error


def _read(path: Path, folder: Path) -> SystemStructure:
    if not (folder / DESCRIPTION).is_file():
        raise FmuError(f"holds no {DESCRIPTION}, so it is not an .ssp")
    root = parse(folder / DESCRIPTION, SSD + "SystemStructureDescription")
    system = root.find(SSD + "System")
    if system is None:
        raise FmuError(f"{DESCRIPTION} holds no System")
    start, stop = _experiment(root.find(SSD + "DefaultExperiment"))
    network = Network(folder, units_of(root.find(SSD + "Units")))
    top = network.add_system(system)
    network.check_rings()
    connections, outputs = network.signals()
    bindings = Bindings(network)
    elements = tuple(
        SystemElement(element.path, element.fmu, bindings.values[element.path])
        for element in network.elements.values()
        if element.fmu
    )
    if not elements:
        raise FmuError(f"{DESCRIPTION} holds no component")
    size = sum(unpacked_size(e.fmu) for e in elements)  # each element has a folder of its own
    if size > LARGEST_OF_ALL:
        raise FmuError(
            f"its FMUs would unpack to {size / 1024**3:.1f} GiB, expected at most "
            f"{LARGEST_OF_ALL / 1024**3:.0f} GiB"
        )
    inputs = []
    for name, unit in ((n, c.unit) for n, c in top.connectors.items() if c.kind == "input"):
        drives = tuple(c for c in connections if c.source == SystemPort("", name))
        value = bindings.starts.get(name)
        inputs.append(SystemInput(name, unit.name if unit else "", value, drives, unit))
    return SystemStructure(
        path=path,
        name=root.get("name") or system.get("name") or path.stem,
        folder=folder,
        elements=elements,
        connections=tuple(c for c in connections if c.source.element),
        inputs=tuple(inputs),
        outputs=outputs,
        start=start,
        stop=stop,
        ignored=tuple(bindings.ignored),
    )


def _experiment(node: ET.Element | None) -> tuple[float, float | None]:
    if node is None:
        return 0.0, None
    start = number(node.get("startTime", "0"), "the start time")
    if node.get("stopTime") is None:
        return start, None
    stop = number(node.get("stopTime"), "the stop time")
    if stop <= start:
        raise FmuError(f"the stop time {stop:g} s is not after the start time {start:g} s")
    return start, stop


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
                raise FmuError(f"{source}: has two values for parameter {name!r}")
        entries: list[ET.Element] = []
        for mapping in node.findall(SSD + "ParameterMapping")[:1]:
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
                scaling = system_xml.scaling_of(
                    entry, f"{source}: the mapping of {parameter.name!r}"
                )
                self._set(place, entry.get("target", ""), parameter, scaling, source)
            # A mapping renames the listed names; the others are unchanged.
            if not renamed:
                self._set(place, parameter.name, parameter, Scaling(), source)

    def _document(
        self, node: ET.Element, holder: ET.Element | None, tag: str, kind: str, where: str
    ) -> tuple[ET.Element, str]:
        """A parameter set or mapping, from its own file or inline, and its name in messages."""
        if node.get("type", kind) != kind:
            raise FmuError(f"{where} is of type {node.get('type')}, expected {kind}")
        if node.get("sourceBase", "SSD") != "SSD":
            raise FmuError(f"{where} is inside an FMU (sourceBase), which is not supported")
        if node.get("source") is not None:
            file = self._network.file(node.get("source"), where)
            return parse(file, tag), file.name
        inner = next(iter(holder), None) if holder is not None else None
        if inner is None:
            raise FmuError(f"{where} has neither a source nor a {tag.rpartition('}')[2]} in it")
        system_xml.check_root(inner, tag, f"{where}: its content")
        return inner, where

    def _set(
        self, place: Element, name: str, parameter: _Parameter, scaling: Scaling, source: str
    ) -> None:
        port = self._network.port(place, name)
        if port is None:
            within = f" in {place.path}" if place.path else ""
            self.ignored.append(f"{name}{within} ({source})")
            return
        where = f"{source}: parameter {parameter.name!r} for {port}"
        if parameter.value is None:
            raise FmuError(
                f"{where} is a {parameter.type}; only numbers, truth values and texts can be set"
            )
        if isinstance(parameter.value, str) and not self._network.in_fmu(port):
            raise FmuError(
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
            raise FmuError(
                f"{where} is a {parameter.type}{'' if exact else ', scaled'}, but {port} is a "
                f"{wanted}"
            )
        if self._network.in_fmu(port):
            self.values[port.element][port.connector] = value
        elif connector.kind not in ("input", "parameter"):
            raise FmuError(f"{where} sets a system's {connector.kind}, which its FMUs compute")
        elif not port.element and not isinstance(value, str):
            self.starts[port.connector] = value


def _parameter(node: ET.Element, prefix: str, units: dict[str, Unit], source: str) -> _Parameter:
    name = prefix + node.get("name", "")
    what = f"{source}: parameter {name!r}"
    for child in node:
        kind, text = plain_type(child.tag.removeprefix(SSV)), child.get("value")
        value: float | str | None = None
        if kind == "Real":
            value = number(text, what)
        elif kind == "Integer":
            value = int(number(text, what))
            if value != number(text, what):
                raise FmuError(f"{what} is {text!r}, expected an integer")
        elif kind == "Boolean":
            value = system_xml.truth(text, what)
        elif kind in ("String", "Enumeration") and text is not None:
            value = text
        elif kind != "Binary":
            continue
        return _Parameter(name, kind, value, unit_in(child, units) if kind == "Real" else None)
    raise FmuError(f"{what} has no value")
