"""``ballscrew tune``: gains of one controller for one machine."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Bar, text_of
from .controllers import CONTROLLERS
from .loop_options import read_loops
from .options import (
    NOT_TRUSTED,
    PART,
    TRUSTED,
    out_folder,
    read_length,
    read_number,
    read_whole_number,
)
from .params_option import add_params
from .results_folder import prepare_folder, save_results
from .solver.errors import UserError
from .supervision import tell

if TYPE_CHECKING:
    from .study_results import TunedGains

_EXAMPLES = """examples:
  ballscrew tune --controller p_pi --out out/tuned
  ballscrew tune --controller p_pi --params axis.toml --limit 500 --out out/tuned
  ballscrew tune --controller pid --plant drive_lugre --set plant.m=40 --limit 500 --out out/tuned
  ballscrew run --controller p_pi --params out/tuned/parameters.toml --setpoint 0.02 --out out/run
"""
MOST = 100_000


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "tune",
        help="find the gains of one controller for one machine, and test them on another motion",
        description="Write parameters.toml with the gains, for run, swap and export, "
        "tuning.json, report.html, and pictures of motions and of the frequency response. Exit "
        "code 1: done, but a run failed or is not converged, or the linearized loop is unstable.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "--controller",
        required=True,
        metavar="NAME",
        help=f"mine.py:pi, the path of an FMU, or one of {', '.join(CONTROLLERS)}",
    )
    add(
        "--plant",
        metavar="PART",
        help=f"instead of the plant of --params or the default one: {PART}",
    )
    add_params(add, "parameter file of the machine; --set has priority")
    add(
        "--set",
        action="append",
        default=[],
        metavar="SIDE.NAME=VALUE",
        help="a parameter, such as plant.m=40; a gain is a start of the search",
    )
    add(
        "--limit",
        metavar="U",
        help="largest command, of either sign, in its unit: N if the command is a force, else "
        "V (default: voltage_limit of the parameter file; for axes 36 V)",
    )
    add(
        "--reference",
        metavar="CSV|MOTION",
        help="motion for the tuning, as in run (default: a step and a reversing move "
        "within the limit)",
    )
    add("--stop", metavar="SECONDS", help="length of --reference (default: its end plus 0.5 s)")
    add(
        "--budget",
        default="100",
        metavar="N",
        help="number of candidates (default 100); twice as many are tried",
    )
    add("--seed", default="1", metavar="N", help="seed of the search (default 1)")
    add("--out", required=True, type=out_folder, metavar="DIR", help="folder for the results")
    add("--json", action="store_true", help="print the figures as JSON")
    parser.set_defaults(action=_tune, map=[], limit_voltage=None, limit_current=None)


def _tune(options: argparse.Namespace) -> int:
    how: dict[str, Any] = {
        "budget": read_whole_number("--budget", options.budget, 2, MOST),
        "seed": read_whole_number("--seed", options.seed, 0),
        "reference": options.reference,
    }
    if options.limit is not None:
        how["limit"] = read_number("--limit", options.limit)
    if options.stop is not None:
        if options.reference is None:
            raise UserError("--stop is the length of --reference; give --reference as well")
        how["stop"] = read_length("--stop", options.stop)
    (loop,) = read_loops(options, [options.controller])
    prepare_folder(options.out, [options.params, options.reference])
    from . import api
    from .solver.files import finite_or_null

    progress = _Progress()
    try:
        result = api.tune(loop, progress=progress, **how)
    finally:
        progress.finish()
    save_results(options.out, lambda folder: result.save(folder, command=options.command))
    if options.json:
        print(json.dumps(finite_or_null(result.to_dict())))
    else:
        _show(result, options.out)
    if not result.trusted:
        print(f"not trusted: {', '.join(result.weaknesses)}", file=sys.stderr)
    return TRUSTED if result.trusted else NOT_TRUSTED


def _show(result: TunedGains, folder: Path) -> None:
    print(result.headline())
    gains, motions, *_ = result.tables()
    print(text_of(gains), text_of(motions), sep="\n")
    pictures = ", ".join(f"{name}.png" for name in result.pictures())
    files = f"report.html, tuning.json, {pictures}"
    print(f"parameters.toml with the gains for --params, {files} in {folder}")


class _Progress:
    """Number of finished candidates."""

    def __init__(self) -> None:
        self.bar: Bar | None = None

    def __call__(self, done: int, total: int) -> None:
        tell(f"{done} of {total} candidates")
        if self.bar is None:
            self.bar = Bar("candidates: {bar} {n} of {total}, {remaining} left", total)
        self.bar.show(done)

    def finish(self) -> None:
        if self.bar is not None:
            self.bar.close()
