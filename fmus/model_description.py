"""The modelDescription.xml of an exported component (FMI 2.0, section 2.2)."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from importlib.metadata import version
from xml.etree import ElementTree as ET

from ..solver.kernel import DEFAULT_TOLERANCE, Kernel
from .interface import MESSAGE, TIME, Interface, Variable
from .units import TYPES, type_of, write_units
from .uses import initial_uses

STOP_TIME, STEP_SIZE = 20.0, 1e-3
VERSION = version("ballscrew")
TOOL = f"ballscrew {VERSION}"


def model_description(kernel: Kernel, interface: Interface) -> bytes:
    """The XML text, the same for the same component in every process.

    Parameters
    ----------
    kernel : Kernel
    interface : Interface
    """
    guid = hashlib.sha256((kernel.source + repr(interface) + VERSION).encode()).hexdigest()
    model = interface.layout.model
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=model,
        guid=f"{{{guid[:8]}-{guid[8:12]}-{guid[12:16]}-{guid[16:20]}-{guid[20:32]}}}",
        description=kernel.description,
        version=VERSION,
        license="MIT",
        generationTool=f"{TOOL} with PythonFMU",
        variableNamingConvention="structured",
        numberOfEventIndicators="0",
    )
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
    units = ET.SubElement(root, "UnitDefinitions")
    write_units(units, {v.unit for v in interface.variables})
    types = {type_of(v.unit, v.nominal) for v in interface.variables} - {""}
    if types:
        definitions = ET.SubElement(root, "TypeDefinitions")
        for name in sorted(types):
            quantity, unit, shown = TYPES[name]
            kind = ET.SubElement(definitions, "SimpleType", name=name)
            ET.SubElement(kind, "Real", quantity=quantity, unit=unit, displayUnit=shown)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Why a step failed")
    ET.SubElement(categories, "Category", name="logAll", description="All messages")
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(STOP_TIME),
        tolerance=repr(DEFAULT_TOLERANCE),
        stepSize=repr(STEP_SIZE),
    )
    variables = ET.SubElement(root, "ModelVariables")
    for v in interface.variables:
        _write_variable(variables, v)
    message = ET.SubElement(
        variables,
        "ScalarVariable",
        name=MESSAGE,
        valueReference=str(interface.message_reference),
        description="why the last step failed; empty while all is well",
        causality="local",
        variability="discrete",
        initial="calculated",
    )
    ET.SubElement(message, "String")
    variables[:] = sorted(variables, key=lambda node: int(node.get("valueReference", "0")))
    _write_structure(root, kernel, interface)
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root) + b"\n"


def _write_variable(parent: ET.Element, v: Variable) -> None:
    attributes = {
        "name": v.name,
        "valueReference": str(v.reference),
        "description": v.description,
        "causality": v.causality,
        "variability": v.variability,
    }
    if v.causality == "output":
        attributes["initial"] = "calculated"
    elif v.causality == "parameter":
        attributes["initial"] = "exact"
    node = ET.SubElement(parent, "ScalarVariable", attributes)
    declared = type_of(v.unit, v.nominal)
    real = {"declaredType": declared} if declared else {}
    real["unit"] = v.unit
    if math.isfinite(v.minimum):
        real["min"] = repr(float(v.minimum))
    if math.isfinite(v.maximum):
        real["max"] = repr(float(v.maximum))
    real["nominal"] = repr(float(v.nominal))
    if v.start is not None:
        real["start"] = repr(float(v.start))
    ET.SubElement(node, "Real", real)


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
