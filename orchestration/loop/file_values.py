"""What a parameter file gives the parts of a loop."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from ...controllers import CONTROLLERS
from ...plant import DESCRIBED
from ...plant.instruments import PartName
from .catalogue import in_units_of
from .loop import Loop, table_of
from .parameter_file import FMU, ParameterFile
from .parts import Part


def file_values(
    told: ParameterFile | None,
    plant: str | None,
    controllers: Sequence[str],
    given: Collection[str] = (),
) -> tuple[str, dict[str, float], dict[str, dict[str, float]], list[str]]:
    """The plant to run, the values of a file for it and each controller, and what is not used.

    The plant is the requested one, else that of the file; `given` are names of its values that are
    given elsewhere. Raises `BadParameters`.
    """
    plant = plant_of(told, plant)
    if told is None:
        return plant, {}, {name: {} for name in controllers}, []
    values = for_plant(told, plant, given)
    values_of = {n: for_controller(told, in_units_of(n, plant)) for n in controllers}
    return plant, values, values_of, [*aside(told, values, plant), *_unknown(told, controllers)]


def plant_of(told: ParameterFile | None, plant: str | None) -> str:
    """The requested plant, else the one that the file describes, else the nominal one."""
    return plant or (told.plant_name if told else "plant")


def with_file(loop: Loop, told: ParameterFile, chosen: bool) -> Loop:
    """The loop with the values of a file where it has none; its plant stays if it was `chosen`."""
    own, name = loop.plant_values, loop.controller.name
    asked = loop.plant.name if chosen else None
    plant, values, values_of, notes = file_values(told, asked, [name], own)
    return replace(
        loop,
        plant=Part(plant),
        plant_values={**values, **own},
        controller_values={**values_of[name], **loop.controller_values},
        told=told,
        notes=(*loop.notes, *notes),
    )


def for_plant(told: ParameterFile, plant: str, given: Collection[str] = ()) -> dict[str, float]:
    """The file's values for a plant; with `given` there is no gap, see `check_complete`."""
    known = Part(plant).parameters
    if told.kind == FMU:
        return told.plant_values(known)[0]
    own = Part(told.plant_name).parameters
    # a file of another law has values that this plant does not use
    values, _ = told.plant_values(known, own if told.law and told.plant_name != plant else ())
    needed = known if PartName.of(plant).plain in DESCRIBED else known.keys() & own.keys()
    told.check_complete({n: known[n] for n in needed}, {*values, *given})
    return values


def for_controller(told: ParameterFile, name: str) -> dict[str, float]:
    """The file's values for a controller."""
    part = Part(name)
    return told.controller_values(table_of(told, part), part.parameters)


def aside(told: ParameterFile, values: Collection[str], plant: str) -> list[str]:
    """A note on the file's values that a plant does not use, if there are any."""
    names = [n for n in (*told.plant, *told.found) if n not in values]
    said = f"{told.path}: {', '.join(names)}: {plant} has no such parameter; left aside"
    return [said] if names else []


def _unknown(told: ParameterFile, controllers: Sequence[str]) -> list[str]:
    """Notes on tables of controllers that do not run here and are not known."""
    parts = [Part(c) for c in controllers]
    known = {*CONTROLLERS, *(p.label for p in parts), *(table_of(told, p) for p in parts)}
    return [
        f"{told.path}: [controller.{name}]: no controller of this name runs here; left aside"
        for name in told.controllers
        if name not in known
    ]
