"""The ``ballscrew`` command: a thin layer over the library's functions.

Exit codes: 0 done and trusted; 1 done, but the result says not to believe it or the run stopped
early; 2 the request makes no sense, with one line on standard error that says why.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from . import (
    __version__,
    diagnose_command,
    features_command,
    identify_command,
    lyapunov_command,
    map_command,
    native_command,
    rig_command,
)
from .arguments import NEGATIVE_NUMBER, out_folder
from .controllers import CONTROLLERS
from .params_option import add_params, bad_parameters, baked, params_values, read_params
from .plant import PLANTS
from .sides import check_labels, labels_of, mappings, meant, sided
from .supervision import tell, tell_folder, tell_kept

if TYPE_CHECKING:
    from .orchestration.closed_loop import Study
    from .orchestration.parameter_file import ParameterFile
    from .orchestration.reference_signal import Reference
    from .orchestration.system import SystemStudy

TRUSTED, NOT_TRUSTED, BAD_REQUEST = 0, 1, 2
LONGEST_LINE = 600  # characters of a complaint; what a stranger's file says may be endless
SHORTEST = 1e-9  # motion [s]
COUPLINGS = ("jacobi", "gauss-seidel", "tangent", "monolithic")

_EXAMPLES = """examples:
  ballscrew run --controller iol --out out/iol
  ballscrew swap --controllers iol nctf pid --out out/swap
  ballscrew export --out fmus
  ballscrew rig 2.4/7 --out out/trial
  ballscrew identify out/trial --law dahl --out out/dahl
  ballscrew diagnose run.csv --params axis.toml --out out/diagnosis
  ballscrew features --out out/features
"""
_RUN_EXAMPLES = """examples:
  ballscrew run --controller nctf --out out
  ballscrew run --controller iol --set controller.sigma0_hat=66966.331 --out out
  ballscrew run --controller mine.fmu --map position=x --map voltage=u --out out
  ballscrew run --controller iol --coupling monolithic --out reference
  ballscrew run --system loop.ssp --set plant.sigma0=6e4 --out out
  ballscrew run --controller pid --params out/identified/parameters.toml --out out/pid
