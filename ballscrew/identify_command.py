"""``ballscrew identify``: friction parameters from recorded files."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Stages, text_of
from .options import NOT_TRUSTED, TRUSTED, check_name, out_folder, read_named, read_number
from .params_option import add_params, read_params
from .plant import LAWS
from .record_options import add_record_options, print_notes, read_record_options
from .results_folder import prepare_folder, save_results
from .solver.errors import UserError

if TYPE_CHECKING:
    from .orchestration.loop.parameter_file import ParameterFile

_EXAMPLES = """DATA are folders written by `ballscrew rig`, or files of measured data with the
columns time [s], force [N] (on the block, positive in +x) and x [m], x_fine [m] or v [m/s].
Separators, decimal commas, lines before the table and a line of units are detected automatically; a
column without a name is called by its number. A rotary drive has x in rad, deg or rev, or v in rpm,
and its torque as force.

examples:
  ballscrew identify out/trials --law modified_lugre --out out/identified
  ballscrew identify a.csv b.csv --law dahl --map t=time --map F=force \
    --unit time=s --unit force=N --unit x=mm --out out/dahl
  ballscrew identify out/trials --law lugre --params out/trials/parameters.toml --out out/lugre
  ballscrew identify drive.csv --law lugre --map "Pos. [deg]=x" --map Torque=force \
    --unit force=mN*m --lead 0.005 --out out/drive
  ballscrew identify run.mat --law lugre --map qm=x --map t=time --unit x=m \
    --unit time=s --mass 95 --out out/emps
  ballscrew identify a.csv b.csv --law classical --offset --fix Vs=1e-3 --out out/loaded
  ballscrew identify drive.csv --law classical --mass fit --offset --out out/drive
  ballscrew identify shaken.csv --response --out out/response
"""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "identify",
        help="find friction parameters in recorded data",
        description="Write the parameters with their intervals, what cannot be identified and "
        "why, a parameter file, report.html, and pictures. Exit code 1: a parameter is not "
        "identified, or the law does not describe the records.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "data",
        nargs="+",
        type=Path,
        metavar="DATA",
        help="rig folders, or files: text, MAT, TDMS, MDF, HDF5, Excel, Parquet, NumPy",
    )
    add("--law", metavar="NAME", help=", ".join(LAWS))
    add("--out", required=True, type=out_folder, metavar="DIR")
    add_record_options(add)
    add(
        "--mass",
        metavar="KG",
        help="mass between load cell and block, or `fit` (default m of --params, the rig's, or 1)",
    )
    add(
        "--fix",
        action="append",
        default=[],
        metavar="NAME[=VALUE]",
        help="fix a parameter of the law, or the offset, at a value in SI units (default that of "
        "--params)",
    )
    add(
        "--offset",
        action="store_true",
        help="also fit a constant force: a load, or the zero error of the load cell; positive "
        "against motion in +x",
    )
    add(
        "--response",
        action="store_true",
        help="instead of a law, compute the frequency response from force (or u, i) to position "
        "from one record with a multisine, chirp or noise, with coherence and first resonance",
    )
    add_params(
        add,
        "parameter file with known values; the written file keeps the values that "
        "these records do not identify",
    )
    add("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(action=_identify)


def _identify(options: argparse.Namespace) -> int:
    if options.response:
        return _response(options)
    if options.law is None:
        raise UserError("--law is missing; expected a law, or --response for a frequency response")
    check_name("--law", options.law, LAWS)
    columns = read_record_options(options)
    mass: float | bool = options.mass == "fit"
    if options.mass and not mass:
        mass = read_number("--mass", options.mass)
    told = read_params(options)
    fixed = _fixed(options.fix, told)
    from .measured_results import IdentifiedLaw
    from .measurement.identification.identify import identify_files
    from .orchestration.loop.shown_units import words_for

    prepare_folder(options.out, [*options.data, options.params])
    progress = Stages()
    given = options.law, fixed, options.offset, told, mass
    try:
        result = IdentifiedLaw.of(identify_files(options.data, *given, *columns, progress=progress))
    finally:
        progress.finish()
    save_results(options.out, lambda folder: result.save(folder, command=options.command))
    words = words_for(result.notes)
    if options.json:
        print(json.dumps(result.to_dict()))
    else:
        *tables, _ = result.tables()
        print(words("\n\n".join(map(text_of, tables))))
        files = "report.html, identified.json, parameters.toml, friction_map and residuals"
        print(f"{files} in {options.out}")
    of_records = [f"{r.name}: {note}" for r in result.records for note in r.notes]
    print_notes([*result.notes, *of_records], options.json)
    for name, interval in result.parameters.items():
        if not interval.identified:
            print(
                words(
                    f"{name} cannot be identified from these trials, because {interval.because}; "
                    f"{interval.would_do}"
                ),
                file=sys.stderr,
            )
    for warning in result.warnings:
        if warning.split(":")[0] not in result.parameters:
            print(words(f"not trusted: {warning}"), file=sys.stderr)
    return TRUSTED if result.trusted else NOT_TRUSTED


def _response(options: argparse.Namespace) -> int:
    """The frequency response of one record; a law and its options are rejected."""
    refused = [f"--{n}" for n in ("law", "mass", "fix", "offset") if getattr(options, n)]
    if refused or len(options.data) != 1:
        got = ", ".join(refused) or f"{len(options.data)} files"
        raise UserError(f"--response: got {got} with it; expected one record and no law")
    columns = read_record_options(options)
    from .measurement.identification.identification_pictures import response_figure
    from .measurement.identification.response import frequency_response
    from .measurement.records.reading import read_response_record
    from .orchestration.loop.pictures import drawing, write_figure

    lead = columns.lead_with(read_params(options))
    record = read_response_record(options.data[0], columns.mapping, columns.units, lead)
    result = frequency_response(record)
    prepare_folder(options.out, [*options.data, options.params])

    def save(folder: Path) -> None:
        result.save(folder)
        with drawing():
            write_figure(response_figure(result), folder, "response")

    save_results(options.out, save)
    if options.json:
        print(json.dumps(result.to_dict()))
    else:
        print(result.said)
        print(f"response.json, response.csv and response.png in {options.out}")
    print_notes(record.notes, options.json)
    return TRUSTED if result.highest > 0 else NOT_TRUSTED


def _fixed(texts: Sequence[str], told: ParameterFile | None) -> dict[str, float]:
    """Values of ``--fix``; names without a value take it from the parameter file."""

    given = read_named("--fix", [t for t in texts if "=" in t], "NAME=VALUE")
    fixed = {name: read_number(f"--fix {name}", text) for name, text in given.items()}
    for name in (t for t in texts if "=" not in t):
        if name in fixed:
            raise UserError(f"--fix {name} is given twice; expected once")
        if told is None or name not in told.plant:
            raise UserError(
                f"--fix {name}: it has no value; use --fix {name}=VALUE, or give {name} in --params"
            )
        fixed[name] = told.plant[name].value
    return fixed
