"""The modelDescription.xml of a native FMU of FMI 2.0: that of the pythonfmu build, and more."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from ..interface import TIME
from ..model_description import TOOL, description, text_of
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
    root = description(model.kernel, model.interface, token, TOOL)
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
    return text_of(root)


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
        write_dependencies(unknown, used)
    if not model.derivatives:
        return
    place = ET.Element("Derivatives")
    structure.insert(1, place)
    for derivative, used in zip(model.derivatives, uses.derivatives, strict=True):
        unknown = ET.SubElement(place, "Unknown", index=index[derivative.name])
        write_dependencies(unknown, used)
    initial = structure.find("InitialUnknowns")
    assert initial is not None
    for variables, results in ((model.state_variables, "states"), (model.derivatives, "rhs")):
        for variable, names in zip(variables, initial_uses(model.kernel, results), strict=True):
            if variable.causality == "local":  # states that are outputs are already listed
                known = sorted(int(index[n]) for n in names - {TIME})
                unknown = ET.SubElement(initial, "Unknown", index=index[variable.name])
                unknown.set("dependencies", " ".join(map(str, known)))
    initial[:] = sorted(initial, key=lambda unknown: int(unknown.get("index", "0")))


def write_dependencies(
    unknown: ET.Element, used: Sequence[Dependency], time: int | None = None
) -> None:
    """Dependencies of an unknown, by value reference, which in FMI 2.0 is also the index.

    Parameters
    ----------
    time : int, optional
        Value reference of the time, if it is a variable.
    """
    known = ((d.known.reference if d.known else time, d.kind) for d in used)
    named = sorted((place, kind) for place, kind in known if place is not None)
    unknown.set("dependencies", " ".join(str(place) for place, _ in named))
    unknown.set("dependenciesKind", " ".join(kind for _, kind in named))
