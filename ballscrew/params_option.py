"""The option ``--params``: a parameter file's values for the parts of a loop."""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import print_notes
from .solver.errors import UserError

if TYPE_CHECKING:
    from .orchestration.loop.parameter_file import ParameterFile, Values
    from .solver.kernel import Kernel


def add_params(
    add: Any, what: str = "parameter file with values of plant and controllers; --set has priority"
) -> None:
    """Add the option to a parser, by its `add_argument`."""
    add("--params", type=Path, metavar="FILE.toml", help=f"parameter file: {what}")


def read_params(options: argparse.Namespace) -> ParameterFile | None:
    """The file of ``--params``, if there is one; the names of parameters are not checked yet.

    Raises
    ------
    UserError
        Also if the results would overwrite the file.
    """
    if options.params is None:
        return None
    from .orchestration.loop.parameter_file import FILE_NAME, read_parameters

    written = options.out and os.path.realpath(options.out / FILE_NAME)
    if written == os.path.realpath(options.params):
        raise UserError(f"{options.params} would be overwritten by a result; choose another --out")
    return read_parameters(options.params)


def apart(told: ParameterFile | None, name: str) -> tuple[str, tuple[str, ...]]:
    """A controller and its instruments as in an .ssp, each with its own values.

    Raises
    ------
    UserError
        If the file has values for both as one part.
    """
    from .orchestration.loop.parts import Part
    from .plant.instruments import PartName

    named = PartName.of(name)
    if told and named.instruments and Part(name).label in told.controllers:
        raise UserError(
            f"{told.path}: [controller.{Part(name).label}] is for one part, but in an .ssp its "
            "instruments are separate parts; export without --params, and run with --set "
            "ELEMENT.VARIABLE=VALUE"
        )
    base = replace(named, instruments=())
    return str(base), tuple(str(PartName(i, units=named.units)) for i in named.instruments)


def kernel_with_values(
    told: ParameterFile | None, name: str, kernel: Kernel, plant: str = ""
) -> Kernel:
    """The kernel of a part with the file's start values.

    Parameters
    ----------
    told : ParameterFile or None
    name : str
    kernel : Kernel
        Of the part, or of a loop of it and a plant.
    plant : str
        That of the loop; empty: the kernel is of no loop.

    Raises
    ------
    UserError
    """
    if told is None:
        return kernel
    from .fmus.interface import with_start_values
    from .orchestration.loop.loop import aside, for_controller, for_plant, table_of
    from .orchestration.loop.parts import Part
    from .solver.kernel import CONTROLLER, PLANT

    path = str(told.path)
    values: dict[str, float] = {}
    sources: dict[str, str] = {}

    def add(prefix: str, given: dict[str, float], said: Values) -> None:
        for n, value in given.items():
            values[prefix + n] = value
            sources[prefix + n] = (said[n].source if n in said else "") or f"from {path}"

    of_plant = {**told.plant, **told.found}
    of_controller = told.controllers.get(table_of(told, Part(name)), {})
    moves = plant or (name if _is_plant(name) else "")
    if moves:
        add(PLANT if plant else "", for_plant(told, moves), of_plant)
        print_notes(aside(told, {n.removeprefix(PLANT) for n in values}, moves))
    if plant or not moves:
        add(CONTROLLER if plant else "", for_controller(told, name), of_controller)
    return with_start_values(kernel, values, sources)


def _is_plant(part: str) -> bool:
    """Whether a part is on the plant's side: it has no measurement or set-point."""
    from .orchestration.loop.catalogue import component
    from .plant import PLANTS
    from .plant.instruments import PartName
    from .solver.component_file import names_file

    bare = PartName.of(part).bare
    if not names_file(bare):
        return bare in PLANTS
    return not any(i.role in ("measurement", "reference") for i in component(part).inputs)
