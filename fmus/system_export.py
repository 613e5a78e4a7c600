"""Write a closed loop of FMUs as one .ssp (System Structure and Parameterization).

FMUs of FMI 2.0 make an SSP 1.0; if one has FMI 3.0 it is an SSP 2.0, which has the same
namespaces and elements.

Instruments may be connected between plant and controller. Both sides have their feedback-law
ports, so that any master that connects signals runs the loop with an error of second order. An
annotation names the master of OMSimulator: its executable aborts without one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from ..solver.errors import FmuError
from ..solver.files import write_atomically
from ..solver.kernel import DEFAULT_TOLERANCE
from ..solver.signals import DERIVATIVES, MEASURED, START_VALUE
from .archive import pack, xml_text
from .description import TOOL
from .ports import gain_port, rate_port, reference_port
from .reading import NumberVariable, read_description
from .system_xml import FMU_TYPE, SSC, SSD, SSV
from .units import BASE_UNITS

PLANT, CONTROLLER = "plant", "controller"
# The same name for the sets of both sides: masters that choose a set by name then find both.
PARAMETERS = "parameters"
SAMPLE_TIME = "sample_time"  # name of the period in sampled parts
MASTER_STEP = 2e-4  # s; accuracy of OMSimulator's master with this step: iol 3e-6 m, nctf 6e-6 m

_OMSIMULATOR = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
_SPACES = {"ssc": SSC, "ssd": SSD, "ssv": SSV}
_NAMESPACES = {p: space.strip("{}") for p, space in _SPACES.items()} | {"oms": _OMSIMULATOR}

_Port = tuple[str, str]  # element, connector
_Connection = tuple[_Port, _Port]  # from, to
_Units = dict[str, dict[str, str]]  # attributes of each unit's BaseUnit


@dataclass(frozen=True)
class _Side:
    """One element: the variables that can be connectors, their units, and the FMU's bytes."""

    name: str
    path: Path
    fmu: bytes
    variables: dict[str, NumberVariable]
    units: _Units
    fmi: int

    def names(self, causality: str) -> list[str]:
        return [n for n, v in self.variables.items() if v.causality == causality]

    def listed(self, causality: str) -> str:
        return ", ".join(self.names(causality)) or "none"


def export_system(
    plant: Path | str,
    controller: Path | str,
    path: Path | str,
    *,
    name: str,
    instruments: Mapping[str, Path | str] | None = None,
    setpoint: float = START_VALUE,
    stop: float = 20.0,
) -> Path:
    """Write a closed loop of FMUs as one .ssp, the same bytes for the same FMUs.

    Ports of the same name are connected: the plant's outputs to the controller's inputs, and
    the controller's outputs, with law ports, to the plant's inputs. An instrument's ``x_measured``
    replaces ``x`` for the instruments after it and for the controller. SSP has no element for the
    step size of a master: OMSimulator finds `MASTER_STEP` in its annotation, other masters
    need a setting.

    Parameters
    ----------
    plant, controller : path-like
        FMUs for co-simulation; they become the elements ``plant`` and ``controller``.
    path : path-like
        The .ssp to write; replaced as a whole or not at all.
    name : str
        Name of the system.
    instruments : mapping of str to path-like, optional
        FMUs by the names of their elements, in their order. With a sampled controller,
        sampled instruments get its period.
    setpoint : float
        [m] Start of every input of the controller that the plant does not drive.
    stop : float
        [s] End of the default experiment, which starts at zero.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    FmuError
        If a file is no FMU, the parts cannot be connected, or a name or a number is invalid.
    OSError
        If the file cannot be written.
    """
    path = Path(path)
    if not math.isfinite(setpoint):
        raise FmuError(f"the set-point is {setpoint}, expected a finite number")
    if not (math.isfinite(stop) and stop > 0):
        raise FmuError(f"the stop time is {stop} s, expected a positive number")
    if clash := {PLANT, CONTROLLER} & set(instruments or {}):
        raise FmuError(f"an instrument is called {clash.pop()!r}, expected another name")
    between = [_side(n, fmu) for n, fmu in (instruments or {}).items()]
    first, last = _side(PLANT, plant), _side(CONTROLLER, controller)
    sides = (first, *between, last)
    connections = _connections(first, between, last)
    driven = {port for _, (element, port) in connections if element == CONTROLLER}
    references = [n for n in last.names("input") if n not in driven]
    goals = {n: 0.0 if n in DERIVATIVES else setpoint for n in references}
    version = "2.0" if any(side.fmi == 3 for side in sides) else "1.0"
    files = {"SystemStructure.ssd": _structure(name, version, sides, connections, stop)}
    for side in sides:
        values = goals if side is last else _period(side, last)
        files[f"resources/{side.name}.fmu"] = side.fmu
        files[f"resources/{side.name}.ssv"] = _parameter_set(side, version, values)
    write_atomically(path, pack(files))
    return path


