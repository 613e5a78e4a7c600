"""The loop that ``lyapunov`` and ``map`` are about: two parts around a set-point."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .loop_options import read_settings
from .options import (
    BadRequest,
    check_part,
    guard,
    out_folder,
    read_length,
    read_number,
    read_step,
)
from .params_option import add_params, params_values, read_params
from .sides import mappings

if TYPE_CHECKING:
    from .orchestration.parameter_file import ParameterFile

STEP = "1e-3"  # [s]


@dataclass(frozen=True)
class NamedLoop:
    """A closed loop, as asked for and checked.

    Attributes
    ----------
    controller, plant : str
        Names of the catalogue; over FMUs also paths.
    plant_values, controller_values : dict of str to float
        Parameters and initial states that are not nominal.
    setpoint, stop : float
        [m], [s]
    tolerance : float
        Of the solver, relative.
    told : ParameterFile or None
        Where values come from.
    step : float or None
        Communication step over FMUs [s]; None: over the equations.
    mapping : dict of str to str
        Ports of FMUs, ``theirs -> ours``.
    """

    controller: str
    plant: str
    plant_values: dict[str, float]
    controller_values: dict[str, float]
    setpoint: float
    stop: float
    tolerance: float
    told: ParameterFile | None
    step: float | None
    mapping: dict[str, str]

    def parameters(self) -> ParameterFile:
        """All parameters of plant and controller as they are used."""
        from .orchestration.parts import used_parameters

        controllers = {self.controller: self.controller_values}
        return used_parameters(self.plant, self.plant_values, controllers, self.told)


def add_loop_options(parser: argparse.ArgumentParser, stop: str, tolerance: str) -> None:
    """Add the options that `read_loop` reads, and those for the results."""
    add = parser.add_argument
    add(
        "--controller",
        required=True,
        metavar="PART",
        help="one of our controllers, or mine.py:pi; with --via fmu also the path of an FMU",
    )
    add(
        "--plant",
        metavar="PART",
        help="one of our plants, or mine.py:axis; with --via fmu also the path of an FMU (default "
        "plant, or what --params describes)",
    )
    add(
        "--via",
        default="model",
        choices=("model", "fmu"),
        help="the equations in one solver, or FMUs and their master (default model)",
    )
    add("--step", metavar="S", help=f"with --via fmu: communication step (default {STEP})")
    add(
        "--map",
        action="append",
        default=[],
        metavar="THEIRS=OURS",
        help="with --via fmu: a third-party FMU's port and the one it meets",
    )
    add_params(add)
    add(
        "--set",
        action="append",
        default=[],
        metavar="SIDE.NAME=VALUE",
        help="a parameter or initial state, such as controller.sigma0_hat=66966.331",
    )
    add("--setpoint", metavar="M", help="constant set-point (default 0.08)")
    add("--stop", default=stop, metavar="S", help=f"length of the motion (default {stop})")
    add(
        "--tolerance",
        metavar="X",
        help=f"of the solver, relative (default {tolerance}); a tenth of it is tried, too",
    )
    add("--limit-voltage", metavar="V", help="amplifier limit")
    add("--limit-current", metavar="A", help="amplifier limit")
    add("--out", required=True, type=out_folder, metavar="DIR", help="folder for the results")
    add("--json", action="store_true", help="print the figures as JSON")


def read_loop(
    options: argparse.Namespace, tolerance: str, finest: float, coarsest: float
) -> NamedLoop:
    """The loop that the options say.

    Parameters
    ----------
    tolerance : str
        Of the solver, where none is given.
    finest, coarsest : float
        Between what it may be.

    Raises
    ------
    BadRequest
    """
    from .controllers import ALONE, CONTROLLERS
    from .plant import PLANTS

    over_fmus = options.via == "fmu"
    for option in () if over_fmus else ("step", "map"):
        if getattr(options, option):
            raise BadRequest(
                f"--{option} is for --via fmu; the equations have one solver that chooses its steps"
            )
    if over_fmus and options.tolerance is not None:
        raise BadRequest("--tolerance is for --via model; FMUs have solvers of their own")
    for option, known in (("controller", CONTROLLERS | ALONE), ("plant", PLANTS)):
        part = getattr(options, option)
        if not over_fmus and part and Path(part).suffix == ".fmu":
            raise BadRequest(f"--{option} {part}: an FMU gives no equations; add --via fmu")
        if part is not None:
            check_part(f"--{option}", part, known, fmus=over_fmus)
    stop = read_length("--stop", options.stop)
    step = read_step("--step", options.step or STEP, stop) if over_fmus else None
    number = read_number("--tolerance", options.tolerance or tolerance)
    if not finest <= number <= coarsest:
        raise BadRequest(f"--tolerance is {options.tolerance}, expected {finest:g} to {coarsest:g}")
    setpoint = read_number("--setpoint", options.setpoint or "0.08")
    given, given_to = read_settings(options, [options.controller])
    told = read_params(options)
    plant, told_plant, told_of = params_values(told, options.plant, [options.controller])
    plant_values = told_plant | given
    controller_values = told_of[options.controller] | given_to[options.controller]
    from .orchestration.closed_loop import check_part_values

    guard(lambda: check_part_values("plant", plant, plant_values))
    guard(lambda: check_part_values("controller", options.controller, controller_values))
    return NamedLoop(
        options.controller,
        plant,
        plant_values,
        controller_values,
        setpoint,
        stop,
        number,
        told,
        step,
        mappings(options, [options.controller])[options.controller],
    )
