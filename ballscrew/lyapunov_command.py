"""``ballscrew lyapunov``: exponents of a closed loop, with a verdict and its evidence."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Stages, print_notes
from .loop_options import add_followed_loop_options, read_followed_loop
from .options import NOT_TRUSTED, TRUSTED, read_number
from .orchestration.fmu.limits import TOLERANCE
from .results_folder import prepare_folder, save_results
from .solver.errors import UserError

if TYPE_CHECKING:
    from .study_results import Exponents

_EXAMPLES = """examples:
  ballscrew lyapunov --controller nctf --stop 300 --out out/nctf
  ballscrew lyapunov --controller iol --set controller.sigma1_hat=342.5 --stop 20 --out out/cycle
  ballscrew lyapunov --controller mine.py:pi --stop 20 --out out/mine
  ballscrew lyapunov --controller nctf --stop 20 --via fmu --out out/over_fmus
  ballscrew lyapunov --controller hand.fmu --map position=x --map voltage=u --via fmu \
      --stop 20 --out out/hand
"""
BUDGET = "60"


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "lyapunov",
        help="Lyapunov exponents of a closed loop, and what its motion becomes",
        description="Write report.html, lyapunov.json, lyapunov.csv (the running estimates), "
        "parameters.toml and a picture of their convergence. Exit code 1: computed, but the "
        "verdict is undecided.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_followed_loop_options(parser, stop="300", tolerance=f"{TOLERANCE:g}")
    parser.add_argument(
        "--budget",
        default=BUDGET,
        metavar="S",
        help="processor time [s] for the exponents of equations; when it is used up, the "
        "exponents are given up to the time reached, and the verdict comes from the motion alone, "
        "which "
        f"gets half as much time (default {BUDGET})",
    )
    parser.set_defaults(action=_lyapunov)


def _lyapunov(options: argparse.Namespace) -> int:
    loop, tolerance = read_followed_loop(options, TOLERANCE, finest=1e-13, coarsest=1e-3)
    budget = read_number("--budget", options.budget)
    if budget <= 0.0:
        raise UserError(f"--budget is {options.budget} s, expected more than 0")
    prepare_folder(options.out, [options.params])
    from . import api
    from .solver.files import finite_or_null

    stages = Stages()
    how: dict[str, Any] = {"tolerance": tolerance, "budget": budget, "progress": stages}
    try:
        result = api.lyapunov(loop, **how)
    finally:
        stages.finish()

    def save(folder: Path) -> None:
        loop.parameters().save(folder)
        result.save(folder, command=options.command)

    save_results(options.out, save)
    figures = result.figures()
    if options.json:
        print(json.dumps(finite_or_null(figures)))
    else:
        _show(result, figures, options.out)
    if figures["time_s"] < loop.stop and figures["diverges_at_s"] is None:
        print_notes(
            [f"the exponents are computed up to t = {figures['time_s']:g} s, not {loop.stop:g} s"]
        )
    if not result.decided:
        print(f"undecided; what would decide: {figures['would_decide']}", file=sys.stderr)
    return TRUSTED if result.decided else NOT_TRUSTED


def _show(result: Exponents, figures: dict[str, Any], folder: Path) -> None:
    limits = result.motion.limit
    errors = figures["asymptotic_error_bits_per_s"]
    print(f"{figures['label']}, {figures['time_s']:g} s: {figures['verdict']}")
    print("  exponent [bits/s]   limit [bits/s] +- bound of its error")
    for k, value in enumerate(result.exponents):
        limit = f"{'unknown':>16}" if limits is None else f"{result.shown(limits[k]):>16}"
        if limits is not None and math.isfinite(limits[k]):
            limit += f" +- {errors[k]:.2g}"
        print(f"  {result.shown(value):>17}   {limit}")
    if result.note:
        print(f"  {result.note}")
    if figures["sum_rule_error"] is not None:
        print(f"  sum rule: off by {figures['sum_rule_error']:.2g} of the sum")
    print(f"  {figures['evidence']}")
    print(f"report.html, lyapunov.json, lyapunov.csv, parameters.toml, lyapunov.png in {folder}")
