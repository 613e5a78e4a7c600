"""The modelDescription.xml of a native FMU of FMI 2.0: that of the pythonfmu build, and more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

from ..interface import TIME
from ..model_description import TOOL, model_description
from ..uses import initial_uses
from .dependencies import Dependency, dependencies_of
from .sources import MAIN, NativeModel


def description_of(model: NativeModel, token: str) -> bytes:
    """The XML text.

    Parameters
    ----------
    model : NativeModel
    token : str
        The guid.
    """
    root = ET.fromstring(model_description(model.kernel, model.interface))
    root.set("guid", token)
    root.set("generationTool", TOOL)
    simulation = root.find("CoSimulation")
    assert simulation is not None
    simulation.set("providesDirectionalDerivative", "true")
    _list_sources(simulation)
    if model.exchanges:
        exchange = ET.Element(
            "ModelExchange",
            modelIdentifier=model.kernel.name,
            needsExecutionTool="false",
            completedIntegratorStepNotNeeded=str(model.events == 0).lower(),
            canBeInstantiatedOnlyOncePerProcess="false",
            canNotUseMemoryManagementFunctions="true",
            canGetAndSetFMUstate="true",
            canSerializeFMUstate="true",
            providesDirectionalDerivative="true",
        )
        _list_sources(exchange)
        root.insert(0, exchange)
        root.set("numberOfEventIndicators", str(model.events))
    _describe_derivatives(root, model)
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root) + b"\n"


def _list_sources(parent: ET.Element) -> None:
    ET.SubElement(ET.SubElement(parent, "SourceFiles"), "File", name=MAIN[2])


def _describe_derivatives(root: ET.Element, model: NativeModel) -> None:
    listed = root.find("ModelVariables")
    structure = root.find("ModelStructure")
    assert listed is not None
    assert structure is not None
    nodes = {node.get("name", ""): node for node in listed}
    index = {v.name: str(v.reference) for v in model.interface.variables}
    for state, derivative in zip(model.state_variables, model.derivatives, strict=True):
        real = nodes[derivative.name].find("Real")
        assert real is not None
        real.set("derivative", index[state.name])
    uses = dependencies_of(model)
    outputs = structure.find("Outputs")
    assert outputs is not None
    for unknown, used in zip(outputs, uses.outputs, strict=True):
        _write_dependencies(unknown, used, index)
    if not model.derivatives:
        return
    place = ET.Element("Derivatives")
    structure.insert(1, place)
    for derivative, used in zip(model.derivatives, uses.derivatives, strict=True):
        unknown = ET.SubElement(place, "Unknown", index=index[derivative.name])
        _write_dependencies(unknown, used, index)
    initial = structure.find("InitialUnknowns")
    assert initial is not None
    for variables, results in ((model.state_variables, "states"), (model.derivatives, "rhs")):
        for variable, names in zip(variables, initial_uses(model.kernel, results), strict=True):
            if variable.causality == "local":  # states that are outputs are there already
                known = sorted(int(index[n]) for n in names - {TIME})
                unknown = ET.SubElement(initial, "Unknown", index=index[variable.name])
                unknown.set("dependencies", " ".join(map(str, known)))
    initial[:] = sorted(initial, key=lambda unknown: int(unknown.get("index", "0")))


def _write_dependencies(
    unknown: ET.Element, used: Sequence[Dependency], index: Mapping[str, str]
) -> None:
    named = [(int(index[d.known.name]), d.kind) for d in used if d.known]  # time is no variable
    unknown.set("dependencies", " ".join(str(place) for place, _ in sorted(named)))
    unknown.set("dependenciesKind", " ".join(kind for _, kind in sorted(named)))