"""


_DRAWING = ("run", "swap", "lyapunov", "map", "identify", "diagnose", "features")


class BadRequest(ValueError):
    """Something on the command line makes no sense; the message is one line for the user."""


class _Parser(argparse.ArgumentParser):
    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = NEGATIVE_NUMBER

    def error(self, message: str) -> NoReturn:
        raise BadRequest(f"{message}; see {self.prog} --help")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    # pictures go into files, so that a choice of windows, good or bad, decides nothing
    os.environ["MPLBACKEND"] = "agg"
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name may have letters that a terminal has not
            stream.reconfigure(errors="backslashreplace")
    try:
        options = _parser().parse_args(arguments)
        os.environ["BALLSCREW_SVG"] = "1" if getattr(options, "svg", False) else ""
        code = int(options.action(options))
        print(end="", flush=True)
        return code
    except BadRequest as error:
        return _complain(str(error))
    except BrokenPipeError:
        _forget_output()
        return NOT_TRUSTED
    except MemoryError:
        return _complain("memory ran out; ask for less at a time, such as a longer --step")
    except OSError as error:
        _forget_output()
        where = f"{error.filename}: " if error.filename else "output cannot be written: "
        return _complain(f"{where}{error.strerror or error}")
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def _forget_output() -> None:
    """Leave what cannot be printed, or Python tries once more at its end."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _complain(message: str) -> int:
    line = " ".join(message.split())
    if len(line) > LONGEST_LINE:
        half = LONGEST_LINE // 2
        line = f"{line[:half]} ... {line[-half:]}"
    print(f"ballscrew: {line}", file=sys.stderr)
    return BAD_REQUEST


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="ballscrew",
        description="Friction, co-simulation and stability: a ball-screw axis and its controllers "
        "as FMUs, coupled so that the closed loop is right.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"ballscrew {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)

    export = commands.add_parser(
        "export",
        help="write the components as FMUs",
        epilog="examples:\n  ballscrew export --out fmus --only plant iol\n"
        "  ballscrew export --ssp --out loops\n"
        "  ballscrew export --native --platforms linux64,win64 --out native\n"
        "  ballscrew export --loop iol --native --out loops\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    export.add_argument("--out", required=True, type=out_folder, metavar="DIR")
    export.add_argument(
        "--only", nargs="+", metavar="NAME", help=f"some of {', '.join([*PLANTS, *CONTROLLERS])}"
    )
    export.add_argument(
        "--ssp",
        action="store_true",
        help="instead, write one .ssp per closed loop: both FMUs, wired, with a parameter set; "
        "with --native, of native FMUs",
    )
    export.add_argument(
        "--loop",
        metavar="NAME",
        help="instead, write one FMU of the whole closed loop with this controller, set-point in "
        f"and signals out: one of {', '.join(CONTROLLERS)}",
    )
    export.add_argument(
        "--variational",
        action="store_true",
        help="instead, write FMUs that carry tangent vectors, for exponents over FMUs",
    )
    export.add_argument(
        "--tangents",
        metavar="N",
        help="with --variational: tangents, as many as the loop has states (default 5)",
    )
    native_command.add_options(export.add_argument)
    add_params(export.add_argument, "its values become the FMUs' start values")
    export.set_defaults(action=_export)

    run = commands.add_parser(
        "run",
        help="run a closed loop",
        epilog=_RUN_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = run.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--controller",
        metavar="NAME|FMU",
        help=f"{', '.join(CONTROLLERS)}, or the path of an FMU",
    )
    what.add_argument(
        "--system", type=Path, metavar="SSP", help="an .ssp with a plant and what commands it"
    )
    _add_loop_options(run)
    run.set_defaults(action=_run)

    swap = commands.add_parser(
        "swap",
        help="run several controllers on the same plant and compare them",
        epilog="example:\n  ballscrew swap --controllers iol nctf mine.fmu --out out/swap\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    swap.add_argument("--controllers", required=True, nargs="+", metavar="NAME|FMU")
    _add_loop_options(swap)
    swap.set_defaults(action=_swap)
    for command in (
        lyapunov_command,
        map_command,
        rig_command,
        identify_command,
        diagnose_command,
        features_command,
    ):
        command.add_parser(commands, _Parser)
    for name in _DRAWING:
        commands.choices[name].add_argument(
            "--svg", action="store_true", help="pictures as SVG, too, beside PNG"
        )
    return parser


def _add_loop_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--plant", metavar="FMU", help="path of an FMU in place of our plant")
    goal = parser.add_mutually_exclusive_group()
    goal.add_argument(
        "--setpoint", metavar="METRES", help="desired position [m] (default 0.08, or the .ssp's)"
    )
    goal.add_argument(
        "--reference", type=Path, metavar="CSV", help="file with the columns time [s] and x_d [m]"
    )
    add("--stop", metavar="SECONDS", help="end of the run [s] (default 20, or the .ssp's)")
    add("--step", default="1e-3", metavar="SECONDS", help="communication step [s] (default 1e-3)")
    add("--coupling", metavar="NAME", help=f"{', '.join(COUPLINGS)} (default: by rule, and said)")
    add("--corrections", metavar="0|1", help="corrections of each step by rollback")
    add("--adaptive", action="store_true", help="let the defect choose steps up to --step")
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
        help="a stranger's port and the one it meets; of one of several controllers by its name, "
        "as hand.pos=x",
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


# -- actions ---------------------------------------------------------------------------------


def _export(options: argparse.Namespace) -> int:
    whole = options.ssp or options.loop is not None
    known = [*CONTROLLERS] if whole else [*PLANTS, *CONTROLLERS]
    if options.loop is not None:
        for other in ("only", "ssp", "variational"):
            if getattr(options, other):
                raise BadRequest(f"--loop and --{other}: expected one of them")
    told = read_params(options)
    names = _export_names(options, told, known)
    for name in names:
        if name not in known:
            what = "closed loop" if whole else "component"
            raise BadRequest(f"no {what} {name!r}; there are {', '.join(known)}")
    if options.variational and options.ssp:
        raise BadRequest("--variational and --ssp: expected one of them")
    if options.tangents is not None and not options.variational:
        raise BadRequest("--tangents makes no sense without --variational")
    tangents = _whole("--tangents", options.tangents or "5", 1, 12)
    native_command.check(options)
    _prepare(options.out)
    if options.native and options.ssp:
        return native_command.export_systems(options, names, told)
    if options.native:
        return native_command.export(options, names, tangents, told)
    from .solver.component import ContractError
    from .solver.tape import UnsupportedComponent

    for name in names:
        tell_export(names, name)
        kind = "_variational" if options.variational else "_loop" if options.loop else ""
        target = options.out / (f"{name}.ssp" if options.ssp else f"{name}{kind}.fmu")
        try:
            _export_one(options, name, tangents, told, target)
        except (ContractError, UnsupportedComponent) as error:
            if options.only or options.loop:
                raise BadRequest(str(error)) from error
            print(f"left out: {error}", file=sys.stderr)
            continue
        print(target)
    return TRUSTED


def _export_names(
    options: argparse.Namespace, told: ParameterFile | None, known: list[str]
) -> list[str]:
    """What to export; of a parameter file the one plant that it describes, if none is named."""
    if options.loop is not None:
        return [options.loop]
    if options.only:
        return list(options.only)
    if told is None or options.ssp:
        return known
    with bad_parameters():
        return [told.plant_name, *CONTROLLERS]


def _export_one(
    options: argparse.Namespace,
    name: str,
    tangents: int,
    told: ParameterFile | None,
    target: Path,
) -> None:
    """Write one FMU or .ssp with the start values of a parameter file, or the nominal ones."""
    from .fmus import catalogue
    from .fmus.export import export_kernel
    from .fmus.system_export import export_system
    from .solver.kernel_cache import write_atomically

    with bad_parameters():
        plant = told.plant_name if told and (options.ssp or options.loop) else "plant"
    if options.ssp:
        with tempfile.TemporaryDirectory(prefix="ballscrew-export-") as folder:

            def side(part: str) -> Path:
                if told is None:
                    return catalogue.fmu(part)
                kernel = baked(told, part, catalogue.fmu_kernel(part))
                return export_kernel(kernel, Path(folder) / f"{part}.fmu")

            _write(partial(export_system, side(plant), side(name), target, name=name))
        return
    if options.variational:
        kernel = catalogue.variational_kernel(name, tangents)
    elif options.loop:
        kernel = catalogue.loop_fmu_kernel(name, plant)
    else:
        kernel = catalogue.fmu_kernel(name)
    if told:
        kernel = baked(told, name, kernel, loop=bool(options.loop))
        _write(lambda: export_kernel(kernel, target))
    else:
        if options.variational:
            made = catalogue.variational_fmu(name, tangents)
        else:
            made = catalogue.loop_fmu(name) if options.loop else catalogue.fmu(name)
        _write(partial(write_atomically, target, made.read_bytes()))
    if not options.variational:
        native_command.add_reference(kernel, target)


def tell_export(names: Sequence[str], name: str) -> None:
    """Say how far an export is; each of its files stands by itself."""
    tell(f"{names.index(name)} of {len(names)} files written, at {name}")
    tell_kept("each file that is there is whole")


def _run(options: argparse.Namespace) -> int:
    study = _system_study(options) if options.system else _studies(options, [options.controller])[0]
    _prepare(options.out, [options.params, options.reference])
    from .orchestration.closed_loop import Study, finite_or_null, run_study

    if isinstance(study, Study):
        progress = _Progress(study.stop)
        result = _guarded(lambda: run_study(study, progress))
    else:
        from .orchestration.system import run_system

        progress = _Progress(study.stop)
        result = _guarded(lambda: run_system(study, progress))
    progress.finish()
    _save(options.out, result.save)
    figures = result.figures()
    if options.json:
        print(json.dumps(finite_or_null(figures)))
    else:
        _print_figures(figures, options.out)
    for note in result.notes:
        print(f"note: {note}", file=sys.stderr)
    if not result.trusted:
        print(f"{figures['verdict']}: {figures['verdict_reason']}", file=sys.stderr)
        if figures["advice"]:
            print(figures["advice"], file=sys.stderr)
    return TRUSTED if result.trusted else NOT_TRUSTED


def _swap(options: argparse.Namespace) -> int:
    for name in options.controllers:
        _check_part("--controllers", name, CONTROLLERS)
        if options.controllers.count(name) > 1:
            raise BadRequest(f"--controllers has {name} twice; expected each once")
    check_labels(options.controllers)
    studies = _studies(options, options.controllers)
    _prepare(options.out, [options.params, options.reference])
    from .orchestration.closed_loop import finite_or_null
    from .orchestration.swap import swap

    progress = _Progress(studies[0].stop)
    result = _guarded(lambda: swap(studies, lambda name, t: progress(t, name)))
    progress.finish()
    _save(options.out, result.save)
    if options.json:
        print(json.dumps(finite_or_null([r.figures() for r in result.results])))
    else:
        print(_table([r.figures() for r in result.results]))
        files = ["comparison.csv", "comparison.json", "comparison.png", "parameters.toml"]
        print(f"{', '.join([*files, *result.trajectories])} in {options.out}")
    for r in result.results:
        for note in r.notes:
            print(f"note: {r.study.label}: {note}", file=sys.stderr)
        if not r.trusted:
            figures = r.figures()
            print(
                f"{figures['controller']}: {figures['verdict']}: {figures['verdict_reason']}",
                file=sys.stderr,
            )
    return TRUSTED if result.trusted else NOT_TRUSTED


def _guarded(action: Any) -> Any:
    """Run and turn what the user can mend into one line."""
    from .fmus.catalogue import UnknownComponent
    from .fmus.reading import FmuError
    from .fmus.system_reading import BadSystem
    from .orchestration.closed_loop import BadParameter
    from .orchestration.master import CouplingError
    from .orchestration.memory import NotEnoughMemory
    from .orchestration.participant import StepFailed
    from .orchestration.wiring import WiringError

    try:
        return action()
    except (
        FmuError,
        BadSystem,
        WiringError,
        CouplingError,
        NotEnoughMemory,
        BadParameter,
        UnknownComponent,
        StepFailed,
    ) as error:
        raise BadRequest(str(error)) from error


def _write(action: Any) -> None:
    try:
        action()
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        raise BadRequest(f"cannot write{where}: {error.strerror or error}") from error


def _save(folder: Path, save: Callable[[Path], None]) -> None:
    """Write the results of a run, in place of those of the run before."""
    from .orchestration.run_folder import write_run

    tell("writing the results")
    notes: list[str] = []
    _write(lambda: notes.extend(write_run(folder, save)))
    _tell_notes(notes)


def _tell_notes(notes: Iterable[str]) -> None:
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def _prepare(folder: Path, inputs: Iterable[Path | None] = ()) -> None:
    """Make the output folder before any work is done, so that a bad one costs nothing.

    What is read must not be a result in there that this run's results would take the place of.
    """
    if os.path.exists(folder) and not os.path.isdir(folder):  # False for names that are too long
        raise BadRequest(f"--out {folder} is a file, expected a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadRequest(f"--out {folder} cannot be made: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise BadRequest(f"--out {folder} cannot be written")
    tell_folder(folder)
    from .orchestration.run_folder import settle, written_files

    _write(lambda: _tell_notes(settle(folder)))
    listed: list[str] = []
    _write(lambda: listed.extend(written_files(folder)))
    # realpath, since resolve raises where links lead in a circle
    results = {Path(os.path.realpath(folder / name)) for name in listed}
    for path in filter(None, inputs):
        own = Path(os.path.realpath(path))
        if own in results or any(own in result.parents for result in results):
            raise BadRequest(
                f"{path} is a result in --out {folder}, and a new run takes the place of the one "
                "before; choose another folder"
            )


# -- reading the command line ----------------------------------------------------------------


def _studies(options: argparse.Namespace, controllers: list[str]) -> list[Study]:
    """What to run, one study for each controller."""
    stop = _stop(options) or 20.0
    loop = _loop_options(options, stop)
    for controller in controllers:
        _check_part("--controller", controller, CONTROLLERS)
    if options.plant is not None:
        _check_part("--plant", options.plant, PLANTS)
    given, given_to = _settings(options, controllers)
    mapping_of = mappings(options, controllers)
    reference = _reference(options)
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


def _system_study(options: argparse.Namespace) -> SystemStudy:
    for name in ("plant", "map", "params", "limit_voltage", "limit_current"):
        if getattr(options, name):
            raise BadRequest(
                f"--{name.replace('_', '-')} makes no sense with --system, whose file says what is "
                "connected; use --set ELEMENT.VARIABLE=VALUE"
            )
    stop = _stop(options)
    loop = _loop_options(options, stop)
    if options.coupling == "monolithic":
        raise BadRequest("--coupling monolithic needs equations, and an .ssp does not give them")
    values = {}
    for name, value in _named("--set", options.set, "ELEMENT.VARIABLE=VALUE").items():
        if "." not in name:
            raise BadRequest(f"--set {name}={value}: expected ELEMENT.VARIABLE=VALUE")
        values[name] = _number(f"--set {name}", value)
    from .orchestration.system import SystemStudy

    return SystemStudy(options.system, _reference(options), stop, values=values, **loop)


def _stop(options: argparse.Namespace) -> float | None:
    return None if options.stop is None else length("--stop", options.stop)


def length(option: str, text: str) -> float:
    """How long a motion is to be [s]; what is nearly nothing has no steps."""
    stop = _number(option, text)
    if stop <= 0:
        raise BadRequest(f"{option} is {text} s, expected more than 0")
    if stop < SHORTEST:
        raise BadRequest(f"{option} is {text} s, expected at least {SHORTEST:g} s")
    return stop


def _loop_options(options: argparse.Namespace, stop: float | None) -> dict[str, Any]:
    """What runs by name and by file have in common, checked."""
    step = _number("--step", options.step)
    if step <= 0 or (stop is not None and step > stop):
        raise BadRequest(f"--step is {options.step} s, expected more than 0 and at most --stop")
    if stop is not None:
        check_steps(stop, step)
    if options.coupling is not None and options.coupling not in COUPLINGS:
        raise BadRequest(
            f"--coupling is {options.coupling!r}, expected one of {', '.join(COUPLINGS)}"
        )
    if options.corrections not in (None, "0", "1"):
        raise BadRequest(f"--corrections is {options.corrections!r}, expected 0 or 1")
    limit = options.time_limit
    for option, given in (("isolate", options.isolate), ("time-limit", limit is not None)):
        if given and options.coupling == "monolithic":
            raise BadRequest(f"--{option} is for FMUs, and --coupling monolithic runs none")
    if limit is not None and options.isolate is False:
        raise BadRequest("--time-limit is for FMUs in a process of their own; see --no-isolate")
    time_limit = _number("--time-limit", limit or "60")
    if time_limit <= 0:
        raise BadRequest(f"--time-limit is {limit} s, expected more than 0")
    from .orchestration.coupling import Coupling

    return {
        "step": step,
        "coupling": Coupling(options.coupling) if options.coupling else None,
        "corrections": None if options.corrections is None else int(options.corrections),
        "adaptive": options.adaptive,
        "isolate": options.isolate,
        "time_limit": time_limit,
    }


def check_steps(stop: float, step: float) -> None:
    """Refuse steps [s] that are so short that no run of so many would end."""
    if stop / step > 1e9:
        raise BadRequest(f"--step {step:g} makes {stop / step:.3g} steps; use a larger one")


def _reference(options: argparse.Namespace) -> Reference | None:
    from .orchestration.reference_signal import BadReference, Reference

    try:
        if options.reference:
            return Reference.read(options.reference)
    except BadReference as error:
        raise BadRequest(str(error)) from error
    if options.setpoint is None:
        return None
    return Reference.constant(_number("--setpoint", options.setpoint))


def _check_part(option: str, name: str, known: dict[str, str]) -> None:
    if name in known or Path(name).suffix == ".fmu" or os.path.exists(name):
        return
    import difflib

    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f", did you mean {near[0]}?" if near else ""
    raise BadRequest(
        f"{option} {name!r} is neither one of {', '.join(known)} nor the path of an FMU{hint}"
    )


def _settings(
    options: argparse.Namespace, controllers: Sequence[str]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """What ``--set`` and the limits give the plant, and each controller."""
    plant: dict[str, float] = {}
    values: dict[str, dict[str, float]] = {name: {} for name in controllers}
    # what is said of one controller wins over what is said of all
    texts = _named("--set", options.set, "SIDE.NAME=VALUE")
    for name in sorted(texts, key=lambda name: not name.startswith("controller.")):
        side, parameter = sided(name, controllers)
        if not side or not parameter:
            *sides, last = ("plant", "controller", *labels_of(controllers))
            forms = ", ".join(f"{side}.NAME=VALUE" for side in sides)
            raise BadRequest(f"--set {name}={texts[name]}: expected {forms} or {last}.NAME=VALUE")
        number = _number(f"--set {name}", texts[name])
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
            number = _number("--" + option.replace("_", "-"), limit)
            if number <= 0:
                raise BadRequest(f"--{option.replace('_', '-')} is {limit}, expected more than 0")
            if parameter in plant:
                raise BadRequest(
                    f"--set plant.{parameter} and --{option.replace('_', '-')}: expected one of "
                    "them"
                )
            plant[parameter] = number
    return plant, values


def _pair(option: str, text: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise BadRequest(f"{option} {text!r} is not of the form {form}")
    return name.strip(), value.strip()


def _named(option: str, texts: Sequence[str], form: str) -> dict[str, str]:
    """What repeated options say of each name; to say it twice would leave the first without use."""
    pairs = [_pair(option, text, form) for text in texts]
    named = dict(pairs)
    for name in named:
        values = [value for other, value in pairs if other == name]
        if len(values) > 1:
            raise BadRequest(f"{option} {name} is given as {' and as '.join(values)}; expected one")
    return named


def _whole(option: str, text: str, least: int, most: int | None = None) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least or (most is not None and value > most):
        range_ = f"from {least} on" if most is None else f"from {least} to {most}"
        raise BadRequest(f"{option} is {text!r}, expected a whole number {range_}")
    return value


def _number(option: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise BadRequest(f"{option} is {text!r}, expected a number") from None
    if not math.isfinite(value):
        raise BadRequest(f"{option} is {text}, expected a finite number")
    return value


# -- showing ---------------------------------------------------------------------------------


class _Progress:
    """One line on standard error, rewritten; silent where nobody watches."""

    def __init__(self, stop: float | None) -> None:
        self.stop = stop  # None where only the file knows it
        self.started = time.monotonic()
        self.shown = 0.0
        self.active = sys.stderr.isatty()

    def __call__(self, now: float, name: str = "") -> None:
        clock = time.monotonic()
        if clock - self.shown < 0.2:
            return
        self.shown = clock
        end = f" of {self.stop:g}" if self.stop else ""
        done = now / self.stop if self.stop else 0.0
        left = (clock - self.started) * (1 - done) / done if done > 0 and not name else None
        rest = f", about {left:.0f} s left" if left is not None else ""
        head = f"{name}: " if name else ""
        tell(f"{head}t = {now:.2f}{end} s")
        if self.active:
            print(f"\r\033[K{head}t = {now:.2f}{end} s{rest}", end="", file=sys.stderr)

    def finish(self) -> None:
        if self.active and self.shown:
            print("\r\033[K", end="", file=sys.stderr)


def _print_figures(figures: dict[str, Any], folder: Path) -> None:
    rows = [
        ("peak voltage", figures.get("peak_voltage"), "V"),
        ("  at", figures.get("peak_voltage_time"), "s"),
        ("2 % settling time", figures.get("settling_time_2pct"), "s"),
        ("overshoot", figures.get("overshoot"), "m"),
        ("steady-state error", figures.get("steady_state_error"), "m"),
        ("integral of |error|", figures.get("iae"), "m*s"),
        ("interface defect", figures["interface_defect_max"], "V"),
    ]
    for label, value, unit in rows:
        shown = "-" if value is None else f"{value:.6g} {unit}"
        print(f"{label:<22}{shown}")
    print(f"{'coupling':<22}{figures['coupling']} ({figures['coupling_reason']})")
    print(f"{'communication steps':<22}{figures['macro_steps']}")
    print(f"{'verdict':<22}{figures['verdict']}: {figures['verdict_reason']}")
    if figures["stopped"]:
        print(f"{'stopped':<22}{figures['stopped']}")
    print(f"{'written to':<22}{folder}")


def _table(rows: list[dict[str, Any]]) -> str:
    columns = {
        "controller": ("controller", "{}"),
        "peak_voltage": ("peak [V]", "{:.2f}"),
        "settling_time_2pct": ("settling [s]", "{:.3f}"),
        "overshoot": ("overshoot [m]", "{:.3g}"),
        "steady_state_error": ("final error [m]", "{:.3g}"),
        "iae": ("IAE [m*s]", "{:.5f}"),
        "coupling": ("coupling", "{}"),
        "verdict": ("verdict", "{}"),
    }
    cells = [[title for title, _ in columns.values()]]
    for row in rows:
        cells.append(
            [
                "-" if row.get(key) is None else form.format(row[key])
                for key, (_, form) in columns.items()
            ]
        )
    widths = [max(len(line[k]) for line in cells) for k in range(len(columns))]
    return "\n".join(
        "  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip()
        for line in cells
    )
