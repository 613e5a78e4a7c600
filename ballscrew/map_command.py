"""``ballscrew map``: what becomes of a closed loop over a grid of two parameters."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

_EXAMPLES = """examples:
  ballscrew map --controller iol --x sigma0_hat=66965.89:66969.24:68 \\
      --y sigma1_hat=339.56:367.56:561 --workers 2 --out out/gamma1
  ballscrew map --controller nctf --x design.sigma0=50000:85000:21 \\
      --y design.sigma1=250:450:21 --exponents --out out/gamma2
  ballscrew map --controller pid --x plant.Fc=0.5:2:16 --y plant.Fs=2.1:3:16 --refine --out out/fcfs
"""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the command's sub-parsers, which make it a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "map",
        help="stability maps over two parameters of plant or controller",
        description="Write map.parquet (a row a cell: the two parameters, verdict, final_error, "
        "lambda1_bits_per_s, oscillation_amplitude), map.json and a picture. Chunks are written as "
        "they are done; a killed run goes on with --resume.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--controller", required=True, metavar="NAME", help="one of our controllers")
    add("--plant", default="plant", metavar="NAME", help="one of our plants (default plant)")
    for side in ("--x", "--y"):
        add(
            side,
            required=True,
            metavar="NAME=LOW:HIGH:COUNT",
            help="parameter or initial state (x_start) of controller or plant, setpoint, or "
            "design.NAME: of the plant on which nctf is designed",
        )
    add(
        "--set",
        action="append",
        default=[],
        metavar="SIDE.NAME=VALUE",
        help="a parameter or initial state that is the same in all cells",
    )
    add("--setpoint", default="0.08", metavar="M", help="constant set-point (default 0.08)")
    add("--stop", default="20", metavar="S", help="length of each run (default 20)")
    add("--exponents", action="store_true", help="the largest Lyapunov exponent of each cell, too")
    add("--refine", action="store_true", help="find the borders between verdicts: borders.csv")
    add("--tolerance", default="1e-8", metavar="X", help="of the solver (default 1e-8)")
    add("--limit-voltage", metavar="V", help="amplifier limit")
    add("--limit-current", metavar="A", help="amplifier limit")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", metavar="N", help="processes of this machine (default: one a core)"
    )
    where.add_argument(
        "--dask", metavar="ADDRESS", help="a Dask scheduler, such as tcp://host:8786"
    )
    add("--resume", action="store_true", help="finish the map that this folder holds")
    add("--out", required=True, type=Path, metavar="DIR", help="folder for the results")
    add("--json", action="store_true", help="print the figures as JSON")
    parser.set_defaults(action=_map)


def _map(options: argparse.Namespace) -> int:
    from .cli import TRUSTED, BadRequest, _guarded, _number, _prepare, _settings
    from .controllers import CONTROLLERS
    from .lyapunov_command import known_parts
    from .plant import PLANTS

    known_parts(options.controller, CONTROLLERS, "--controller")
    known_parts(options.plant, PLANTS, "--plant")
    stop = _number("--stop", options.stop)
    if stop <= 0:
        raise BadRequest(f"--stop is {options.stop}, expected more than 0")
    tolerance = _number("--tolerance", options.tolerance)
    if not 1e-12 <= tolerance <= 1e-4:
        raise BadRequest(f"--tolerance is {options.tolerance}, expected 1e-12 to 1e-4")
    setpoint = _number("--setpoint", options.setpoint)
    count = _workers(options.workers)
    values = _settings(options)
    from .orchestration.closed_loop import check_named
    from .orchestration.stability_map import BadMap, MapStudy, make_map, read_axis
    from .orchestration.workers import Dask, Processes, WorkersLost

    def checked() -> None:
        check_named("plant", options.plant, values["plant"])
        check_named("controller", options.controller, values["controller"])

    _guarded(checked)
    try:
        x = read_axis(options.x, options.plant, options.controller)
        y = read_axis(options.y, options.plant, options.controller)
        study = MapStudy(
            options.controller,
            x,
            y,
            options.plant,
            values["plant"],
            values["controller"],
            setpoint,
            stop,
            options.exponents,
            tolerance,
        )
        study.check()
        _prepare(options.out)
        workers = Dask(options.dask) if options.dask else Processes(count)
        progress = _MapProgress()
        summary = make_map(study, options.out, workers, options.resume, options.refine, progress)
        progress.finish()
    except (BadMap, WorkersLost) as error:
        raise BadRequest(str(error)) from error
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        raise BadRequest(
            f"cannot write{where}: {error.strerror or error}; what is done is kept, go on with "
            "--resume"
        ) from error
    figures = summary.figures()
    if options.json:
        print(json.dumps(figures))
    else:
        _show(figures, options.out)
    return TRUSTED


def _workers(text: str | None) -> int:
    from .cli import BadRequest

    if text is None:
        return os.cpu_count() or 1
    try:
        count = int(text)
    except ValueError:
        count = 0
    if count < 1:
        raise BadRequest(f"--workers is {text!r}, expected a whole number from 1 on")
    return count


def _show(figures: dict[str, Any], folder: Path) -> None:
    cells = figures["cells"]
    for verdict, number in sorted(figures["verdicts"].items(), key=lambda row: -row[1]):
        print(f"{number:>9} of {cells}  {verdict}")
    print(
        f"again at a tenth of the tolerance: {figures['checked_tighter']} cells, "
        f"{figures['disagreed']} with another verdict; of {figures['checked_at_random']} away from "
        f"borders, {figures['disagreed_at_random']}"
    )
    files = "map.parquet, map.json, map.png and .svg"
    if figures["borders"]:
        files = f"borders.csv ({figures['borders']} places), " + files
    print(f"{files} in {folder}")


class _MapProgress:
    """One line on standard error, rewritten; silent where nobody watches."""

    def __init__(self) -> None:
        self.started = time.monotonic()
        self.shown = 0.0
        self.first = 0
        self.total = 0
        self.active = sys.stderr.isatty()

    def __call__(self, done: int, total: int) -> None:
        clock = time.monotonic()
        if total != self.total:  # another pass begins
            self.total, self.first, self.started = total, done, clock
        if not self.active or (clock - self.shown < 0.5 and done < total):
            return
        self.shown = clock
        fresh = done - self.first
        left = (clock - self.started) * (total - done) / fresh if fresh else None
        rest = f", about {left:.0f} s left" if left is not None else ""
        print(f"\r\033[K{done} of {total} cells{rest}", end="", file=sys.stderr)

    def finish(self) -> None:
        if self.active and self.shown:
            print("\r\033[K", end="", file=sys.stderr)
