"""The options of all commands, in one table, and what their words ask for: loops, values, columns.

The meaning of an option is written once, in the documentation of the API: its help is the text of
the argument that it becomes. The API checks the values.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from .controllers import CONTROLLERS
from .orchestration.fmu.limits import FIRST_STEP, TIME_LIMIT, TOLERANCE, as_number
from .orchestration.master.couplings import WITHOUT_FMUS, Coupling
from .plant import LAWS, PLANTS
from .plant.instruments import INSTRUMENTS
from .solver.errors import UserError

if TYPE_CHECKING:
    from .orchestration.study.workers import Workers

# A word that begins like a number is a value, also where argparse takes it for an option: -3e-2.
NEGATIVE_NUMBER = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)
COUPLINGS = ", ".join([*(coupling.value for coupling in Coupling), WITHOUT_FMUS])
_SOURCES = "api study_api part_api measured_api orchestration/loop/loop"  # in the package
_LOOPS, _RECORDS = "run swap lyapunov map", "identify diagnose compare"
_FUNCTIONS = {"map": "stability_map", "study": "swap_study", "rig": "run_trial"}


@dataclass(frozen=True)
class Option:
    """An option of one or several commands, and the argument of the API that it becomes.

    Its help is the text of the `argument`, if it becomes one, and `more`. Options of one `group`
    exclude each other. `how` is for argparse; without it and a metavar, the option is a flag.
    """

    flags: str
    metavar: str
    commands: str
    argument: str = ""
    more: str = ""
    group: str = ""
    how: Mapping[str, Any] = field(default_factory=dict)

    def help(self, command: str) -> str:
        records = command in _RECORDS.split()
        shared = ("diagnose", "read_force_records") if records else ("run", "Loop")
        functions = (_FUNCTIONS.get(command, command), *shared)
        texts = (_texts().get(name, {}) for name in functions)
        found = (text[self.argument] for text in texts if self.argument in text)
        said = next((text for text in found if not text.startswith("As in ")), "")
        return " ".join(filter(None, (said, self.more))).replace("%", "%%")


def out_folder(text: str) -> Path:
    """The folder of ``--out``; an empty name would be the current folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("is empty; expected a folder ('.' is the current one)")
    return Path(text)


_DRAWN = f"{_LOOPS} {_RECORDS} tune gallery"
_PRINTED = f"{_DRAWN} study"
_KEPT = f"{_LOOPS} tune study identify diagnose export"
_MANY: dict[str, Any] = {"action": "append", "default": []}
_NEEDED = {"required": True}
_SOME = {"nargs": "+"}
_FILES = "Text, MAT, TDMS, MDF, HDF5, Excel, Parquet or NumPy."
_WAYS = {"default": "model", "choices": ("model", "fmu")}
_YES_NO = {"action": argparse.BooleanOptionalAction}
_FOLDER = {"type": out_folder}
_NAMES = f"Names are {', '.join(CONTROLLERS)}."
_ALL = (
    f"Names are {', '.join([*PLANTS, *CONTROLLERS, *INSTRUMENTS])}; CONTROLLER+feed_forward gets "
    "the derivatives of the set-point; CONTROLLER+INSTRUMENT+... measures through instruments. "
    "Default: plant, iol, nctf, pid; with --params its plant."
)
_SET = (
    "A parameter or initial state: plant.sigma0=6e4 or controller.sigma0_hat=66966; with several "
    "controllers by the controller's name: iol.sigma0_hat=66966, or hand.Kp=3 for hand.fmu."
)
_PORT = "With several controllers use the controller's name, such as hand.pos=x."
_MOTIONS = (
    "Motions are step:size=0.08, move:distance=0.08,speed=0.1,acceleration=1,jerk=50, "
    "sine:amplitude=1e-3,frequency=2 and triangle:amplitude=1e-3,period=1; a table has the columns "
    "time [s], x_d [m] and, optionally, v_d and a_d."
)
_AXIS = (
    "The name is a parameter or initial state (x_start) of controller or plant, setpoint, or "
    "design.NAME: a parameter of the plant for which nctf is designed."
)
_RESPONSE = (
    "Instead of a law, compute the frequency response from force (or u, i) to position from one "
    "record with a multisine, chirp or noise, with coherence and first resonance."
)
_SSP = (
    "Instead, write one .ssp per closed loop: all FMUs, also of instruments, connected, with "
    "parameter sets; with --fmi 3 an SSP 2.0."
)
_LOOP = "Instead, write one FMU of the whole closed loop: set-point in, signals out."
_MODELICA = (
    "Write Modelica source, NAME.mo, of parts or, with --loop, of a loop; without events, samples "
    "and delays."
)
_TANGENTS = "Instead, write FMUs with tangent vectors, for Lyapunov exponents over FMUs."

