"""``ballscrew lyapunov``: exponents of a closed loop, with a verdict and its evidence."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

_EXAMPLES = """examples:
  ballscrew lyapunov --controller nctf --stop 300 --out out/nctf
  ballscrew lyapunov --controller iol --set controller.sigma1_hat=342.5 --stop 20 --out out/cycle
  ballscrew lyapunov --controller nctf --stop 20 --via fmu --step 1e-3 --out out/over_fmus
"""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the command's sub-parsers, which make it a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "lyapunov",
        help="Lyapunov exponents of a closed loop, and what its motion becomes",
        description="Write lyapunov.json, lyapunov.csv (the running estimates) and a picture of "
        "their convergence. Exit code 1: computed, but the verdict is undecided.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--controller", required=True, metavar="NAME", help="one of our controllers")
    add("--plant", default="plant", metavar="NAME", help="one of our plants (default plant)")
    add(
        "--set",
        action="append",
        default=[],
        metavar="SIDE.NAME=VALUE",
        help="a parameter or initial state, such as controller.sigma0_hat=66966.331",
    )
    add("--setpoint", default="0.08", metavar="M", help="constant set-point (default 0.08)")
    add("--stop", default="300", metavar="S", help="length of the motion (default 300)")
    add(
        "--via",
        default="model",
        choices=("model", "fmu"),
        help="the equations in one solver, or variational FMUs and their master (default model)",
    )
    add(
        "--step",
        default="1e-3",
        metavar="S",
        help="with --via fmu: communication step (default 1e-3)",
    )
    add(
        "--tolerance",
        default="1e-11",
        metavar="X",
        help="of the solver, relative (default 1e-11); a tenth of it is tried, too",
    )
    add("--limit-voltage", metavar="V", help="amplifier limit")
    add("--limit-current", metavar="A", help="amplifier limit")
    add("--out", required=True, type=Path, metavar="DIR", help="folder for the results")
    add("--json", action="store_true", help="print the figures as JSON")
    parser.set_defaults(action=_lyapunov)


def _lyapunov(options: argparse.Namespace) -> int:
    from .cli import (
        NOT_TRUSTED,
        TRUSTED,
        BadRequest,
        _guarded,
        _number,
        _prepare,
        _settings,
        _write,
    )
    from .controllers import CONTROLLERS
    from .plant import PLANTS

    stop = _number("--stop", options.stop)
    if stop <= 0:
        raise BadRequest(f"--stop is {options.stop}, expected more than 0")
    tolerance = _number("--tolerance", options.tolerance)
    if not 1e-13 <= tolerance <= 1e-3:
        raise BadRequest(f"--tolerance is {options.tolerance}, expected 1e-13 to 1e-3")
    setpoint = _number("--setpoint", options.setpoint)
    known_parts(options.controller, CONTROLLERS, "--controller")
    known_parts(options.plant, PLANTS, "--plant")
    values = _settings(options)
    _prepare(options.out)
    from .orchestration.closed_loop import check_named, finite_or_null
    from .orchestration.lyapunov import NoExponents, loop_lyapunov

    def checked() -> None:
        check_named("plant", options.plant, values["plant"])
        check_named("controller", options.controller, values["controller"])

    _guarded(checked)
    loop = {
        "setpoint": setpoint,
        "plant": options.plant,
        "plant_values": values["plant"],
        "controller_values": values["controller"],
    }
    try:
        if options.via == "fmu":
            from .orchestration.lyapunov import loop_lyapunov_over_fmus

            step = _number("--step", options.step)
            if not 0 < step <= stop:
                raise BadRequest(f"--step is {options.step}, expected more than 0, at most --stop")
            result = _guarded(
                lambda: loop_lyapunov_over_fmus(options.controller, stop, step=step, **loop)
            )
        else:
            result = loop_lyapunov(options.controller, stop, tolerance=tolerance, **loop)
    except NoExponents as error:
        raise BadRequest(str(error)) from error
    _write(lambda: result.save(options.out))
    figures = result.figures()
    if options.json:
        print(json.dumps(finite_or_null(figures)))
    else:
        _show(figures, options.out)
    if not result.decided:
        print(f"undecided; what would decide: {figures['would_decide']}", file=sys.stderr)
    return TRUSTED if result.decided else NOT_TRUSTED


def known_parts(name: str, known: dict[str, str], option: str) -> None:
    """Refuse what is not one of ours: exponents need the equations."""
    import difflib

    from .cli import BadRequest

    if name in known:
        return
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f", did you mean {near[0]}?" if near else ""
    raise BadRequest(f"{option} {name!r} is none of {', '.join(known)}{hint}")


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
    print(f"lyapunov.json, lyapunov.csv, lyapunov.png and .svg in {folder}")
