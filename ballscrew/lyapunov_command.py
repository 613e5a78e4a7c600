"""``ballscrew lyapunov``: exponents of a closed loop, with a verdict and its evidence."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from .named_loop import add_loop_options, read_loop
from .options import NOT_TRUSTED, TRUSTED, BadRequest, check_steps, guarded, read_number
from .results_folder import prepare_folder, save_results
from .supervision import tell

_EXAMPLES = """examples:
  ballscrew lyapunov --controller nctf --stop 300 --out out/nctf
  ballscrew lyapunov --controller iol --set controller.sigma1_hat=342.5 --stop 20 --out out/cycle
  ballscrew lyapunov --controller mine.py:pi --stop 20 --out out/mine
  ballscrew lyapunov --controller nctf --stop 20 --via fmu --step 1e-3 --out out/over_fmus
"""
TOLERANCE = "1e-11"


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the command's sub-parsers, which make it a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "lyapunov",
        help="Lyapunov exponents of a closed loop, and what its motion becomes",
        description="Write lyapunov.json, lyapunov.csv (the running estimates), parameters.toml "
        "and a picture of their convergence. Exit code 1: computed, but the verdict is undecided.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_loop_options(parser, stop="300", tolerance=TOLERANCE)
    parser.add_argument(
        "--via",
        default="model",
        choices=("model", "fmu"),
        help="the equations in one solver, or variational FMUs and their master (default model)",
    )
    parser.add_argument(
        "--step",
        metavar="S",
        help="with --via fmu: communication step (default 1e-3)",
    )
    parser.set_defaults(action=_lyapunov)


def _lyapunov(options: argparse.Namespace) -> int:

    if options.step is not None and options.via != "fmu":
        raise BadRequest("--step is for --via fmu; the equations have a solver that chooses steps")
    if options.tolerance is not None and options.via == "fmu":
        raise BadRequest("--tolerance is for --via model; FMUs have a solver of their own")
    asked = read_loop(options, TOLERANCE, finest=1e-13, coarsest=1e-3)
    prepare_folder(options.out, [options.params])
    from .results.exponents import Exponents
    from .solver.files import finite_or_null
    from .stability.loop_lyapunov import loop_lyapunov
    from .stability.lyapunov import NoExponents

    stop = asked.stop
    loop: dict[str, Any] = {
        "setpoint": asked.setpoint,
        "plant": asked.plant,
        "plant_values": asked.plant_values,
        "controller_values": asked.controller_values,
        "progress": tell,
    }
    try:
        if options.via == "fmu":
            from .stability.loop_lyapunov import loop_lyapunov_over_fmus

            step = read_number("--step", options.step or "1e-3")
            if not 0 < step <= stop:
                raise BadRequest(f"--step is {options.step}, expected more than 0, at most --stop")
            check_steps(stop, step)
            result = guarded(
                lambda: loop_lyapunov_over_fmus(asked.controller, stop, step=step, **loop)
            )
        else:
            result = guarded(
                lambda: loop_lyapunov(asked.controller, stop, tolerance=asked.tolerance, **loop)
            )
    except NoExponents as error:
        raise BadRequest(str(error)) from error

    def save(folder: Path) -> None:
        asked.parameters().save(folder)
        Exponents.of(result).save(folder)

    save_results(options.out, save)
    figures = result.figures()
    if options.json:
        print(json.dumps(finite_or_null(figures)))
    else:
        _show(figures, options.out)
    if not result.decided:
        print(f"undecided; what would decide: {figures['would_decide']}", file=sys.stderr)
    return TRUSTED if result.decided else NOT_TRUSTED


def _show(figures: dict[str, Any], folder: Path) -> None:
    limits = figures["asymptotic_bits_per_s"]
    errors = figures["asymptotic_error_bits_per_s"]
    print(f"{figures['label']}, {figures['time_s']:g} s: {figures['verdict']}")
    print("  exponent [bits/s]   limit [bits/s]")
    for k, value in enumerate(figures["exponents_bits_per_s"]):
        limit = f"{limits[k]:16.6g} +- {errors[k]:.2g}" if limits else f"{'unknown':>16}"
        print(f"  {value:17.6g}   {limit}")
    if figures["sum_rule_error"] is not None:
        print(f"  sum rule: off by {figures['sum_rule_error']:.2g} of the sum")
    print(f"  {figures['evidence']}")
    print(f"lyapunov.json, lyapunov.csv, parameters.toml, lyapunov.png in {folder}")
