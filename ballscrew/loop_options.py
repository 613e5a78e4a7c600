"""Options of a closed loop: what it is, how its FMUs are coupled, how its equations are solved."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import print_notes
from .controllers import ALONE, CONTROLLERS
from .options import (
    PART,
    out_folder,
    read_length,
    read_named,
    read_number,
    read_part,
    read_step,
)
from .orchestration.fmu.limits import FIRST_STEP, TIME_LIMIT, check_corrections, check_time_limit
from .orchestration.master.couplings import Coupling
from .params_option import add_params, read_params
from .plant import PLANTS
from .sides import check_labels, labels_of, mappings, meant, split_side
from .solver.errors import UserError

if TYPE_CHECKING:
    from .orchestration.loop.loop import Loop, SystemLoop

COUPLINGS = tuple(coupling.value for coupling in Coupling)


def _add_loop(add: Any, over_fmus: bool = True) -> None:
    """Options of every loop, also of FMUs if `over_fmus`."""
    if over_fmus:
        add(
            "--map",
            action="append",
            default=[],
            metavar="THEIRS=OURS",
            help="a port of a third-party FMU and the port it is connected to; with several "
            "controllers use the controller's name, such as hand.pos=x",
        )
    add(
        "--plant",
        metavar="PART",
        help=f"instead of the default plant or the plant of --params: {PART}",
    )
    add_params(add)
    add(
        "--set",
        action="append",
        default=[],
        metavar="SIDE.NAME=VALUE",
        help="a parameter or initial state, such as plant.sigma0=6e4 or "
        "controller.sigma0_hat=66966; with several controllers use the controller's name, "
        "such as iol.sigma0_hat=66966, or hand.Kp=3 for hand.fmu",
    )
    add("--limit-voltage", metavar="V", help="amplifier voltage limit (nominal 36 V)")
    add("--limit-current", metavar="A", help="amplifier current limit")
    add("--out", required=True, type=out_folder, metavar="DIR", help="folder for the results")
    add("--json", action="store_true", help="print the figures as JSON")


def add_closed_loop_options(parser: argparse.ArgumentParser) -> None:
    """Options of a closed loop of FMUs, which `run` and `swap` have in common."""
    add = parser.add_argument
    goal = parser.add_mutually_exclusive_group()
    goal.add_argument(
        "--setpoint", metavar="METRES", help="desired position [m] (default 0.08, or the .ssp's)"
    )
    goal.add_argument(
        "--reference",
        metavar="CSV|MOTION",
        help="a file with the columns time [s] and x_d [m], and optionally v_d and a_d; or "
        "a motion, such as step:size=0.08, move:distance=0.08,speed=0.1,acceleration=1,jerk=50, "
        "sine:amplitude=1e-3,frequency=2 or triangle:amplitude=1e-3,period=1",
    )
    add(
        "--sampled",
        metavar="PERIOD",
        help="sample the controller with this period [s]: it reads at sample instants and holds "
        "its commands; an FMU is stepped once in each period",
    )
    add("--stop", metavar="SECONDS", help="end of the run [s] (default 20, or the .ssp's)")
    add(
        "--step",
        metavar="SECONDS",
        help=f"communication step [s] (default: {FIRST_STEP:g}, halved until the run is trusted)",
    )
    add(
        "--coupling",
        metavar="NAME",
        help=f"{', '.join(COUPLINGS)} (default: chosen by rule, and printed)",
    )
    add("--corrections", metavar="0|1", help="number of corrections of each step by rollback")
    add(
        "--adaptive",
        action="store_true",
        help="choose the step by the coupling residual, up to --step",
    )
    add(
        "--isolate",
        action=argparse.BooleanOptionalAction,
        help="run each FMU in its own process (default: FMUs not written by this program)",
    )
    add(
        "--time-limit",
        metavar="SECONDS",
        help="time limit [s] of one call of an FMU in its own process (default 60)",
    )
    _add_loop(add)


def add_followed_loop_options(
    parser: argparse.ArgumentParser, stop: str, tolerance: str, over_fmus: bool = True
) -> None:
    """Options of a loop with a constant set-point, for `lyapunov` and `map`."""
    add = parser.add_argument
    add(
        "--controller",
        required=True,
        metavar="PART",
        help="a built-in controller, or mine.py:pi"
        + ("; with --via fmu also the path of an FMU" if over_fmus else ""),
    )
    if over_fmus:
        add(
            "--via",
            default="model",
            choices=("model", "fmu"),
            help="model: the equations in one solver; fmu: FMUs and their master (default model)",
        )
        step = f"with --via fmu: communication step (default {FIRST_STEP:g})"
        add("--step", metavar="S", help=step)
    else:
        parser.set_defaults(via="model", step=None, map=[])
    add("--setpoint", metavar="M", help="constant set-point (default 0.08)")
    add("--stop", default=stop, metavar="S", help=f"length of the motion (default {stop})")
    add(
        "--tolerance",
        metavar="X",
        help=f"relative tolerance of the solver (default {tolerance}); a tenth of it is also tried",
    )
    _add_loop(add, over_fmus)


def read_loops(
    options: argparse.Namespace,
    controllers: Sequence[str],
    option: str = "--controller",
    fmus: bool = True,
    **how: Any,
) -> list[Loop]:
    """A loop for each controller of an option, with the common values.

    Parameters
    ----------
    fmus : bool
        Whether parts may be FMUs.
    **how
        Of each `Loop`.
    """
    names = list(controllers)
    parts = [read_part(option, name, CONTROLLERS | ALONE, fmus) for name in names]
    check_labels(option, names)
    plant = None if options.plant is None else read_part("--plant", options.plant, PLANTS, fmus)
    given, given_to = read_settings(options, names)
    ports_of = mappings(options, names)
    told = read_params(options)
    from .orchestration.loop.loop import Loop, file_values

    asked = told, options.plant, names, given
    described, values, values_of, notes = file_values(*asked)
    print_notes(notes)
    return [
        Loop(
            controller,
            plant or described,
            plant_values=values | given,
            controller_values=values_of[name] | given_to[name],
            mapping=ports_of[name],
            told=told,
            **how,
        )
        for name, controller in zip(names, parts, strict=True)
    ]


def read_closed_loops(
    options: argparse.Namespace, controllers: Sequence[str], option: str = "--controller"
) -> list[Loop]:
    """The loops that `run` or `swap` is asked for, one for each controller of an option."""
    from .orchestration.loop.loop import STOP

    stop = STOP if options.stop is None else read_length("--stop", options.stop)
    how = read_coupling_options(options, stop)
    return read_loops(options, controllers, option, stop=stop, **how)


def read_practice_loops(
    options: argparse.Namespace,
    asked: Sequence[str],
    option: str = "--controller",
    noise: bool = False,
) -> list[Loop]:
    """As `read_closed_loops`, sampled and with instruments where the options say so."""
    if options.sampled is None and not noise:
        return read_closed_loops(options, asked, option)
    from .orchestration.loop.parts import in_practice

    period = None if options.sampled is None else read_length("--sampled", options.sampled)
    parts = [read_part(option, controller, CONTROLLERS) for controller in asked]
    put = [in_practice(p, period, noise) for p in parts]
    loops = read_closed_loops(options, [part.name for part, _, _ in put], option)
    for _, values, _ in put:
        for parameter in values:
            _refuse_another(options, parameter)
    return [
        replace(loop, notes=notes, sampled=period)
        for loop, (_, _, notes) in zip(loops, put, strict=True)
    ]


def _refuse_another(options: argparse.Namespace, parameter: str) -> None:
    """Reject a sampling period by ``--set`` together with ``--sampled``."""
    for text in options.set:
        if text.partition("=")[0].strip().endswith(f".{parameter}"):
            raise UserError(f"--sampled {options.sampled} and --set {text}: expected one of them")


def read_followed_loop(
    options: argparse.Namespace, tolerance: float, finest: float, coarsest: float
) -> tuple[Loop, float]:
    """The loop that `lyapunov` or `map` is asked for, and the tolerance of its solver.

    Parameters
    ----------
    tolerance : float
        Default.
    finest, coarsest : float
        Limits of the tolerance.

    Raises
    ------
    UserError
    """
    over_fmus = options.via == "fmu"
    for option in () if over_fmus else ("step", "map"):
        if getattr(options, option):
            raise UserError(
                f"--{option} is for --via fmu; without it no FMU is run, and one solver chooses "
                "its steps"
            )
    if over_fmus and options.tolerance is not None:
        raise UserError("--tolerance is for --via model; FMUs have solvers of their own")
    for option in () if over_fmus else ("controller", "plant"):
        if Path(getattr(options, option) or "").suffix == ".fmu":
            raise UserError(
                f"--{option} {getattr(options, option)}: an FMU has no equations; lyapunov runs it "
                "with --via fmu"
            )
    stop = read_length("--stop", options.stop)
    step = read_step("--step", options.step or FIRST_STEP, stop) if over_fmus else None
    number = read_number("--tolerance", options.tolerance or tolerance)
    if not finest <= number <= coarsest:
        raise UserError(f"--tolerance is {options.tolerance}, expected {finest:g} to {coarsest:g}")
    how: dict[str, Any] = {"stop": stop, "step": step}
    if options.setpoint is not None:
        how["reference"] = read_number("--setpoint", options.setpoint)
    (loop,) = read_loops(options, [options.controller], fmus=over_fmus, **how)
    loop.check_values()
    return loop, number


def read_system_loop(options: argparse.Namespace) -> SystemLoop:
    for name in ("plant", "map", "params", "limit_voltage", "limit_current", "sampled"):
        if getattr(options, name):
            raise UserError(
                f"--{name.replace('_', '-')} cannot be used with --system, whose file "
                "defines the connections; use --set ELEMENT.VARIABLE=VALUE"
            )
    stop = None if options.stop is None else read_length("--stop", options.stop)
    how = read_coupling_options(options, stop)
    if how["coupling"] and how["coupling"].value == "monolithic":
        raise UserError("--coupling monolithic needs equations, and an .ssp does not give them")
    values = {}
    for name, value in read_named("--set", options.set, "ELEMENT.VARIABLE=VALUE").items():
        if "." not in name:
            raise UserError(f"--set {name}={value}: expected ELEMENT.VARIABLE=VALUE")
        values[name] = value  # the FMU tells which values are valid
    from .orchestration.loop.loop import SystemLoop

    return SystemLoop(options.system, stop=stop, values=values, **how)


def read_coupling_options(options: argparse.Namespace, stop: float | None) -> dict[str, Any]:
    """The set-point, and the options that runs by name and by file have in common, checked."""
    step = None if options.step is None else read_step("--step", options.step, stop)
    if step is None and stop is not None and stop > FIRST_STEP:
        read_step("--step", FIRST_STEP, stop)  # the first that is tried
    from .orchestration.loop.loop import as_reference
    from .orchestration.master.couplings import coupling_named

    how: dict[str, Any] = {"step": step, "adaptive": options.adaptive, "isolate": options.isolate}
    if options.reference:
        how["reference"] = as_reference(options.reference)
    elif options.setpoint is not None:
        how["reference"] = read_number("--setpoint", options.setpoint)
    coupling = coupling_named("--coupling", options.coupling)
    corrections = check_corrections("--corrections", options.corrections)
    limit = options.time_limit
    for option, given in (("isolate", options.isolate), ("time-limit", limit is not None)):
        if given and coupling and coupling.value == "monolithic":
            raise UserError(f"--{option} is for FMUs, and --coupling monolithic uses none")
    if limit is not None and options.isolate is False:
        raise UserError("--time-limit is for FMUs in their own process; see --no-isolate")
    time_limit = check_time_limit("--time-limit", limit or TIME_LIMIT)
    return how | {"coupling": coupling, "corrections": corrections, "time_limit": time_limit}


def read_settings(
    options: argparse.Namespace, controllers: Sequence[str]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Values of ``--set`` and of the limits for the plant, and for each controller."""
    plant: dict[str, float] = {}
    values: dict[str, dict[str, float]] = {name: {} for name in controllers}
    # a value for one controller has priority over a value for all
    texts = read_named("--set", options.set, "SIDE.NAME=VALUE")
    for name in sorted(texts, key=lambda name: not name.startswith("controller.")):
        side, parameter = split_side(name, controllers)
        if not side or not parameter:
            *sides, last = ("plant", "controller", *labels_of(controllers))
            forms = ", ".join(f"{side}.NAME=VALUE" for side in sides)
            raise UserError(f"--set {name}={texts[name]}: expected {forms} or {last}.NAME=VALUE")
        number = read_number(f"--set {name}", texts[name])
        if side == "plant":
            plant[parameter] = number
        for controller in meant(side, controllers):
            values[controller][parameter] = number
    for option, parameter in (
        ("limit_voltage", "voltage_limit"),
        ("limit_current", "current_limit"),
    ):
        limit = getattr(options, option)
        if limit is not None:
            number = read_number("--" + option.replace("_", "-"), limit)
            if number <= 0:
                raise UserError(f"--{option.replace('_', '-')} is {limit}, expected more than 0")
            if parameter in plant:
                raise UserError(
                    f"--set plant.{parameter} and --{option.replace('_', '-')}: expected one of "
                    "them"
                )
            plant[parameter] = number
    return plant, values
