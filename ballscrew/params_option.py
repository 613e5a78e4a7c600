"""The option ``--params``: a parameter file's values for the parts of a loop."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .options import BadRequest, guard

if TYPE_CHECKING:
    from .orchestration.parameter_file import ParameterFile, Values
    from .solver.kernel import Kernel


def add_params(
    add: Any, what: str = "parameter file with values of plant and controllers; --set has priority"
) -> None:
    """Add the option to a parser, by its `add_argument`."""
    add("--params", type=Path, metavar="FILE.toml", help=f"parameter file: {what}")


@contextlib.contextmanager
def bad_parameters() -> Iterator[None]:
    """Turn an error in a parameter file into one line for the user."""
    from .orchestration.parameter_file import BadParameters

    try:
        yield
    except BadParameters as error:
        raise BadRequest(str(error)) from error


def read_params(options: argparse.Namespace) -> ParameterFile | None:
    """The file of ``--params``, if there is one; the names of parameters are not checked yet.

    Raises
    ------
    BadRequest
        Also if the results would overwrite the file.
    """
    if options.params is None:
        return None
    from .orchestration.parameter_file import FILE_NAME
    from .orchestration.parameter_reading import read_parameters

    written = options.out and os.path.realpath(options.out / FILE_NAME)
    if written == os.path.realpath(options.params):
        raise BadRequest(f"{options.params} would be overwritten by a result; choose another --out")
    with bad_parameters():
        return read_parameters(options.params)


def params_values(
    told: ParameterFile | None, plant: str | None, controllers: Sequence[str]
) -> tuple[str, dict[str, float], dict[str, dict[str, float]]]:
    """The plant to run, and what a parameter file gives it and each controller.

    Parameters
    ----------
    told : ParameterFile or None
    plant : str or None
        The requested plant, a name or a path; None: the plant that the file describes.
    controllers : sequence of str
        Names or paths.

    Raises
    ------
    BadRequest
    """

    if told is None:
        return plant or "plant", {}, {name: {} for name in controllers}
    from .fmus.catalogue import in_units_of

    with bad_parameters():
        plant = plant or told.plant_name
        values = guard(lambda: _plant_values(told, plant))
        own = {n: in_units_of(n, plant) for n in controllers}
        values_of = {n: guard(lambda n=n: _controller_values(told, own[n])) for n in controllers}
    _note_other_fmus(told, controllers)
    return plant, values, values_of


def _plant_values(told: ParameterFile, plant: str) -> dict[str, float]:
    """The file's values for a plant; values that the plant does not use are reported."""
    from .orchestration.parameter_file import FMU
    from .orchestration.parts import Part

    others: Collection[str] = ()
    if told.law and told.kind != FMU and told.plant_name != plant:
        # a file of another law has values that this plant does not use
        others = Part(told.plant_name).parameters
    values, _ = told.plant_values(Part(plant).parameters, others)
    note_aside(told, values, plant)
    return values


def note_aside(told: ParameterFile, values: Collection[str], plant: str) -> None:
    """Report which of the file's values a plant does not use."""
    aside = [n for n in (*told.plant, *told.found) if n not in values]
    if aside:
        _note(told, f"{', '.join(aside)}: {plant} has no such parameter")


def _controller_values(told: ParameterFile, name: str) -> dict[str, float]:
    from .orchestration.loop import table_of
    from .orchestration.parts import Part

    table = table_of(told, Part(name))
    if table not in told.controllers:
        return {}
    return told.controller_values(table, Part(name).parameters)


def _note_other_fmus(told: ParameterFile, controllers: Sequence[str]) -> None:
    """Report tables of controllers that do not run here and are not known."""
    from .controllers import CONTROLLERS
    from .orchestration.loop import table_of
    from .orchestration.parts import Part

    parts = [Part(c) for c in controllers]
    known = {*CONTROLLERS, *(p.label for p in parts), *(table_of(told, p) for p in parts)}
    for name in told.controllers:
        if name not in known:
            _note(told, f"[controller.{name}]: no controller of this name runs here")


def _note(told: ParameterFile, what: str) -> None:
    print(f"note: {told.path}: {what}; left aside", file=sys.stderr)


def apart(told: ParameterFile | None, name: str) -> tuple[str, tuple[str, ...]]:
    """A controller and its instruments as in an .ssp, each with its own values.

    Raises
    ------
    BadRequest
        If the file has values for both as one part.
    """
    from .instruments import without_instruments, without_units
    from .orchestration.parts import Part

    plain, units = without_units(name)
    base, instruments = without_instruments(plain)
    if told and instruments and Part(name).label in told.controllers:
        raise BadRequest(
            f"{told.path}: [controller.{Part(name).label}] is for one part, but in an .ssp its "
            "instruments are separate parts; export without --params, and run with --set "
            "ELEMENT.VARIABLE=VALUE"
        )
    return base + units, tuple(i + units for i in instruments)


def plant_of(asked: str | None, told: ParameterFile | None) -> str:
    """The requested plant, else the one that a parameter file describes, else the default one.

    Raises
    ------
    BadRequest
        If the file describes none.
    """
    if asked is not None:
        return asked
    with bad_parameters():
        return told.plant_name if told else "plant"


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
    BadRequest
    """
    if told is None:
        return kernel
    from .fmus.start_values import with_start_values
    from .orchestration.loop import table_of
    from .orchestration.parts import Part
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
    with bad_parameters():
        if plant:
            add(PLANT, guard(lambda: _plant_values(told, plant)), of_plant)
            add(CONTROLLER, _controller_values(told, name), of_controller)
        elif _is_plant(name):
            add("", _plant_values(told, name), of_plant)
        else:
            add("", _controller_values(told, name), of_controller)
    return with_start_values(kernel, values, sources)


def _is_plant(part: str) -> bool:
    """Whether a part is on the plant's side: it has no measurement or set-point."""
    from .fmus.catalogue import component
    from .instruments import bare
    from .plant import PLANTS
    from .solver.component_file import names_file

    if not names_file(bare(part)):
        return bare(part) in PLANTS
    return not any(i.role in ("measurement", "reference") for i in component(part).inputs)
