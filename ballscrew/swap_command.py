"""``ballscrew swap``: several controllers on one plant."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from .console import Progress, comparison_table, complain
from .loop_options import add_closed_loop_options, read_practice_loops
from .options import BAD_REQUEST, NOT_TRUSTED, PART, TRUSTED
from .plant.instruments import INSTRUMENTS
from .results_folder import prepare_folder, save_results


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add this command to those of the program."""
    parser = commands.add_parser(
        "swap",
        help="run several controllers on the same plant and compare them",
        description="Write report.html, comparison.csv, comparison.json, comparison.png, "
        "parameters.toml and a trajectory of each controller.",
        epilog="examples:\n  ballscrew swap --controllers iol mine.py:pi hand.fmu --out out/swap\n"
        "  ballscrew swap --controllers pid theirs.fmu --sampled 1e-3 --out out/digital\n"
        "  ballscrew swap --controllers iol_observed pid --sampled 1e-3 --noise --out out/real\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--controllers", required=True, nargs="+", metavar="PART", help=f"each {PART}"
    )
    parser.add_argument(
        "--noise",
        action="store_true",
        help="let every controller measure through the instruments that fit it, including their "
        "errors: "
        f"{', '.join(INSTRUMENTS)}",
    )
    add_closed_loop_options(parser)
    parser.set_defaults(action=swap_controllers)


def swap_controllers(options: argparse.Namespace) -> int:
    loops = read_practice_loops(options, options.controllers, "--controllers", options.noise)
    prepare_folder(options.out, [options.params, options.reference])
    from . import api
    from .orchestration.loop.metrics import units_of_figures
    from .solver.files import finite_or_null

    progress = Progress(loops[0].stop)
    result = api.swap(loops, progress=lambda name, t: progress(t, name))
    progress.finish()
    save_results(options.out, lambda folder: result.save(folder, command=options.command))
    if options.json:
        print(json.dumps(finite_or_null([r.figures() for r in result.results])))
    else:
        units = units_of_figures(result.results[0].run.units)
        print(comparison_table([r.figures() for r in result.results], units))
        files = ["report.html", "comparison.csv", "comparison.json", "comparison.png"]
        print(f"{', '.join([*files, 'parameters.toml', *result.trajectories])} in {options.out}")
    for r in result.results:
        for note in r.notes:
            print(f"note: {r.loop.label}: {note}", file=sys.stderr)
        if not r.trusted:
            figures = r.figures()
            print(
                f"{figures['controller']}: {figures['verdict']}: {figures['verdict_reason']}",
                file=sys.stderr,
            )
    for label, why in result.failures:
        complain(f"{label} was left out: {why}")
    if result.failures:
        return BAD_REQUEST
    return TRUSTED if result.trusted else NOT_TRUSTED
