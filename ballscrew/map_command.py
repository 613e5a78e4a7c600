"""``ballscrew map``: long-term motion of a closed loop over a grid of two parameters."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from .console import Bar, print_notes
from .loop_options import add_followed_loop_options, read_followed_loop
from .options import TRUSTED
from .orchestration.fmu.limits import TOLERANCE_OF_MAPS, TOLERANCE_OF_MOTIONS
from .results_folder import prepare_folder
from .solver.errors import UserError
from .supervision import tell, tell_kept
from .worker_options import add_worker_options, open_workers, read_worker_count

_EXAMPLES = """examples:
  ballscrew map --controller iol --x sigma0_hat=66965.89:66969.24:68 \\
      --y sigma1_hat=339.56:367.56:561 --workers 2 --out out/gamma1
  ballscrew map --controller nctf --x design.sigma0=50000:85000:21 \\
      --y design.sigma1=250:450:21 --exponents --out out/gamma2
  ballscrew map --controller pid --x plant.Fc=0.5:2:16 --y plant.Fs=2.1:3:16 --out out/fcfs
"""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "map",
        help="stability maps over two parameters of plant or controller",
        description="Write report.html, map.parquet (a row a cell: the two parameters, verdict, "
        "final_error, lambda1_bits_per_s, oscillation_amplitude, reason of an undecided one; "
        "map.csv without pyarrow), map.json and a picture. Finished chunks are written at once; an "
        "interrupted run continues with --resume.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_followed_loop_options(
        parser,
        stop="20",
        tolerance=f"{TOLERANCE_OF_MOTIONS:g}, with --exponents {TOLERANCE_OF_MAPS:g}",
        over_fmus=False,
    )
    add = parser.add_argument
    for side in ("--x", "--y"):
        add(
            side,
            required=True,
            metavar="NAME=LOW:HIGH:COUNT",
            help="parameter or initial state (x_start) of controller or plant, setpoint, or "
            "design.NAME: a parameter of the plant for which nctf is designed",
        )
    add(
        "--exponents",
        action="store_true",
        help="also compute the largest Lyapunov exponent of each cell",
    )
    add_worker_options(parser)
    add("--resume", action="store_true", help="finish the map in this folder")
    parser.set_defaults(action=_map)


def _map(options: argparse.Namespace) -> int:
    usual = TOLERANCE_OF_MAPS if options.exponents else TOLERANCE_OF_MOTIONS
    loop, tolerance = read_followed_loop(options, usual, finest=1e-12, coarsest=1e-4)
    count = read_worker_count(options)
    from .stability.stability_map import make_map, plan_map

    try:
        axes = options.x, options.y
        plan = plan_map(loop, *axes, options.exponents, tolerance)
        if options.setpoint is not None and "setpoint" in (plan.x.side, plan.y.side):
            raise UserError("--setpoint, and an axis of set-points: expected one of them")
        prepare_folder(options.out, [options.params])
        workers = open_workers(options, count)
        progress = _MapProgress()

        again = options.resume
        summary = make_map(plan, options.out, workers, again, progress)
        progress.finish()
        from .study_results import StabilityMap

        notes = StabilityMap(summary, options.out).add_report(options.command)
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        raise UserError(
            f"cannot write{where}: {error.strerror or error}; finished work is kept, "
            "continue with --resume"
        ) from error
    print_notes([*summary.notes, *notes])
    figures = summary.figures()
    if options.json:
        print(json.dumps(figures))
    else:
        _show(figures, options.out)
    return TRUSTED


def _show(figures: dict[str, Any], folder: Path) -> None:
    from .solver.files import table_path
    from .stability.stability_map import AGAIN

    cells = figures["cells"]
    for verdict, number in sorted(figures["verdicts"].items(), key=lambda row: -row[1]):
        print(f"{number:>9} of {cells}  {verdict}")
        if verdict == "undecided":
            for reason, count in figures["undecided"].items():
                print(f"{'':>11}{count} of them: {reason}")
    print(
        f"again at {AGAIN}: {figures['checked_tighter']} cells, "
        f"{figures['disagreed']} with another verdict; of {figures['checked_at_random']} away from "
        f"borders, {figures['disagreed_at_random']}"
    )
    if figures["undecided"]:
        print(figures["budget"])
    files = f"{table_path(folder, 'map').name}, map.json, parameters.toml, map.png, report.html"
    print(f"{files} in {folder}")


class _MapProgress:
    """Number of finished cells; each pass, such as that over the borders, is counted separately."""

    def __init__(self) -> None:
        self.bar: Bar | None = None

    def __call__(self, done: int, total: int) -> None:
        tell(f"{done} of {total} cells")
        tell_kept("finished chunks are kept, continue with --resume")
        if self.bar is None or total != self.bar.total:
            self.finish()
            self.bar = Bar("{bar} {n} of {total} cells, {remaining} left", total, initial=done)
        self.bar.show(done)

    def finish(self) -> None:
        if self.bar is not None:
            self.bar.close()
