"""``ballscrew compare``: how well the model of a parameter file does on records."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Stages
from .options import TRUSTED, BadRequest, out_folder
from .params_option import bad_parameters
from .record_options import add_record_options, print_notes, read_record_options
from .results_folder import prepare_folder, save_results

if TYPE_CHECKING:
    from .diagnosis.blocks import Estimate
    from .diagnosis.compared import Compared, Left

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
_WIDE = 31  # of a column of figures


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "compare",
        help="compare a model with a record: its errors in force and in position",
        description="Print the errors of the model of a parameter file on a record: of the "
        "force, by part of the motion, and of the position predicted from the start of each "
        "second. "
        "Nothing is fitted. With --out: compare.json and a picture.",
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
    add("--out", type=out_folder, metavar="DIR", help="folder for compare.json and compare.png")
    add("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(action=_compare)


def _compare(options: argparse.Namespace) -> int:
    columns = read_record_options(options)
    if options.out is not None:
        prepare_folder(options.out, [*options.data, options.params])
    from .diagnosis.compare import compare
    from .records.bad_record import BadRecord
    from .results.model_comparison import ModelComparison
    from .solver.files import finite_or_null

    progress = Stages()
    told = columns.mapping, columns.units, columns.lead
    try:
        with bad_parameters():
            result = ModelComparison.of(compare(options.data, options.params, *told, progress))
    except BadRecord as error:
        raise BadRequest(str(error)) from error
    finally:
        progress.finish()
    if options.out is not None:
        save_results(options.out, result.save)
    if options.json:
        print(json.dumps(finite_or_null(result.to_dict())))
    else:
        print(result.say(table(result)))
    if options.out is not None and not options.json:
        print(f"compare.json and compare.png in {options.out}")
    print_notes(result.notes, options.json)
    return TRUSTED


def table(result: Compared) -> str:
    """The result as text, with 95 % intervals in brackets."""
    says = f"{result.says}."
    lines = [says[0].upper() + says[1:], f"{', '.join(result.records)}, {result.seconds:.3g} s"]
    if result.diagnosed:
        causes = ", ".join(result.causes) or "no cause"
        lines.append(f"diagnosed of {', '.join(result.diagnosed)}; corrected: values, and {causes}")
    positions = [e.value for m in result.models.values() for f in m.values() if (e := f.position)]
    per_metre, unit = (1e3, "mm") if max(positions, default=0.0) >= 1e-3 else (1e6, "um")
    lines += _block(result, "force [N]", 1.0, lambda left: left.force)
    lines += _block(result, f"position within 1 s [{unit}]", per_metre, lambda left: left.position)
    if result.gains:
        titles = "".join(f"{t:>{_WIDE}}" for t in ("force [%]", "position [%]"))
        lines += ["", f"{'gain, in % of the mean square':<40}{titles}"]
    for g in result.gains:
        figures = "".join(f"{_figure(e, 100.0):>{_WIDE}}" for e in (g.force, g.position))
        lines.append(f"{f'{g.model} over {g.over}':<40}{figures}")
    return "\n".join(lines)


def _block(
    result: Compared, title: str, size: float, of: Callable[[Left], Estimate | None]
) -> list[str]:
    """Lines of the residuals: by part of the motion, one column for each model."""
    from .diagnosis.compared import ALL

    def row(label: str, figures: Iterable[str]) -> str:
        return f"{label:<40}" + "".join(f"{figure:>{_WIDE}}" for figure in figures)

    models = result.models.values()
    whole = [_figure(of(left), size) for left in (*(m[ALL] for m in models), result.floor)]
    return [
        "",
        row(f"{title}, rms (95 %)", (*result.models, "noise alone")),
        row("in all", whole),
        *(
            row(
                f"  {part}, {100 * share:.2g} % of the time",
                (_figure(of(m[part]), size) for m in models),
            )
            for part, share in result.shares.items()
        ),
    ]


def _figure(found: Estimate | None, size: float) -> str:
    if found is None:
        return "-"
    value = f"{size * found.value:.3g}"
    if found.interval is None:
        return value
    low, high = (f"{size * end:.3g}" for end in found.interval)
    return f"{value} ({low} to {high})"
