"""``ballscrew swap``: several controllers on one plant."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from .console import Progress, comparison_table
from .loop_options import add_closed_loop_options, read_studies
from .options import NOT_TRUSTED, PART, TRUSTED, guarded
from .results_folder import prepare_folder, save_results


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add this command to those of the program."""
    parser = commands.add_parser(
        "swap",
        help="run several controllers on the same plant and compare them",
        epilog="example:\n  ballscrew swap --controllers iol mine.py:pi hand.fmu --out out/swap\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--controllers", required=True, nargs="+", metavar="PART", help=f"each {PART}"
    )
    add_closed_loop_options(parser)
    parser.set_defaults(action=swap_controllers)


def swap_controllers(options: argparse.Namespace) -> int:
    studies = read_studies(options, options.controllers, "--controllers")
    prepare_folder(options.out, [options.params, options.reference])
    from .orchestration.metrics import units_of_figures
    from .orchestration.swap import swap
    from .results.comparison import Comparison
    from .solver.files import finite_or_null

    progress = Progress(studies[0].stop)
    result = Comparison.of(guarded(lambda: swap(studies, lambda name, t: progress(t, name))))
    progress.finish()
    save_results(options.out, result.save)
    if options.json:
        print(json.dumps(finite_or_null([r.figures() for r in result.results])))
    else:
        units = units_of_figures(result.results[0].run.units)
        print(comparison_table([r.figures() for r in result.results], units))
        files = ["comparison.csv", "comparison.json", "comparison.png", "parameters.toml"]
        print(f"{', '.join([*files, *result.trajectories])} in {options.out}")
    for r in result.results:
        for note in r.notes:
            print(f"note: {r.study.label}: {note}", file=sys.stderr)
        if not r.trusted:
            figures = r.figures()
            print(
                f"{figures['controller']}: {figures['verdict']}: {figures['verdict_reason']}",
                file=sys.stderr,
            )
    return TRUSTED if result.trusted else NOT_TRUSTED
