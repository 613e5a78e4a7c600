"""The modelDescription.xml of an exported component, for FMI 2.0 and 3.0, readable or native."""

from __future__ import annotations

import hashlib
import math
from importlib.metadata import version
from xml.etree import ElementTree as ET

from ..solver.kernel import DEFAULT_TOLERANCE, Kernel
from .archive import xml_text
from .dependencies import Kinds, dependencies_of, initial_dependencies_of
from .interface import MESSAGE, Interface, Variable
from .units import TYPES, type_of, write_units

STOP_TIME, STEP_SIZE = 20.0, 1e-3
VERSION = version("ballscrew")
TOOL = f"ballscrew {VERSION}"
MAIN = {2: "fmi2.c", 3: "fmi3.c"}
"""The file to compile in the sources of a native FMU."""

_TOKEN = {2: "guid", 3: "instantiationToken"}
_CAN = {
    2: ("canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate"),
    3: (
        *("canGetAndSetFMUState", "canSerializeFMUState"),
        *("providesDirectionalDerivatives", "providesAdjointDerivatives"),
    ),
}
_INITIAL = {"output": "calculated", "local": "calculated", "parameter": "exact"}

_Attributes = dict[str, str]


def token_of(*texts: str) -> str:
    """A GUID from texts and our version, the same in every process."""
    digest = hashlib.sha256("".join([*texts, VERSION]).encode()).hexdigest()
    parts = (digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])
    return "{" + "-".join(parts) + "}"


def model_description(
    kernel: Kernel,
    interface: Interface,
    fmi: int,
    token: str,
    kinds: Kinds | None = None,
    exchanges: bool = False,
) -> bytes:
    """The XML text; the same component gives the same text in every process.

    Parameters
    ----------
    kernel : Kernel
    interface : Interface
    fmi : {2, 3}
    token : str
        The guid or instantiation token.
    kinds : Kinds, optional
        Of a native FMU: see `dependencies.kinds_of`; None for a readable one.
    exchanges : bool
        Whether it is also for model exchange.
    """
    native = kinds is not None
    about = {"fmiVersion": f"{fmi}.0", "modelName": kernel.name, _TOKEN[fmi]: token}
    about |= {"description": kernel.description, "version": VERSION, "license": "MIT"}
    about["generationTool"] = TOOL if native else f"{TOOL} with PythonFMU"
    about["variableNamingConvention"] = "structured"
    root = ET.Element("fmiModelDescription", about)
    if fmi == 2:
        root.set("numberOfEventIndicators", str(interface.events if exchanges else 0))
    _write_kinds_of_simulation(root, interface, fmi, native, exchanges)
    _write_definitions(root, interface, fmi)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Why a call failed")
    if not native:
        ET.SubElement(categories, "Category", name="logAll", description="All messages")
    experiment = {"stopTime": STOP_TIME, "tolerance": DEFAULT_TOLERANCE, "stepSize": STEP_SIZE}
    texts = {name: repr(value) for name, value in experiment.items()}
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0.0", **texts})
    _write_variables(ET.SubElement(root, "ModelVariables"), interface, fmi, exchanges)
    structure = ET.SubElement(root, "ModelStructure")
    _write_structure(structure, kernel, interface, fmi, kinds or {}, exchanges)
    return xml_text(root)


def _write_kinds_of_simulation(
    root: ET.Element, interface: Interface, fmi: int, native: bool, exchanges: bool
) -> None:
    can = {
        "modelIdentifier": interface.layout.model,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        **dict.fromkeys(_CAN[fmi], "true"),
    }
    vary = {"canHandleVariableCommunicationStepSize": "true"}
    if fmi == 2:
        can["providesDirectionalDerivative"] = str(native).lower()
        exchange = {"completedIntegratorStepNotNeeded": str(interface.events == 0).lower()}
        simulation = vary | {"canInterpolateInputs": "false"}
    else:
        exchange = {"needsCompletedIntegratorStep": str(interface.events > 0).lower()}
        simulation = vary | {"hasEventMode": "false"}
    kinds = {"ModelExchange": exchange} if exchanges else {}
    for tag, more in (kinds | {"CoSimulation": simulation}).items():
        node = ET.SubElement(root, tag, can | more)
        if native and fmi == 2:
            ET.SubElement(ET.SubElement(node, "SourceFiles"), "File", name=MAIN[2])


def _write_number(
    parent: ET.Element, tag: str, about: _Attributes, number: _Attributes, fmi: int
) -> None:
    """A variable or a type; FMI 2.0 has an element for the attributes of the number."""
    if fmi == 2:
        ET.SubElement(ET.SubElement(parent, tag, about), "Real", number)
    else:
        ET.SubElement(parent, tag, about | number)


