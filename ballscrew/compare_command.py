"""``ballscrew compare``: how well the model of a parameter file does on records."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Stages, text_of
from .options import TRUSTED, out_folder
from .record_options import add_record_options, print_notes, read_record_options
from .results_folder import prepare_folder, save_results

if TYPE_CHECKING:
    from .measured_results import ModelComparison

_EXAMPLES = """RECORD are files of measured data with the columns time [s], u [V] and x [m], or v
[m/s] if no position was recorded. If there is i [A] and no u, i is used as the command. FILE.toml
is a file of identify or diagnose, or your own, see docs/parameters.md. For a file of diagnose,
three models are compared: the prior one, the one with adjusted values, and the corrected one.

examples:
  ballscrew compare run.csv --params axis.toml
  ballscrew compare other.csv --params out/diagnosis/parameters.toml --out out/compare
  ballscrew compare emps.mat --params emps.toml --map vir=u --map qm=x --map t=time \\
    --unit time=s --unit x=m --unit u=V --out out/emps
  ballscrew compare drive.csv --params drive.toml --unit time=ms --unit x=deg --unit u=N*m \\
    --lead 0.005 --json
"""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "compare",
        help="compare a model with a record: its errors in force and in position",
        description="Print the errors of the model of a parameter file on a record: of the "
        "force, by part of the motion, and of the position predicted from the start of each "
        "second. "
        "Nothing is fitted. With --out: compare.json, report.html and a picture.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "data",
        nargs="+",
        type=Path,
        metavar="RECORD",
        help="text, MAT, TDMS, MDF, HDF5, Excel, Parquet or NumPy files",
    )
    add("--params", required=True, type=Path, metavar="FILE.toml", help="parameter file: the model")
    add_record_options(add)
    add(
        "--out",
        type=out_folder,
        metavar="DIR",
        help="folder for the results",
    )
    add("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(action=_compare)


def _compare(options: argparse.Namespace) -> int:
    columns = read_record_options(options)
    if options.out is not None:
        prepare_folder(options.out, [*options.data, options.params])
    from .measured_results import ModelComparison
    from .measurement.diagnosis.compare import compare
    from .solver.files import finite_or_null

    progress = Stages()
    told = columns.mapping, columns.units, columns.lead
    try:
        result = ModelComparison.of(compare(options.data, options.params, *told, progress))
    finally:
        progress.finish()
    if options.out is not None:
        save_results(options.out, lambda folder: result.save(folder, command=options.command))
    if options.json:
        print(json.dumps(finite_or_null(result.to_dict())))
    else:
        print(result.say(table(result)))
    if options.out is not None and not options.json:
        print(f"compare.json, compare.png and report.html in {options.out}")
    print_notes(result.notes, options.json)
    return TRUSTED


def table(result: ModelComparison) -> str:
    """The result as text, with 95 % intervals in brackets."""
    *figures, about = map(text_of, result.tables())
    says = result.says[0].upper() + result.says[1:]
    return "\n\n".join([f"{says}.\n{about}", *figures])
