"""What a plant or a controller is made of from outside: its ports and parameters."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ..controllers import ALONE
from ..fmus.catalogue import fmu_kernel, has_equations, name_of
from ..fmus.interface import START
from ..fmus.reading import unpack
from ..instruments import bare
from ..plant import DEFAULT_LAW, LAWS, PLANTS
from ..solver.kernel import Kernel, ParameterInfo
from .parameter_file import BALL_SCREW, FMU, ParameterFile, list_used


@dataclass(frozen=True)
class Part:
    """One side of a loop, equations or anybody's FMU.

    Attributes
    ----------
    name : str
        A name of the catalogue, a file's function (``mine.py:pi``), or the path of an FMU.
    inputs, outputs : tuple of str
    parameters : dict of str to ParameterInfo
        Initial states among them, as ``x_start``. Of an FMU a default may be NaN: it says none.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: Mapping[str, ParameterInfo]

    @property
    def label(self) -> str:
        return label_of(self.name)


def label_of(name: str) -> str:
    """What a part is called in tables, pictures, options and parameter files."""
    return readable(own_name(name))


def table_of(file: ParameterFile, controller: str) -> str:
    """Name of the table of a parameter file that is of a controller: its own, else the bare one's.

    So ``[controller.pid]`` is of ``pid+position_encoder``, too, where that has no table.
    """
    own = label_of(controller)
    return own if own in file.controllers else label_of(bare(controller))


def loop_label(plant: str, controller: str) -> str:
    """What a loop is called: as its controller, or as the plant that runs alone."""
    return label_of(plant if controller in ALONE else controller)


def own_name(name: str) -> str:
    """As `label_of`, in the letters of the command line."""
    return name_of(name) if has_equations(name) else Path(name).stem


def readable(name: str) -> str:
    """A file's name as text, also where the locale does not know its letters."""
    return os.fsencode(name).decode("utf-8", "replace")


def part_of(name: str) -> Part:
    """The part of this name or path.

    Raises
    ------
    FmuError
        If the file is no FMU that can run here.
    BadComponentFile, ContractError, UnsupportedComponent
        If a Python file's component cannot be made or solved.
    """
    if has_equations(name):
        kernel = fmu_kernel(name)
        return Part(
            name,
            tuple(i.name for i in kernel.inputs if i.role != "internal"),
            tuple(o.name for o in kernel.outputs),
            parameters_of(kernel),
        )
    unpacked = unpack(name)
    unpacked.remove()
    description = unpacked.description
    return Part(
        name,
        tuple(description.names("input")),
        tuple(description.names("output")),
        {
            v.name: ParameterInfo(
                v.name,
                math.nan if v.start is None else v.start,
                v.unit,
                f"parameter of {Path(name).name}",
                f"start value of {Path(name).name}",
                -math.inf,
                math.inf,
            )
            for v in description.variables
            if v.causality == "parameter"
        },
    )


def _settable(part: Part, values: Mapping[str, float]) -> dict[str, ParameterInfo]:
    """A part's parameters, and those of its inputs that were given a value."""
    given = {
        name: ParameterInfo(name, math.nan, "", "input", "", -math.inf, math.inf)
        for name in part.inputs
        if name in values
    }
    return {**part.parameters, **given}


def parameters_of(kernel: Kernel) -> dict[str, ParameterInfo]:
    """Parameters and initial states of a compiled component, by name."""
    found = {p.name: p for p in kernel.parameters}
    for s in (*kernel.states, *kernel.discrete):
        name, meaning = s.name + START, f"initial {s.meaning}"
        found[name] = ParameterInfo(
            name, s.start, s.unit, meaning, "start value", -math.inf, math.inf
        )
    return found


def used_parameters(
    plant: str,
    plant_values: Mapping[str, float],
    controllers: Mapping[str, Mapping[str, float]],
    told: ParameterFile | None = None,
) -> ParameterFile:
    """All parameters of a loop as they were used, as a parameter file that the next command reads.

    Parameters
    ----------
    plant : str
        As `Part.name`.
    plant_values : mapping of str to float
        Those that were given.
    controllers : mapping of str to mapping of str to float
        The controllers, as `plant`, and the values that were given to each.
    told : ParameterFile, optional
        Where values come from; what still has its value keeps its interval and source.
    """
    file = told or ParameterFile()
    source = "given to this run"
    known = _settable(part_of(plant), plant_values)
    values = list_used(known, plant_values, {**file.plant, **file.found}, source)
    kind, law = FMU, ""
    own = set(known)
    name = plant.removeprefix("plant").removeprefix("_") or DEFAULT_LAW
    if plant in PLANTS and name in LAWS:
        kind, law = BALL_SCREW, name
    elif told is not None and set(told.plant) <= own:
        kind, law = told.kind, told.law
        own = set(told.plant)
        if kind == BALL_SCREW:
            own |= set(part_of(told.plant_name).parameters)
    described = {
        label_of(name): list_used(
            _settable(part_of(name), given),
            given,
            file.controllers.get(table_of(file, name), {}),
            source,
        )
        for name, given in controllers.items()
    }
    return replace(
        file,
        path=None,
        kind=kind,
        law=law,
        plant={n: v for n, v in values.items() if n in own},
        found={n: v for n, v in values.items() if n not in own},
        controllers={**file.controllers, **described},
        tolerance={},
        not_identified={},
        diagnosis=None,
    )
