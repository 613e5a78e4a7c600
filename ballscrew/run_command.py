"""``ballscrew run``: one closed loop."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from .console import Progress, print_figures, print_notes
from .controllers import CONTROLLERS
from .loop_options import add_closed_loop_options, read_practice_loops, read_system_loop
from .options import NOT_TRUSTED, OWN, TRUSTED
from .results_folder import prepare_folder, save_results

_EXAMPLES = """examples:
  ballscrew run --controller nctf --out out
  ballscrew run --controller iol --set controller.sigma0_hat=66966.331 --out out
  ballscrew run --controller mine.py:pi --out out
  ballscrew run --controller mine.fmu --map position=x --map voltage=u --out out
  ballscrew run --controller theirs.fmu --sampled 1e-3 --out out
  ballscrew run --controller iol --coupling monolithic --out reference
  ballscrew run --system loop.ssp --set plant.sigma0=6e4 --out out
  ballscrew run --controller pid --params out/identified/parameters.toml --out out/pid
"""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add this command to those of the program."""
    parser = commands.add_parser(
        "run",
        help="run a closed loop",
        description="Write report.html, trajectory.csv, metrics.json, parameters.toml and "
        "pictures.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--controller",
        metavar="PART",
        help=f"{', '.join(CONTROLLERS)}, {OWN}",
    )
    what.add_argument(
        "--system", type=Path, metavar="SSP", help="an .ssp with a plant and its controller"
    )
    add_closed_loop_options(parser)
    parser.set_defaults(action=run)


def run(options: argparse.Namespace) -> int:
    loop = (
        read_system_loop(options)
        if options.system
        else read_practice_loops(options, [options.controller])[0]
    )
    prepare_folder(options.out, [options.params, options.reference])
    from . import api
    from .orchestration.loop.metrics import units_of_figures
    from .solver.files import finite_or_null

    progress = Progress(loop.stop)
    result = api.run(loop, progress=progress)
    progress.finish()
    save_results(options.out, lambda folder: result.save(folder, command=options.command))
    figures = result.figures()
    if options.json:
        print(json.dumps(finite_or_null(figures)))
    else:
        print_figures(figures, units_of_figures(result.run.units), options.out)
    if not result.trusted:
        print(f"{figures['verdict']}: {figures['verdict_reason']}", file=sys.stderr)
        if figures["advice"]:
            print(figures["advice"], file=sys.stderr)
    print_notes(result.notes)
    return TRUSTED if result.trusted else NOT_TRUSTED