def _side(name: str, path: Path | str) -> _Side:
    description = read_description(path)
    # An Integer, a Boolean or a String is not a signal of this loop, and SSP needs
    # connectors only for connections.
    variables = {
        v.name: v
        for v in description.variables
        if v.is_real and v.causality in ("input", "output", "parameter")
    }
    used = {v.unit for v in variables.values()}
    units = {unit: _base_unit(given) for unit, given in description.units.items() if unit in used}
    return _Side(name, Path(path), Path(path).read_bytes(), variables, units, description.fmi)


def _base_unit(given: dict[str, str]) -> dict[str, str]:
    """The attributes of a BaseUnit that are not at their defaults, each written in one way."""
    base = {key: str(power) for key in BASE_UNITS if (power := int(given.get(key) or 0))}
    for key, neutral in (("factor", 1.0), ("offset", 0.0)):
        value = float(given.get(key) or neutral)
        if value != neutral:
            base[key] = repr(value)
    return base


def _period(side: _Side, controller: _Side) -> dict[str, float]:
    """The controller's sampling period for another sampled part."""
    sampled = all(SAMPLE_TIME in s.variables for s in (side, controller))
    period = controller.variables[SAMPLE_TIME].start if sampled else None
    return {} if period is None else {SAMPLE_TIME: period}


def _signals(
    plant: _Side, instruments: Sequence[_Side]
) -> tuple[dict[str, _Port], list[_Connection]]:
    """Source of each signal after all instruments, and the sources of the instruments."""
    connections: list[_Connection] = []
    signals = {n: (PLANT, n) for n in plant.names("output")}
    for side in instruments:
        for n in side.names("input"):
            if n not in signals:
                raise FmuError(
                    f"nothing is connected to the input {n!r} of {side.path}: {plant.path} has "
                    f"the outputs {plant.listed('output')}"
                )
            connections.append((signals[n], (side.name, n)))
        for n in side.names("output"):
            if not n.endswith(MEASURED):
                raise FmuError(
                    f"{side.path}: its output {n!r} does not say what it measures; expected the "
                    f"name of a signal and {MEASURED!r}"
                )
            signals[n.removesuffix(MEASURED)] = (side.name, n)
    return signals, connections


def _connections(
    plant: _Side, instruments: Sequence[_Side], controller: _Side
) -> list[_Connection]:
    """Connections, see `export_system`; gains only together with their references."""
    signals, connections = _signals(plant, instruments)
    measured = [n for n in signals if n in controller.names("input")]
    connections += [(signals[n], (CONTROLLER, n)) for n in measured]
    shared = [n for n in controller.names("output") if n in plant.names("input")]
    law, alone = {rate_port(n) for n in plant.names("input")}, set()
    for command in plant.names("input"):
        for signal in plant.names("output"):
            pair = {gain_port(command, signal), reference_port(command, signal)}
            law |= pair
            # A gain without its reference signals would be multiplied by the whole signal, and
            # after an instrument the references differ from the plant's signals.
            if not pair <= set(shared) or signals[signal][0] != PLANT:
                alone |= pair
    commands = [n for n in shared if n not in alone]
    if not measured:
        raise FmuError(
            f"{controller.path.name}: its inputs do not fit the outputs of {plant.path.name}: its "
            f"inputs are {controller.listed('input')}, the plant's outputs are "
            f"{plant.listed('output')}"
        )
    for side in instruments:
        if all(source[0] != side.name for source, _ in connections):
            raise FmuError(
                f"nothing is connected to the outputs {side.listed('output')} of {side.path}; "
                f"{controller.path} has the inputs {controller.listed('input')}"
            )
    for name in plant.names("input"):
        if name not in law and name not in commands:
            raise FmuError(
                f"nothing is connected to the input {name!r} of {plant.path.name}: "
                f"{controller.path.name} has the outputs {controller.listed('output')}"
            )
    return connections + [((CONTROLLER, n), (PLANT, n)) for n in commands]


