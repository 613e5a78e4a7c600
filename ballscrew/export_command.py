"""``ballscrew export``: components, loops and systems as files."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import print_notes, tell_export
from .controllers import CONTROLLERS
from .exporting import Export
from .options import BAD_REQUEST, TRUSTED, out_folder, read_part, read_whole_number
from .params_option import add_params, read_params
from .plant import PLANTS
from .plant.instruments import INSTRUMENTS
from .results_folder import prepare_folder, write_or_refuse
from .sides import check_labels
from .solver.errors import ContractError, FmuError, UserError
from .solver.files import temporary_folder

if TYPE_CHECKING:
    from .orchestration.loop.parameter_file import ParameterFile

DEFAULTS = ("plant", "iol", "nctf", "pid")
"""What is written if nothing is named."""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add this command to those of the program."""
    parser = commands.add_parser(
        "export",
        help="write the components as FMUs",
        epilog="examples:\n  ballscrew export --out fmus --only plant iol\n"
        "  ballscrew export --all --out fmus\n"
        "  ballscrew export --ssp --out loops\n"
        "  ballscrew export --ssp --only pid_sampled+position_encoder --out loops\n"
        "  ballscrew export --native --platforms linux64,win64 --out native\n"
        "  ballscrew export --loop iol --native --out loops\n"
        "  ballscrew export --loop pid --plant mine.py:axis --out loops\n"
        "  ballscrew export --component mine.py:pi --native --out native\n"
        "  ballscrew export --modelica --component plant pid --out modelica\n",
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
        "function of a Python file that returns a Component; or CONTROLLER+feed_forward, which "
        "receives the derivatives of the set-point; or CONTROLLER+INSTRUMENT+..., a controller "
        "that measures "
        f"through instruments (default: {', '.join(DEFAULTS)}; with --params its plant)",
    )
    parser.add_argument(
        "--all", action="store_true", help="write every part that --component names, or every loop"
    )
    parser.add_argument(
        "--ssp",
        action="store_true",
        help="instead, write one .ssp per closed loop: all FMUs, connected, with parameter "
        "sets; in CONTROLLER+INSTRUMENT each instrument is an FMU; with --native, the FMUs are "
        "native; "
        "with --fmi 3 an SSP 2.0",
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
        help=f"with --loop or --ssp: another plant: {', '.join(PLANTS)}, or mine.py:axis",
    )
    parser.add_argument(
        "--variational",
        action="store_true",
        help="instead, write FMUs with tangent vectors, for Lyapunov exponents over FMUs",
    )
    parser.add_argument(
        "--tangents",
        metavar="N",
        help="with --variational: number of tangent vectors, equal to the number of states of the "
        "loop (default 5)",
    )
    parser.add_argument(
        "--modelica",
        action="store_true",
        help="write Modelica source, NAME.mo, of parts or, with --loop, of a loop; "
        "without events, samples and delays",
    )
    parser.add_argument(
        "--native",
        action="store_true",
        help="write FMUs of compiled C, for hosts without Python; also with --variational, "
        "--loop or --ssp",
    )
    parser.add_argument("--fmi", metavar="2|3", help="with --native: version of FMI (default 2)")
    parser.add_argument(
        "--platforms",
        metavar="NAME,...",
        help="with --native: one or more of linux64,win64,darwin64 (default: this platform)",
    )
    add_params(
        parser.add_argument, "parameter file: its values become the start values of the FMUs"
    )
    parser.set_defaults(action=export)


def _around(told: ParameterFile | None, plant: str | None) -> str:
    from .orchestration.loop.loop import plant_of

    return plant_of(told, plant)


def export(options: argparse.Namespace) -> int:
    whole = options.ssp or options.loop is not None
    known = [*CONTROLLERS] if whole else [*PLANTS, *CONTROLLERS, *INSTRUMENTS]
    if options.loop is not None:
        for other in ("only", "all", "ssp", "variational"):
            if getattr(options, other):
                raise UserError(f"--loop and --{other}: expected one of them")
    if options.only and options.all:
        raise UserError("--component and --all: expected one of them")
    told = read_params(options)
    names = _names(options, told, known)
    option = "--component" if options.loop is None else "--loop"
    for name in names:
        read_part(option, name, known, fmus=False)
    check_labels(option, names)
    if options.plant is not None:
        if not whole:
            raise UserError("--plant is for --loop and --ssp; for a plant alone use --component")
        read_part("--plant", options.plant, PLANTS, fmus=False)
    if options.variational and options.ssp:
        raise UserError("--variational and --ssp: expected one of them")
    if options.tangents is not None and not options.variational:
        raise UserError("--tangents needs --variational")
    for other in ("native", "ssp", "variational"):
        if options.modelica and getattr(options, other):
            raise UserError(f"--modelica and --{other}: expected one of them")
    tangents = read_whole_number("--tangents", options.tangents or "5", 1, 12)
    platforms = _read_native(options)
    prepare_folder(options.out)
    how = Export(
        _around(told, options.plant) if whole else "",
        tangents if options.variational else 0,
        told,
        options.native,
        int(options.fmi or 2),
        platforms,
    )
    from .orchestration.loop.catalogue import name_of
    from .solver.compilers import CompilerFailed

    kind = "_variational" if options.variational else "_loop" if options.loop else ""
    ending = ".ssp" if options.ssp else kind + (".mo" if options.modelica else ".fmu")
    with temporary_folder("export") as folder:
        for name in names:
            tell_export(names, name)
            target = options.out / (name_of(name) + ending)
            try:
                write = partial(how.write, name, target, Path(folder))
                made = write_or_refuse(write)
            except (ContractError, FmuError) as error:
                if options.only or options.loop:
                    raise
                print(f"left out: {error}", file=sys.stderr)
                continue
            except CompilerFailed as error:
                print(f"ballscrew: {error}", file=sys.stderr)
                return BAD_REQUEST
            print(target)
            print_notes(filter(None, [made.note]))
    return TRUSTED


def _read_native(options: argparse.Namespace) -> list[str] | None:
    """The platforms; options that cannot be combined are rejected before any work is done."""
    from .solver.compilers import platforms_of

    for option in ("fmi", "platforms"):
        if getattr(options, option) is not None and not options.native:
            raise UserError(f"--{option} needs --native")
    if options.fmi not in (None, "2", "3"):
        raise UserError(f"--fmi is {options.fmi!r}, expected one of 2, 3")
    platforms = None if options.platforms is None else options.platforms.split(",")
    known = platforms_of(int(options.fmi or 2))
    for name in platforms or ():
        if name not in known:
            raise UserError(
                f"--platforms: no platform {name!r}; there are {', '.join(known)} "
                f"with --fmi {options.fmi or 2}"
            )
    return platforms


def _names(options: argparse.Namespace, told: ParameterFile | None, known: list[str]) -> list[str]:
    """What to export; a parameter file's plant takes the place of all plants."""
    if options.loop is not None:
        return [options.loop]
    if options.only:
        return list(options.only)
    names = known if options.all else [name for name in DEFAULTS if name in known]
    if told is None or options.ssp:
        return names
    return [told.plant_name, *(name for name in names if name not in PLANTS)]
