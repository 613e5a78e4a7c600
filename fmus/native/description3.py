"""The modelDescription.xml and buildDescription.xml of a native FMU of FMI 3.0."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from ..interface import TIME
from ..model_description import (
    Attributes,
    attributes_of,
    message_attributes,
    root_of,
    sort_variables,
    text_of,
    write_definitions,
    write_experiment,
)
from ..uses import initial_uses
from .dependencies import Dependency, dependencies_of
from .description import write_dependencies
from .sources import MAIN, NativeModel

_CAN = {
    "needsExecutionTool": "false",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canGetAndSetFMUState": "true",
    "canSerializeFMUState": "true",
    "providesDirectionalDerivatives": "true",
    "providesAdjointDerivatives": "true",
}


def build_description(identifier: str) -> bytes:
    """Information for tools that compile the sources."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    ET.SubElement(files, "SourceFile", name=MAIN[3])
    ET.SubElement(configuration, "Library", name="m", external="true")
    return text_of(root)


def description_of(model: NativeModel, token: str) -> bytes:
    """The XML text.

    Parameters
    ----------
    model : NativeModel
    token : str
        The instantiation token.
    """
    kernel, interface = model.kernel, model.interface
    root = root_of("3.0", kernel.name, "instantiationToken", token, kernel)
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
            "hasEventMode": "false",
        },
    )
    write_definitions(root, interface, _write_float, "Float64Type", {"s"})
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Why a call failed")
    write_experiment(root)
    _write_variables(ET.SubElement(root, "ModelVariables"), model)
    _write_structure(ET.SubElement(root, "ModelStructure"), model)
    return text_of(root)


def _write_variables(parent: ET.Element, model: NativeModel) -> None:
    interface = model.interface
    derivatives = {d.name: s for d, s in zip(model.derivatives, model.state_variables, strict=True)}
    for v in interface.variables:
        about, number = attributes_of(v, ("output", "local"))
        if v.name in derivatives:
            number["derivative"] = str(derivatives[v.name].reference)
        _write_float(parent, "Float64", about, number)
    ET.SubElement(parent, "String", message_attributes(interface))
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
    sort_variables(parent)


def _write_float(parent: ET.Element, tag: str, about: Attributes, number: Attributes) -> None:
    ET.SubElement(parent, tag, about | number)


def _write_structure(parent: ET.Element, model: NativeModel) -> None:
    interface = model.interface
    outputs = [v for v in interface.variables if v.causality == "output"]

    def dependent(kind: str, at: int, used: list[Dependency]) -> None:
        node = ET.SubElement(parent, kind, valueReference=str(at))
        write_dependencies(node, used, model.time_reference)

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