def _structure(
    name: str, version: str, sides: Sequence[_Side], connections: list[_Connection], stop: float
) -> bytes:
    root = _root("ssd:SystemStructureDescription", version, name, "ssd", "ssc", "oms")
    # No connectors of the system itself: libcosim and ecos reject a connection without an
    # element's name at both ends. Parameter sets per element: they do not read those of the system.
    system = ET.SubElement(root, "ssd:System", name=name)
    elements = ET.SubElement(system, "ssd:Elements")
    for side in sides:
        _write_component(elements, side)
    listed = ET.SubElement(system, "ssd:Connections")
    for (source, output), (target, given) in connections:
        start = {"startElement": source, "startConnector": output}
        ET.SubElement(listed, "ssd:Connection", start, endElement=target, endConnector=given)
    _write_master(system)
    _write_units(root, "ssd:Units", _all_units(sides))
    ET.SubElement(root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(float(stop)))
    return xml_text(root)


def _write_master(system: ET.Element) -> None:
    """OMSimulator's own annotation: its plain master with its step, and the FMUs' tolerance."""
    annotations = ET.SubElement(system, "ssd:Annotations")
    annotation = ET.SubElement(annotations, "ssc:Annotation", type="org.openmodelica")
    inner = ET.SubElement(annotation, "oms:Annotations")
    information = ET.SubElement(inner, "oms:SimulationInformation")
    accuracy = {"stepSize": repr(MASTER_STEP), "relativeTolerance": repr(DEFAULT_TOLERANCE)}
    ET.SubElement(information, "oms:FixedStepMaster", {"description": "oms-ma", **accuracy})


def _write_component(parent: ET.Element, side: _Side) -> None:
    about = {"name": side.name, "type": FMU_TYPE, "source": f"resources/{side.name}.fmu"}
    component = ET.SubElement(parent, "ssd:Component", about, implementation="CoSimulation")
    connectors = ET.SubElement(component, "ssd:Connectors")
    for kind in ("input", "output", "parameter"):
        for name in side.names(kind):
            connector = ET.SubElement(connectors, "ssd:Connector", name=name, kind=kind)
            ET.SubElement(connector, "ssc:Real", _unit_of(side, name))
    bindings = ET.SubElement(component, "ssd:ParameterBindings")
    ET.SubElement(bindings, "ssd:ParameterBinding", source=f"resources/{side.name}.ssv")


def _parameter_set(side: _Side, version: str, given: dict[str, float]) -> bytes:
    """Every parameter with its default or its given value."""
    values = {n: side.variables[n].start for n in side.names("parameter")}
    values |= {n: float(value) for n, value in given.items()}
    root = _root("ssv:ParameterSet", version, PARAMETERS, "ssv", "ssc")
    parameters = ET.SubElement(root, "ssv:Parameters")
    for name, value in values.items():
        if value is None:
            continue
        parameter = ET.SubElement(parameters, "ssv:Parameter", name=name)
        ET.SubElement(parameter, "ssv:Real", {"value": repr(value)} | _unit_of(side, name))
    used = {side.variables[n].unit for n in values}
    _write_units(root, "ssv:Units", {n: base for n, base in side.units.items() if n in used})
    return xml_text(root)


def _unit_of(side: _Side, name: str) -> dict[str, str]:
    unit = side.variables[name].unit
    return {"unit": unit} if unit in side.units else {}


def _all_units(sides: Sequence[_Side]) -> _Units:
    units: _Units = {}
    for side in sides:
        for name, base in side.units.items():
            if units.setdefault(name, base) != base:
                raise FmuError(f"unit {name!r} means {base} in {side.path}, before {units[name]}")
    return units


def _write_units(root: ET.Element, tag: str, units: _Units) -> None:
    if not units:
        return
    listed = ET.SubElement(root, tag)
    for name, base in sorted(units.items()):
        ET.SubElement(ET.SubElement(listed, "ssc:Unit", name=name), "ssc:BaseUnit", base)


def _root(tag: str, version: str, name: str, *prefixes: str) -> ET.Element:
    """The root element; libcosim and ecos need exactly these prefixes."""
    spaces = {f"xmlns:{p}": _NAMESPACES[p] for p in prefixes}
    return ET.Element(tag, spaces | {"version": version, "name": name, "generationTool": TOOL})
