"""Options of a closed loop of FMUs, which `run` and `swap` have in common."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .controllers import ALONE, CONTROLLERS
from .options import (
    PART,
    BadRequest,
    check_part,
    check_steps,
    did_you_mean,
    out_folder,
    read_length,
    read_named,
    read_number,
    read_step,
)
from .orchestration.couplings import Coupling
from .params_option import add_params, params_values, read_params
from .plant import PLANTS
from .sides import check_labels, labels_of, mappings, meant, split_side

if TYPE_CHECKING:
    from .orchestration.closed_loop import Study
    from .orchestration.reference_signal import Reference
    from .orchestration.system import SystemStudy


COUPLINGS = tuple(coupling.value for coupling in Coupling)
SECOND_NAMES = {"tangent": "interface-jacobian"}


def add_closed_loop_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--plant", metavar="PART", help=f"in place of our plant {PART}")
    goal = parser.add_mutually_exclusive_group()
    goal.add_argument(
        "--setpoint", metavar="METRES", help="desired position [m] (default 0.08, or the .ssp's)"
    )
    goal.add_argument(
        "--reference",
        metavar="CSV|MOTION",
        help="a file with the columns time [s] and x_d [m], and v_d and a_d if it has them; or a "
        "motion, as step:size=0.08, move:distance=0.08,speed=0.1,acceleration=1,jerk=50, "
        "sine:amplitude=1e-3,frequency=2 or triangle:amplitude=1e-3,period=1",
    )
    add("--stop", metavar="SECONDS", help="end of the run [s] (default 20, or the .ssp's)")
    add(
        "--step",
        metavar="SECONDS",
        help="communication step [s] (default: 1e-3, halved until the run is trusted)",
    )
    add("--coupling", metavar="NAME", help=f"{', '.join(COUPLINGS)} (default: by rule, and said)")
    add("--corrections", metavar="0|1", help="corrections of each step by rollback")
    add("--adaptive", action="store_true", help="let the residual choose steps up to --step")
    add(
        "--set",
        action="append",
        default=[],
        metavar="SIDE.NAME=VALUE",
        help="a parameter, such as plant.sigma0=6e4 or controller.sigma0_hat=66966; of one of "
        "several controllers by its name, as iol.sigma0_hat=66966 or, of hand.fmu, hand.Kp=3",
    )
    add_params(add)
    add(
        "--map",
        action="append",
        default=[],
        metavar="THEIRS=OURS",
        help="a third-party FMU's port and the one it meets; of one of several controllers by its "
        "name, as hand.pos=x",
    )
    add("--limit-voltage", metavar="V", help="amplifier voltage limit; 36 V is nominal")
    add("--limit-current", metavar="A", help="amplifier current limit")
    add(
        "--isolate",
        action=argparse.BooleanOptionalAction,
        help="run each FMU in a process of its own (default: those not written here)",
    )
    add(
        "--time-limit",
        metavar="SECONDS",
        help="for any one call of an FMU in a process of its own (default 60)",
    )
    add("--out", required=True, type=out_folder, metavar="DIR", help="folder for the results")
    add("--json", action="store_true", help="print the figures as JSON")


def read_studies(
    options: argparse.Namespace, controllers: list[str], option: str = "--controller"
) -> list[Study]:
    """What to run, one study for each controller of an option."""
    stop = read_stop(options) or 20.0
    loop = read_coupling_options(options, stop)
    for controller in controllers:
        check_part(option, controller, CONTROLLERS | ALONE)
    check_labels(option, controllers)
    if options.plant is not None:
        check_part("--plant", options.plant, PLANTS)
    given, given_to = read_settings(options, controllers)
    mapping_of = mappings(options, controllers)
    reference = read_reference(options)
    told = read_params(options)
    plant, values, values_of = params_values(told, options.plant, controllers)
    from .orchestration.closed_loop import Study
    from .orchestration.reference_signal import Reference

    return [
        Study(
            controller=controller,
            plant=plant,
            reference=reference or Reference.constant(0.08),
            stop=stop,
            plant_values=values | given,
            controller_values=values_of[controller] | given_to[controller],
            mapping=mapping_of[controller],
            told=told,
            **loop,
        )
        for controller in controllers
    ]


def read_system_study(options: argparse.Namespace) -> SystemStudy:
    for name in ("plant", "map", "params", "limit_voltage", "limit_current"):
        if getattr(options, name):
            raise BadRequest(
                f"--{name.replace('_', '-')} makes no sense with --system, whose file says what is "
                "connected; use --set ELEMENT.VARIABLE=VALUE"
            )
    stop = read_stop(options)
    loop = read_coupling_options(options, stop)
    if loop["coupling"] and loop["coupling"].value == "monolithic":
        raise BadRequest("--coupling monolithic needs equations, and an .ssp does not give them")
    values = {}
    for name, value in read_named("--set", options.set, "ELEMENT.VARIABLE=VALUE").items():
        if "." not in name:
            raise BadRequest(f"--set {name}={value}: expected ELEMENT.VARIABLE=VALUE")
        values[name] = read_number(f"--set {name}", value)
    from .orchestration.system import SystemStudy

    return SystemStudy(options.system, read_reference(options), stop, values=values, **loop)


def read_stop(options: argparse.Namespace) -> float | None:
    return None if options.stop is None else read_length("--stop", options.stop)


def read_coupling_options(options: argparse.Namespace, stop: float | None) -> dict[str, Any]:
    """What runs by name and by file have in common, checked."""
    step = None if options.step is None else read_step("--step", options.step, stop)
    if step is None and stop is not None:
        check_steps(stop, 1e-3)  # the first that is tried
    coupling = None if options.coupling is None else read_coupling("--coupling", options.coupling)
    if options.corrections not in (None, "0", "1"):
        raise BadRequest(f"--corrections is {options.corrections!r}, expected 0 or 1")
    limit = options.time_limit
    for option, given in (("isolate", options.isolate), ("time-limit", limit is not None)):
        if given and coupling and coupling.value == "monolithic":
            raise BadRequest(f"--{option} is for FMUs, and --coupling monolithic runs none")
    if limit is not None and options.isolate is False:
        raise BadRequest("--time-limit is for FMUs in a process of their own; see --no-isolate")
    time_limit = read_number("--time-limit", limit or "60")
    if time_limit <= 0:
        raise BadRequest(f"--time-limit is {limit} s, expected more than 0")
    return {
        "step": step,
        "coupling": coupling,
        "corrections": None if options.corrections is None else int(options.corrections),
        "adaptive": options.adaptive,
        "isolate": options.isolate,
        "time_limit": time_limit,
    }


def read_coupling(option: str, name: str) -> Coupling:
    """The coupling of this name, or of its second name."""
    name = SECOND_NAMES.get(name, name)
    if name not in COUPLINGS:
        raise BadRequest(f"{option} is {name!r}, expected one of {', '.join(COUPLINGS)}")
    return Coupling(name)


def read_set_point(text: str) -> Reference:
    """A set-point over time, as a motion in words or as a file of this path."""
    from .orchestration.reference_motions import KINDS, read_motion
    from .orchestration.reference_signal import BadReference, Reference

    kind, colon, _ = text.partition(":")
    if colon and kind not in KINDS and not os.path.exists(text):
        near = did_you_mean(kind, KINDS)
        raise BadRequest(
            f"{text!r}: there is no such file and no motion {kind!r}; motions are "
            f"{', '.join(KINDS)}{near}"
        )
    try:
        return read_motion(text) or Reference.read(text)
    except BadReference as error:
        raise BadRequest(str(error)) from error


def read_reference(options: argparse.Namespace) -> Reference | None:
    from .orchestration.reference_signal import Reference

    if options.reference:
        return read_set_point(options.reference)
    if options.setpoint is None:
        return None
    return Reference.constant(read_number("--setpoint", options.setpoint))


def read_settings(
    options: argparse.Namespace, controllers: Sequence[str]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """What ``--set`` and the limits give the plant, and each controller."""
    plant: dict[str, float] = {}
    values: dict[str, dict[str, float]] = {name: {} for name in controllers}
    # what is said of one controller wins over what is said of all
    texts = read_named("--set", options.set, "SIDE.NAME=VALUE")
    for name in sorted(texts, key=lambda name: not name.startswith("controller.")):
        side, parameter = split_side(name, controllers)
        if not side or not parameter:
            *sides, last = ("plant", "controller", *labels_of(controllers))
            forms = ", ".join(f"{side}.NAME=VALUE" for side in sides)
            raise BadRequest(f"--set {name}={texts[name]}: expected {forms} or {last}.NAME=VALUE")
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
                raise BadRequest(f"--{option.replace('_', '-')} is {limit}, expected more than 0")
            if parameter in plant:
                raise BadRequest(
                    f"--set plant.{parameter} and --{option.replace('_', '-')}: expected one of "
                    "them"
                )
            plant[parameter] = number
    return plant, values
