"""``ballscrew export``: components, loops and systems as files."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import native_command
from .console import tell_export
from .controllers import CONTROLLERS
from .instruments import INSTRUMENTS
from .options import TRUSTED, BadRequest, out_folder, read_part, read_whole_number
from .params_option import (
    add_params,
    apart,
    bad_parameters,
    kernel_with_values,
    plant_of,
    read_params,
)
from .plant import PLANTS
from .results_folder import prepare_folder, write_or_refuse
from .sides import check_labels

if TYPE_CHECKING:
    from .orchestration.parameter_file import ParameterFile


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add this command to those of the program."""
    parser = commands.add_parser(
        "export",
        help="write the components as FMUs",
        epilog="examples:\n  ballscrew export --out fmus --only plant iol\n"
        "  ballscrew export --ssp --out loops\n"
        "  ballscrew export --ssp --only pid_sampled+position_encoder --out loops\n"
        "  ballscrew export --native --platforms linux64,win64 --out native\n"
        "  ballscrew export --loop iol --native --out loops\n"
        "  ballscrew export --loop pid --plant mine.py:axis --out loops\n"
        "  ballscrew export --component mine.py:pi --native --out native\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", required=True, type=out_folder, metavar="DIR")
    parser.add_argument(
        "--component",
        "--only",
        dest="only",
        nargs="+",
        metavar="PART",
        help=f"some of {', '.join([*PLANTS, *CONTROLLERS, *INSTRUMENTS])}; or mine.py:pi, a "
        "function of a Python file that returns a Component; or CONTROLLER+INSTRUMENT+..., a "
        "controller that measures through instruments",
    )
    parser.add_argument(
        "--ssp",
        action="store_true",
        help="instead, write one .ssp per closed loop: all FMUs, wired, with parameter sets; of "
        "CONTROLLER+INSTRUMENT each instrument is an FMU, too; with --native, of native FMUs",
    )
    parser.add_argument(
        "--loop",
        metavar="PART",
        help="instead, write one FMU of the whole closed loop with this controller, set-point in "
        f"and signals out: one of {', '.join(CONTROLLERS)}, or mine.py:pi; or CONTROLLER+"
        "INSTRUMENT+...",
    )
    parser.add_argument(
        "--plant",
        metavar="PART",
        help="with --loop or --ssp: in place of our plant another of "
        f"{', '.join(PLANTS)}, or mine.py:axis",
    )
    parser.add_argument(
        "--variational",
        action="store_true",
        help="instead, write FMUs that carry tangent vectors, for exponents over FMUs",
    )
    parser.add_argument(
        "--tangents",
        metavar="N",
        help="with --variational: tangents, as many as the loop has states (default 5)",
    )
    native_command.add_options(parser.add_argument)
    add_params(parser.add_argument, "its values become the FMUs' start values")
    parser.set_defaults(action=export)


def export(options: argparse.Namespace) -> int:
    whole = options.ssp or options.loop is not None
    known = [*CONTROLLERS] if whole else [*PLANTS, *CONTROLLERS, *INSTRUMENTS]
    if options.loop is not None:
        for other in ("only", "ssp", "variational"):
            if getattr(options, other):
                raise BadRequest(f"--loop and --{other}: expected one of them")
    told = read_params(options)
    names = _names(options, told, known)
    option = "--component" if options.loop is None else "--loop"
    for name in names:
        read_part(option, name, known, fmus=False)
    check_labels(option, names)
    if options.plant is not None:
        if not whole:
            raise BadRequest("--plant is for --loop and --ssp; of a plant alone say --component")
        read_part("--plant", options.plant, PLANTS, fmus=False)
    if options.variational and options.ssp:
        raise BadRequest("--variational and --ssp: expected one of them")
    if options.tangents is not None and not options.variational:
        raise BadRequest("--tangents makes no sense without --variational")
    tangents = read_whole_number("--tangents", options.tangents or "5", 1, 12)
    native_command.check(options)
    prepare_folder(options.out)
    if options.native and options.ssp:
        return native_command.export_systems(options, names, told)
    if options.native:
        return native_command.export(options, names, tangents, told)
    from .fmus.catalogue import name_of
    from .fmus.system_export import CannotConnect
    from .fmus.units import BadUnit
    from .solver.contract_error import ContractError
    from .solver.tape import UnsupportedComponent

    for name in names:
        tell_export(names, name)
        kind = "_variational" if options.variational else "_loop" if options.loop else ""
        label = name_of(name)
        target = options.out / (f"{label}.ssp" if options.ssp else f"{label}{kind}.fmu")
        try:
            _export_one(options, name, tangents, told, target)
        except (ContractError, UnsupportedComponent, BadUnit, CannotConnect) as error:
            if options.only or options.loop:
                raise BadRequest(str(error)) from error
            print(f"left out: {error}", file=sys.stderr)
            continue
        print(target)
    return TRUSTED


def _names(options: argparse.Namespace, told: ParameterFile | None, known: list[str]) -> list[str]:
    """What to export; of a parameter file the one plant that it describes, if none is named."""
    if options.loop is not None:
        return [options.loop]
    if options.only:
        return list(options.only)
    if told is None or options.ssp:
        return known
    with bad_parameters():
        return [told.plant_name, *CONTROLLERS, *INSTRUMENTS]


def _export_one(
    options: argparse.Namespace,
    name: str,
    tangents: int,
    told: ParameterFile | None,
    target: Path,
) -> None:
    """Write one FMU or .ssp with the start values of a parameter file, or the nominal ones."""
    from .fmus import catalogue
    from .fmus.export import export_kernel
    from .fmus.start_values import with_set_point
    from .fmus.system_export import export_system
    from .solver.files import write_atomically

    plant = plant_of(options, told) if options.ssp or options.loop else ""
    if options.ssp:
        with tempfile.TemporaryDirectory(prefix="ballscrew-export-") as folder:

            def fmu(part: str, side: str) -> Path:
                # under the part's own name, which complaints tell
                path = Path(folder) / side / f"{catalogue.name_of(part)}.fmu"
                kernel = with_set_point(catalogue.fmu_kernel(part))
                if told is None:
                    path.parent.mkdir(exist_ok=True)
                    return Path(shutil.copyfile(catalogue.stored_fmu(kernel), path))
                return export_kernel(kernel_with_values(told, part, kernel), path)

            base, instruments = apart(told, name)
            sides = fmu(plant, "plant"), fmu(base, "controller"), target
            between = {n: fmu(n, "between") for n in instruments}
            label = catalogue.name_of(name)
            write_or_refuse(partial(export_system, *sides, name=label, instruments=between))
        return
    if options.variational:
        kernel = catalogue.variational_kernel(name, tangents)
    elif options.loop:
        kernel = catalogue.loop_fmu_kernel(name, plant)
    else:
        kernel = catalogue.fmu_kernel(name)
    if told:
        kernel = kernel_with_values(told, name, kernel, plant)
        write_or_refuse(lambda: export_kernel(kernel, target))
    else:
        if options.variational:
            made = catalogue.variational_fmu(name, tangents)
        else:
            made = catalogue.loop_fmu(name, plant) if options.loop else catalogue.fmu(name)
        write_or_refuse(partial(write_atomically, target, made.read_bytes()))
    if not options.variational:
        native_command.add_reference(kernel, target)
