"""The loop that ``lyapunov`` and ``map`` are about: two parts by name, around a set-point."""

from __future__ import annotations

import argparse
import difflib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class NamedLoop:
    """A closed loop of our own parts, as asked for and checked.

    Attributes
    ----------
    plant_values, controller_values : dict of str to float
        Parameters and initial states that are not nominal.
    setpoint, stop : float
        [m], [s]
    tolerance : float
        Of the solver, relative.
    """

    controller: str
    plant: str
    plant_values: dict[str, float]
    controller_values: dict[str, float]
    setpoint: float
    stop: float
    tolerance: float


def add_loop_options(parser: argparse.ArgumentParser, stop: str, tolerance: str) -> None:
    """Add the options that `read_loop` reads, and those for the results."""
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
    add("--stop", default=stop, metavar="S", help=f"length of the motion (default {stop})")
    add(
        "--tolerance",
        default=tolerance,
        metavar="X",
        help=f"of the solver, relative (default {tolerance}); a tenth of it is tried, too",
    )
    add("--limit-voltage", metavar="V", help="amplifier limit")
    add("--limit-current", metavar="A", help="amplifier limit")
    add("--out", required=True, type=Path, metavar="DIR", help="folder for the results")
    add("--json", action="store_true", help="print the figures as JSON")


def read_loop(options: argparse.Namespace, finest: float, coarsest: float) -> NamedLoop:
    """The loop that the options say, with a tolerance between `finest` and `coarsest`.

    Raises
    ------
    BadRequest
    """
    from .cli import BadRequest, _guarded, _number, _settings
    from .controllers import CONTROLLERS
    from .plant import PLANTS

    _check_known("--controller", options.controller, CONTROLLERS)
    _check_known("--plant", options.plant, PLANTS)
    stop = _number("--stop", options.stop)
    if stop <= 0:
        raise BadRequest(f"--stop is {options.stop}, expected more than 0")
    tolerance = _number("--tolerance", options.tolerance)
    if not finest <= tolerance <= coarsest:
        raise BadRequest(f"--tolerance is {options.tolerance}, expected {finest:g} to {coarsest:g}")
    setpoint = _number("--setpoint", options.setpoint)
    values = _settings(options)
    from .orchestration.closed_loop import check_named

    for side, name in (("plant", options.plant), ("controller", options.controller)):
        _guarded(lambda s=side, n=name: check_named(s, n, values[s]))
    return NamedLoop(
        options.controller,
        options.plant,
        values["plant"],
        values["controller"],
        setpoint,
        stop,
        tolerance,
    )


def _check_known(option: str, name: str, known: dict[str, str]) -> None:
    """Refuse what is not one of ours, an FMU too: exponents need the equations."""
    from .cli import BadRequest

    if name in known:
        return
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f", did you mean {near[0]}?" if near else ""
    raise BadRequest(f"{option} {name!r} is none of {', '.join(known)}{hint}")
