"""``ballscrew swap``: several controllers on one plant."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .console import Progress, comparison_table, complain
from .controllers import CONTROLLERS
from .instruments import INSTRUMENTS
from .loop_options import add_closed_loop_options, read_closed_loops
from .options import (
    BAD_REQUEST,
    NOT_TRUSTED,
    PART,
    TRUSTED,
    BadRequest,
    guard,
    read_number,
    read_part,
)
from .results_folder import prepare_folder, save_results

if TYPE_CHECKING:
    from .orchestration.loop import Loop


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add this command to those of the program."""
    parser = commands.add_parser(
        "swap",
        help="run several controllers on the same plant and compare them",
        description="Write report.html, comparison.csv, comparison.json, comparison.png, "
        "parameters.toml and a trajectory of each controller.",
        epilog="examples:\n  ballscrew swap --controllers iol mine.py:pi hand.fmu --out out/swap\n"
        "  ballscrew swap --controllers iol_observed pid --sampled 1e-3 --noise --out out/real\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--controllers", required=True, nargs="+", metavar="PART", help=f"each {PART}"
    )
    parser.add_argument(
        "--sampled",
        metavar="PERIOD",
        help="sample every controller with this period [s]: it reads at sample "
        "instants and holds its commands",
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


def _loops(options: argparse.Namespace) -> list[Loop]:
    """The controllers to run, sampled and with instruments as the options say."""
    from .orchestration.in_practice import in_practice

    option, asked = "--controllers", options.controllers
    if options.sampled is None and not options.noise:
        return read_closed_loops(options, asked, option)
    period = None
    if options.sampled is not None:
        period = read_number("--sampled", options.sampled)
        if period <= 0:
            raise BadRequest(f"--sampled is {options.sampled} s, expected more than 0")
    parts = [read_part(option, controller, CONTROLLERS) for controller in asked]
    put = [guard(lambda p=p: in_practice(p, period, options.noise)) for p in parts]
    loops = read_closed_loops(options, [part.name for part, _, _ in put], option)
    for k, (_, values, notes) in enumerate(put):
        for parameter in values:
            _refuse_another(options, parameter)
        values_of = {**loops[k].controller_values, **values}
        loops[k] = replace(loops[k], controller_values=values_of, notes=notes)
    return loops


def _refuse_another(options: argparse.Namespace, parameter: str) -> None:
    """Reject a sampling period by ``--set`` together with ``--sampled``."""
    for text in options.set:
        if text.partition("=")[0].strip().endswith(f".{parameter}"):
            raise BadRequest(f"--sampled {options.sampled} and --set {text}: expected one of them")


def swap_controllers(options: argparse.Namespace) -> int:
    loops = _loops(options)
    prepare_folder(options.out, [options.params, options.reference])
    from . import api
    from .orchestration.metrics import units_of_figures
    from .solver.files import finite_or_null

    progress = Progress(loops[0].stop)
    result = guard(lambda: api.swap(loops, progress=lambda name, t: progress(t, name)))
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
