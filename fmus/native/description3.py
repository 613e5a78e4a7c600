"""The modelDescription.xml and buildDescription.xml of a native FMU of FMI 3.0."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

from ...solver.kernel import DEFAULT_TOLERANCE
from ..interface import MESSAGE, TIME, Variable
from ..model_description import STEP_SIZE, STOP_TIME, TOOL, VERSION
from ..units import TYPES, type_of, write_units
from ..uses import initial_uses
from .dependencies import Dependency, dependencies_of
from .sources import MAIN, NativeModel, is_intermediate

_CAN = {
    "needsExecutionTool": "false",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canGetAndSetFMUState": "true",
    "canSerializeFMUState": "true",
    "providesDirectionalDerivatives": "true",
    "providesAdjointDerivatives": "true",
}


def build_description(identifier: str) -> bytes:
    """What a tool needs to know to compile the sources."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    ET.SubElement(files, "SourceFile", name=MAIN[3])
    ET.SubElement(configuration, "Library", name="m", external="true")
    return _text(root)


def description_of(model: NativeModel, token: str) -> bytes:
    """The XML text.

    Parameters
    ----------
    model : NativeModel
    token : str
        The instantiation token.
    """
    kernel, interface = model.kernel, model.interface
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=kernel.name,
        instantiationToken=token,
        description=kernel.description,
        version=VERSION,
        license="MIT",
        generationTool=TOOL,
        variableNamingConvention="structured",
    )
    if model.exchanges:
        ET.SubElement(
            root,
            "ModelExchange",
            {
                "modelIdentifier": kernel.name,
                **_CAN,
                "needsCompletedIntegratorStep": str(model.events > 0).lower(),
            },
        )
    ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": kernel.name,
            **_CAN,
            "canHandleVariableCommunicationStepSize": "true",
            "providesIntermediateUpdate": "true",
            "canReturnEarlyAfterIntermediateUpdate": "true",
            "hasEventMode": "false",
        },
    )
    units = ET.SubElement(root, "UnitDefinitions")
    write_units(units, {v.unit for v in interface.variables} | {"s"})
    types = {type_of(v.unit, v.nominal) for v in interface.variables} - {""}
    if types:
        definitions = ET.SubElement(root, "TypeDefinitions")
        for name in sorted(types):
            quantity, unit, shown = TYPES[name]
            ET.SubElement(
                definitions,
                "Float64Type",
                name=name,
                quantity=quantity,
                unit=unit,
                displayUnit=shown,
            )
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Why a call failed")
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(STOP_TIME),
        tolerance=repr(DEFAULT_TOLERANCE),
        stepSize=repr(STEP_SIZE),
    )
    _write_variables(ET.SubElement(root, "ModelVariables"), model)
    _write_structure(ET.SubElement(root, "ModelStructure"), model)
    return _text(root)


def _write_variables(parent: ET.Element, model: NativeModel) -> None:
    interface = model.interface
    derivatives = {d.name: s for d, s in zip(model.derivatives, model.state_variables, strict=True)}
    for v in interface.variables:
        node = _write_variable(parent, v)
        if v.name in derivatives:
            node.set("derivative", str(derivatives[v.name].reference))
    ET.SubElement(
        parent,
        "String",
        name=MESSAGE,
        valueReference=str(interface.message_reference),
        description="why the last step failed; empty while all is well",
        causality="local",
        variability="discrete",
        initial="calculated",
    )
    if model.exchanges:
        for k in range(model.events):
            ET.SubElement(
                parent,
                "Float64",
                name=f"event_indicator_{k + 1}",
                valueReference=str(model.first_indicator + k),
                description="positive where an event of the present mode is due",
                causality="local",
                variability="continuous",
                initial="calculated",
            )
    ET.SubElement(
        parent,
        "Float64",
        name="time",
        valueReference=str(model.time_reference),
        description="time",
        causality="independent",
        variability="continuous",
        unit="s",
    )
    parent[:] = sorted(parent, key=lambda node: int(node.get("valueReference", "0")))


def _write_variable(parent: ET.Element, v: Variable) -> ET.Element:
    attributes = {
        "name": v.name,
        "valueReference": str(v.reference),
        "description": v.description,
        "causality": v.causality,
        "variability": v.variability,
    }
    if v.causality != "input":
        attributes["initial"] = "exact" if v.causality == "parameter" else "calculated"
    if declared := type_of(v.unit, v.nominal):
        attributes["declaredType"] = declared
    attributes["unit"] = v.unit
    if math.isfinite(v.minimum):
        attributes["min"] = repr(float(v.minimum))
    if math.isfinite(v.maximum):
        attributes["max"] = repr(float(v.maximum))
    attributes["nominal"] = repr(float(v.nominal))
    if v.start is not None:
        attributes["start"] = repr(float(v.start))
    if is_intermediate(v):
        attributes["intermediateUpdate"] = "true"
    return ET.SubElement(parent, "Float64", attributes)


def _write_structure(parent: ET.Element, model: NativeModel) -> None:
    interface = model.interface
    outputs = [v for v in interface.variables if v.causality == "output"]

    def dependent(kind: str, at: int, used: list[Dependency]) -> None:
        node = ET.SubElement(parent, kind, valueReference=str(at))
        time = model.time_reference
        known = sorted((d.known.reference if d.known else time, d.kind) for d in used)
        node.set("dependencies", " ".join(str(reference) for reference, _ in known))
        node.set("dependenciesKind", " ".join(kind for _, kind in known))

    uses = dependencies_of(model)
    for v, used in zip(outputs, uses.outputs, strict=True):
        dependent("Output", v.reference, used)
    for v, used in zip(model.derivatives, uses.derivatives, strict=True):
        dependent("ContinuousStateDerivative", v.reference, used)
    reference = {v.name: v.reference for v in interface.variables} | {TIME: model.time_reference}
    unknowns = (("out", outputs), ("states", model.state_variables), ("rhs", model.derivatives))
    for results, variables in unknowns:
        for v, names in zip(variables, initial_uses(model.kernel, results), strict=True):
            if results != "states" or v.causality == "local":  # others are outputs, listed above
                node = ET.SubElement(parent, "InitialUnknown", valueReference=str(v.reference))
                node.set("dependencies", " ".join(map(str, sorted(reference[n] for n in names))))
    if model.exchanges:
        for k, used in enumerate(uses.indicators):
            dependent("EventIndicator", model.first_indicator + k, used)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root) + b"\n"