def _write_definitions(root: ET.Element, interface: Interface, fmi: int) -> None:
    """Units and types of numbers; the time of FMI 3.0 is in seconds."""
    used = {v.unit for v in interface.variables} | ({"s"} if fmi == 3 else set())
    write_units(ET.SubElement(root, "UnitDefinitions"), used)
    types = {type_of(v.unit, v.nominal) for v in interface.variables} - {""}
    definitions = ET.SubElement(root, "TypeDefinitions") if types else root
    for name in sorted(types):
        quantity, unit, shown = TYPES[name]
        number = {"quantity": quantity, "unit": unit, "displayUnit": shown}
        tag = "SimpleType" if fmi == 2 else "Float64Type"
        _write_number(definitions, tag, {"name": name}, number, fmi)


def _write_variables(parent: ET.Element, interface: Interface, fmi: int, exchanges: bool) -> None:
    tag = "ScalarVariable" if fmi == 2 else "Float64"
    pairs = zip(interface.derivatives, interface.states, strict=True)
    derivatives = {d.reference: {"derivative": str(s.reference)} for d, s in pairs}
    for v in interface.variables:
        about = _about(v.name, v.reference, v.description, v.causality, v.variability)
        number = derivatives.get(v.reference, {}) | _number_of(v)
        _write_number(parent, tag, about, number, fmi)
    said = "why the last step failed; empty while all is well"
    message = _about(MESSAGE, interface.message_reference, said, "local", "discrete")
    if fmi == 2:
        ET.SubElement(ET.SubElement(parent, tag, message), "String")
    else:
        ET.SubElement(parent, "String", message)
        said = "positive where an event of the present mode is due"
        for k in range(interface.events if exchanges else 0):
            at = interface.first_indicator + k
            about = _about(f"event_indicator_{k + 1}", at, said, "local", "continuous")
            ET.SubElement(parent, tag, about)
        at = interface.time_reference
        time = _about("time", at, "time", "independent", "continuous")
        ET.SubElement(parent, tag, time | {"unit": "s"})
    parent[:] = sorted(parent, key=lambda node: int(node.get("valueReference", "0")))


def _about(
    name: str, reference: int, description: str, causality: str, variability: str
) -> _Attributes:
    about = {"name": name, "valueReference": str(reference), "description": description}
    about |= {"causality": causality, "variability": variability}
    return about | ({"initial": _INITIAL[causality]} if causality in _INITIAL else {})


def _number_of(v: Variable) -> _Attributes:
    declared = type_of(v.unit, v.nominal)
    number = {"declaredType": declared} if declared else {}
    number["unit"] = v.unit
    for name, bound in (("min", v.minimum), ("max", v.maximum)):
        if math.isfinite(bound):
            number[name] = repr(float(bound))
    number["nominal"] = repr(float(v.nominal))
    if v.start is not None:
        number["start"] = repr(float(v.start))
    return number


def _write_structure(
    parent: ET.Element,
    kernel: Kernel,
    interface: Interface,
    fmi: int,
    kinds: Kinds,
    exchanges: bool,
) -> None:
    """Unknowns with what they depend on; FMI 2.0 has indices, which are the value references."""
    time = interface.time_reference

    def write(tag: str, unknowns: list[tuple[int, dict[int, str]]], in_two: str) -> None:
        there = ET.SubElement(parent, in_two) if fmi == 2 else parent
        for reference, used in unknowns:
            known = {at: kind for at, kind in used.items() if fmi == 3 or at != time}
            kind, key = (tag, "valueReference") if fmi == 3 else ("Unknown", "index")
            node = ET.SubElement(there, kind, {key: str(reference)})
            node.set("dependencies", " ".join(map(str, known)))
            if any(known.values()):
                node.set("dependenciesKind", " ".join(known.values()))

    shown, slopes, indicators = dependencies_of(kernel, interface, kinds)
    outputs = [v.reference for v in interface.of("output")]
    write("Output", [*zip(outputs, shown, strict=True)], "Outputs")
    if rates := [v.reference for v in interface.derivatives]:
        listed = [*zip(rates, slopes, strict=True)]
        write("ContinuousStateDerivative", listed, "Derivatives")
    initial = initial_dependencies_of(kernel, interface)
    unknowns = [(reference, dict.fromkeys(known, "")) for reference, known in initial]
    write("InitialUnknown", unknowns, "InitialUnknowns")
    if exchanges and fmi == 3:
        write("EventIndicator", [*enumerate(indicators, interface.first_indicator)], "")
