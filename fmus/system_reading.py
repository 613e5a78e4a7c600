"""Read an .ssp (System Structure and Parameterization) of any origin into plain data.

Nested systems are flattened: connections are followed through them to the ports of the FMUs, units
are converted, and parameter sets are assigned to variables.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from .archive import LARGEST_OF_ALL, BadArchive, BadXml, number, unpack_archive, unpacked_size
from .system_network import Network, SystemConnection, SystemOutput, SystemPort
from .system_parameters import Bindings
from .system_xml import SSD, BadSystem, parse, units_of
from .units import BadUnit, Unit

__all__ = [
    "BadSystem",
    "SystemConnection",
    "SystemElement",
    "SystemInput",
    "SystemOutput",
    "SystemPort",
    "SystemStructure",
    "read_system",
]

DESCRIPTION = "SystemStructure.ssd"


@dataclass(frozen=True)
class SystemElement:
    """One FMU of the system.

    Attributes
    ----------
    name : str
        Names of the enclosing systems and its own, joined with dots.
    fmu : Path
        The file, in the folder of the unpacked system.
    start_values : dict of str to float
        Values of its variables from parameter sets, in the variables' units: a float for a Real, an
        int for an Integer, a bool for a Boolean, a str for a String and for the name of an
        Enumeration's item.
    """

    name: str
    fmu: Path
    start_values: dict[str, float | str]


@dataclass(frozen=True)
class SystemInput:
    """An input of the whole system; in `drives` the element of the source is the empty string.

    Attributes
    ----------
    unit : str
        Empty if the system gives none.
    start : float, optional
        Its value from parameter sets, in its own unit.
    defined : Unit, optional
        Definition of that unit, if the system has one.
    """

    name: str
    unit: str
    start: float | None
    drives: tuple[SystemConnection, ...]
    defined: Unit | None = None


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
    BadSystem
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
        if not isinstance(error, BadArchive | BadSystem | BadUnit | BadXml):
            raise
        # names in the file may hold line breaks
        raise BadSystem(f"{path}: {' '.join(str(error).split())}") from error


def _read(path: Path, folder: Path) -> SystemStructure:
    if not (folder / DESCRIPTION).is_file():
        raise BadSystem(f"holds no {DESCRIPTION}, so it is not an .ssp")
    root = parse(folder / DESCRIPTION, SSD + "SystemStructureDescription")
    system = root.find(SSD + "System")
    if system is None:
        raise BadSystem(f"{DESCRIPTION} holds no System")
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
        raise BadSystem(f"{DESCRIPTION} holds no component")
    size = sum(unpacked_size(e.fmu) for e in elements)  # each element has a folder of its own
    if size > LARGEST_OF_ALL:
        raise BadSystem(
            f"its FMUs would unpack to {size / 1024**3:.1f} GiB, expected at most "
            f"{LARGEST_OF_ALL / 1024**3:.0f} GiB"
        )
    inputs = tuple(
        SystemInput(
            name,
            connector.unit.name if connector.unit else "",
            bindings.starts.get(name),
            tuple(c for c in connections if c.source == SystemPort("", name)),
            connector.unit,
        )
        for name, connector in top.connectors.items()
        if connector.kind == "input"
    )
    return SystemStructure(
        path=path,
        name=root.get("name") or system.get("name") or path.stem,
        folder=folder,
        elements=elements,
        connections=tuple(c for c in connections if c.source.element),
        inputs=inputs,
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
        raise BadSystem(f"the stop time {stop:g} s is not after the start time {start:g} s")
    return start, stop