OPTIONS = (
    # what is given by its place
    Option("study", "STUDY.toml", "study", "study"),
    Option("trials", "TRIAL", "rig", "trial", how={"nargs": "*"}),
    Option("data", "DATA", "identify", "records", _FILES, how=_SOME),
    Option("data", "DATA", "diagnose compare", "data", _FILES, how=_SOME),
    Option("name", "NAME", "gallery", more="A system of the list.", how={"nargs": "?"}),
    Option("kind", "", "new", how={"choices": ("controller",)}),
    Option("name", "NAME", "new", more="An identifier of Python."),
    # a loop
    Option("--controller", "PART", "run", "controller", _NAMES, "what", _NEEDED),
    Option("--system", "SSP", "run", "", "An .ssp with both parts.", "what", _NEEDED),
    Option("--controllers", "PART", "swap", "controller", _NAMES, how=_NEEDED | _SOME),
    Option("--controller", "PART", "tune lyapunov map", "controller", _NAMES, how=_NEEDED),
    Option("--via", "", "lyapunov", more="By equations, or over FMUs (default: model).", how=_WAYS),
    Option("--plant", "PART", f"{_LOOPS} tune", "plant", "Default: that of --params, or the axis."),
    Option("--params", "FILE.toml", f"{_LOOPS} tune", "params"),
    Option("--set", "SIDE.NAME=VALUE", f"{_LOOPS} tune", more=_SET, how=_MANY),
    Option("--map", "THEIRS=OURS", "run swap lyapunov", "mapping", _PORT, how=_MANY),
    Option("--setpoint", "METRES", _LOOPS, "", "Constant set-point [m] (default 0.08).", "goal"),
    Option("--reference", "CSV|MOTION", "run swap", "reference", _MOTIONS, "goal"),
    Option("--reference", "CSV|MOTION", "tune", "reference"),
    Option("--sampled", "PERIOD", "run swap", "sampled"),
    Option("--noise", "", "swap", "noise", f"They are {', '.join(INSTRUMENTS)}."),
    Option("--stop", "SECONDS", "run swap", "stop", "Default: 20, or the .ssp's."),
    Option("--stop", "SECONDS", "tune", "stop"),
    Option("--stop", "SECONDS", "lyapunov", "stop", "Default: 300.", how={"default": "300"}),
    Option("--stop", "SECONDS", "map", "stop", "Default: 20."),
    Option("--step", "SECONDS", "run swap", "step", f"The first is {FIRST_STEP:g}."),
    Option("--step", "SECONDS", "lyapunov", "step", f"With --via fmu; default {FIRST_STEP:g}."),
    Option("--coupling", "NAME", "run swap", "coupling", f"Names are {COUPLINGS}."),
    Option("--corrections", "0|1", "run swap", "corrections"),
    Option("--isolate", "", "run swap", "isolate", how=_YES_NO),
    Option("--time-limit", "SECONDS", "run swap", "time_limit", f"Default: {TIME_LIMIT:g}."),
    # exponents, maps, tuning, studies
    Option("--x", "NAME=LOW:HIGH:COUNT", "map", "x", _AXIS, how=_NEEDED),
    Option("--y", "NAME=LOW:HIGH:COUNT", "map", "", "As --x.", how=_NEEDED),
    Option("--exponents", "", "map", "exponents"),
    Option("--tolerance", "X", "lyapunov", "tolerance", f"Default: {TOLERANCE:g}."),
    Option("--tolerance", "X", "map", "tolerance"),
    Option("--budget", "SECONDS", "lyapunov", "budget", "Default: 60.", how={"default": "60"}),
    Option("--limit", "U", "tune", "limit"),
    Option("--budget", "N", "tune", "budget", "Default: 100.", how={"default": "100"}),
    Option("--seed", "N", "tune", "seed", "Default: 1.", how={"default": "1"}),
    Option("--workers", "N", "study map", "workers", "Default: one per core.", "where"),
    Option("--dask", "ADDRESS", "study map", "", "A Dask scheduler: tcp://host:8786.", "where"),
    Option("--resume", "", "study map", "resume"),
    # the rig and records
    Option("--list", "", "rig", more="Print all trials of the machine, one line each."),
    Option("--law", "NAME", "rig identify diagnose", "law", f"Names are {', '.join(LAWS)}."),
    Option("--params", "FILE.toml", "rig identify diagnose", "params"),
    Option("--params", "FILE.toml", "compare", "params", how=_NEEDED),
    Option("--set", "PART.NAME=VALUE", "rig", "values", how=_MANY),
    Option("--seed", "N", "rig", "seed", "Default: 0."),
    Option("--map", "THEIRS=OURS", _RECORDS, "mapping", how=_MANY),
    Option("--unit", "OURS=UNIT", _RECORDS, "units", how=_MANY),
    Option("--lead", "METRES", _RECORDS, "lead"),
    Option("--mass", "KG", "identify", "mass", "Here fit stands for True."),
    Option("--fix", "NAME[=VALUE]", "identify", "fixed", "Default: that of --params.", how=_MANY),
    Option("--offset", "", "identify", "offset"),
    Option("--response", "", "identify", more=_RESPONSE),
    Option("--take", "CAUSE", "diagnose", "take"),
    # files
    Option("--component --only", "PART", "export", "part", _ALL, how=_SOME),
    Option("--all", "", "export", more="Write every part that --component names, or every loop."),
    Option("--ssp", "", "export", more=_SSP),
    Option("--loop", "PART", "export", more=_LOOP),
    Option("--plant", "PART", "export", "plant", "With --loop or --ssp."),
    Option("--variational", "", "export", more=_TANGENTS),
    Option("--tangents", "N", "export", "tangents", "With --variational; default 5."),
    Option("--modelica", "", "export", more=_MODELICA),
    Option("--native", "", "export", "native"),
    Option("--fmi", "2|3", "export", "fmi", "Default: 2."),
    Option("--platforms", "NAME,...", "export", "platforms"),
    Option("--params", "FILE.toml", "export", "params"),
    # results
    Option("--out", "DIR", _KEPT, more="Folder for the results.", how=_FOLDER | _NEEDED),
    Option("--out", "DIR", "rig compare gallery", more="Folder for the results.", how=_FOLDER),
    Option("--out", "DIR", "new", more="Folder (default this one).", how=_FOLDER),
    Option("--json", "", _PRINTED, more="Print the figures as JSON."),
    Option("--svg", "", _DRAWN, more="Write the pictures also as SVG."),
)


