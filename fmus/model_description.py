"""The modelDescription.xml of an exported component (FMI 2.0, section 2.2)."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Collection, Iterable
from importlib.metadata import version
from xml.etree import ElementTree as ET

from ..solver.kernel import DEFAULT_TOLERANCE, Kernel
from .interface import MESSAGE, TIME, Interface, Variable
from .units import TYPES, type_of, write_units
from .uses import initial_uses

STOP_TIME, STEP_SIZE = 20.0, 1e-3
VERSION = version("ballscrew")
TOOL = f"ballscrew {VERSION}"

Attributes = dict[str, str]
WriteNumber = Callable[[ET.Element, str, Attributes, Attributes], None]


def model_description(kernel: Kernel, interface: Interface) -> bytes:
    """The XML text of a readable FMU; the same component gives the same text in every process.

    Parameters
    ----------
    kernel : Kernel
    interface : Interface
    """
    guid = hashlib.sha256((kernel.source + repr(interface) + VERSION).encode()).hexdigest()
    parts = (guid[:8], guid[8:12], guid[12:16], guid[16:20], guid[20:32])
    return text_of(
        description(kernel, interface, f"{{{'-'.join(parts)}}}", f"{TOOL} with PythonFMU")
    )


def description(kernel: Kernel, interface: Interface, guid: str, tool: str) -> ET.Element:
    """The whole description of an FMU of FMI 2.0 that is for co-simulation only."""
    model = interface.layout.model
    root = root_of("2.0", model, "guid", guid, kernel, tool)
    root.set("numberOfEventIndicators", "0")
    ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=model,
        needsExecutionTool="false",
        canHandleVariableCommunicationStepSize="true",
        canInterpolateInputs="false",
        canBeInstantiatedOnlyOncePerProcess="false",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
        providesDirectionalDerivative="false",
    )
    write_definitions(root, interface, _write_real, "SimpleType")
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Why a step failed")
    ET.SubElement(categories, "Category", name="logAll", description="All messages")
    write_experiment(root)
    variables = ET.SubElement(root, "ModelVariables")
    for v in interface.variables:
        about, real = attributes_of(v, ("output",))
        _write_real(variables, "ScalarVariable", about, real)
    message = ET.SubElement(variables, "ScalarVariable", message_attributes(interface))
    ET.SubElement(message, "String")
    sort_variables(variables)
    _write_structure(root, kernel, interface)
    return root


def root_of(
    fmi: str, model: str, token_name: str, token: str, kernel: Kernel, tool: str = TOOL
) -> ET.Element:
    """The root element, without the attributes that only one version of FMI has."""
    return ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": fmi,
            "modelName": model,
            token_name: token,
            "description": kernel.description,
            "version": VERSION,
            "license": "MIT",
            "generationTool": tool,
            "variableNamingConvention": "structured",
        },
    )


def write_definitions(
    root: ET.Element,
    interface: Interface,
    write: WriteNumber,
    kind: str,
    units: Collection[str] = (),
) -> None:
    """Units and types of numbers.

    Parameters
    ----------
    write : function (parent, tag, attributes, attributes of a number) -> None
    kind : str
        Tag of a type.
    units : collection of str
        Units that no variable of the interface has.
    """
    used = {v.unit for v in interface.variables}.union(units)
    write_units(ET.SubElement(root, "UnitDefinitions"), used)
    types = {type_of(v.unit, v.nominal) for v in interface.variables} - {""}
    if not types:
        return
    definitions = ET.SubElement(root, "TypeDefinitions")
    for name in sorted(types):
        quantity, unit, shown = TYPES[name]
        number = {"quantity": quantity, "unit": unit, "displayUnit": shown}
        write(definitions, kind, {"name": name}, number)


def write_experiment(root: ET.Element) -> None:
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(STOP_TIME),
        tolerance=repr(DEFAULT_TOLERANCE),
        stepSize=repr(STEP_SIZE),
    )


def attributes_of(v: Variable, calculated: Collection[str]) -> tuple[Attributes, Attributes]:
    """Attributes of a variable, and those of its number.

    Parameters
    ----------
    calculated : collection of str
        Causalities whose initial values are marked as calculated.
    """
    about = {
        "name": v.name,
        "valueReference": str(v.reference),
        "description": v.description,
        "causality": v.causality,
        "variability": v.variability,
    }
    if v.causality in calculated:
        about["initial"] = "calculated"
    elif v.causality == "parameter":
        about["initial"] = "exact"
    declared = type_of(v.unit, v.nominal)
    number = {"declaredType": declared} if declared else {}
    number["unit"] = v.unit
    if math.isfinite(v.minimum):
        number["min"] = repr(float(v.minimum))
    if math.isfinite(v.maximum):
        number["max"] = repr(float(v.maximum))
    number["nominal"] = repr(float(v.nominal))
    if v.start is not None:
        number["start"] = repr(float(v.start))
    return about, number


def message_attributes(interface: Interface) -> Attributes:
    return {
        "name": MESSAGE,
        "valueReference": str(interface.message_reference),
        "description": "why the last step failed; empty while all is well",
        "causality": "local",
        "variability": "discrete",
        "initial": "calculated",
    }


def sort_variables(variables: ET.Element) -> None:
    variables[:] = sorted(variables, key=lambda node: int(node.get("valueReference", "0")))


def text_of(root: ET.Element) -> bytes:
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root) + b"\n"


def _write_real(parent: ET.Element, tag: str, about: Attributes, real: Attributes) -> None:
    ET.SubElement(ET.SubElement(parent, tag, about), "Real", real)


def _write_structure(root: ET.Element, kernel: Kernel, interface: Interface) -> None:
    position = {v.name: v.reference for v in interface.variables}
    outputs = [v for v in interface.variables if v.causality == "output"]

    def indices(names: Iterable[str]) -> str:
        return " ".join(str(k) for k in sorted(position[name] for name in names))

    structure = ET.SubElement(root, "ModelStructure")
    listed = ET.SubElement(structure, "Outputs")
    for v in outputs:
        ET.SubElement(
            listed, "Unknown", index=str(position[v.name]), dependencies=indices(v.feedthrough)
        )
    initial = ET.SubElement(structure, "InitialUnknowns")
    for v, used in zip(outputs, initial_uses(kernel, "out"), strict=True):
        ET.SubElement(
            initial, "Unknown", index=str(position[v.name]), dependencies=indices(used - {TIME})
        )