class Parser(argparse.ArgumentParser):
    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = NEGATIVE_NUMBER
        self._texts: list[tuple[argparse.Action, Option, str]] = []

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message}; see {self.prog} --help")

    def add_options(self, command: str) -> None:
        """Add the options of a command; what they mean is read when somebody asks."""
        groups: dict[str, Any] = {"": self}
        for option in (o for o in OPTIONS if command in o.commands.split()):
            how = dict(option.how)
            if option.metavar:
                how["metavar"] = option.metavar
            elif not how:
                how["action"] = "store_true"
            if option.group:
                needed = how.pop("required", False)
                if option.group not in groups:
                    groups[option.group] = self.add_mutually_exclusive_group(required=needed)
            action = groups[option.group].add_argument(*option.flags.split(), **how)
            self._texts.append((action, option, command))

    def format_help(self) -> str:
        for action, option, command in self._texts:
            action.help = option.help(command)
        return super().format_help()


@cache
def _texts() -> dict[str, dict[str, str]]:
    """The text of each argument of each function, read from the source: imports take longer."""
    from . import __path__ as places

    found = {}
    for name in _SOURCES.split():
        paths = (Path(place, f"{name}.py") for place in places)
        source = next(path for path in paths if path.is_file()).read_text("utf-8")
        for node in ast.parse(source).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found[node.name] = dict(_arguments(ast.get_docstring(node) or ""))
    return found


def _arguments(docstring: str) -> Iterator[tuple[str, str]]:
    """Name and text of each argument in a docstring of numpydoc, without marks."""
    section = docstring.partition("Parameters\n----------\n")[2]
    section = re.split(r"\n\n\w[\w ]*\n--+\n", section)[0]
    for names, text in re.findall(r"^(\w[\w, ]*)(?: :.*)?\n((?: +.*\n?)*)", section, re.M):
        for name in names.split(", "):
            yield name, " ".join(text.split()).replace("`", "")


# -- words into values ----------------------------------------------------------------------


def given(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Those of the options that are given, by name."""
    return {name: value for name in names if (value := getattr(options, name)) is not None}


def exclude(options: argparse.Namespace, option: str, others: str, why: str = "") -> None:
    """Reject an option together with any of the others; `why` in place of the usual words."""
    if getattr(options, option):
        for other in (o for o in others.split() if getattr(options, o)):
            flag = f"--{other.replace('_', '-')}"
            raise UserError(
                f"{flag} {why}" if why else f"--{option} and {flag}: expected one of them"
            )


def named(option: str, texts: Sequence[str], form: str) -> dict[str, str]:
    """Values of a repeated option by name; a name that is given twice is an error."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name or not value:
            raise UserError(f"{option} {text!r} is not of the form {form}")
        if name in found:
            raise UserError(
                f"{option} {name} is given as {found[name]} and as {value}; expected one"
            )
        found[name] = value
    return found


def columns_of(options: argparse.Namespace) -> dict[str, Any]:
    """How measured data are written: names, units, and the screw's lead."""
    mapping = named("--map", options.map, "THEIRS=OURS")
    units = named("--unit", options.unit, "OURS=UNIT")
    lead = None if options.lead is None else as_number("lead", options.lead)
    if lead is not None and lead <= 0:
        raise UserError(f"lead is {options.lead}, expected a number of metres above 0")
    return {"mapping": mapping, "units": units, "lead": lead}


def add_worker_options(parser: argparse.ArgumentParser) -> None:
    """For programs with many tasks, such as those of ``proofs/``."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", metavar="N", help="processes (default: one per core)")
    where.add_argument("--dask", metavar="ADDRESS", help="a Dask scheduler")


def open_workers(options: argparse.Namespace) -> Workers:
    """Dask if it is asked for, else processes on this machine."""
    from .api import processes
    from .orchestration.study.workers import Dask

    if options.dask:
        return Dask(options.dask)
    return processes(options.workers or os.cpu_count() or 1)
