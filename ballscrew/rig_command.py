"""``ballscrew rig``: run trials of the thesis on the virtual test rig."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .rig.trials import Trial

_EXAMPLES = """TRIAL is a table (2.2, 2.4, 2.6, 2.8, 2.10, 2.11), the constant velocities (2.3.1), a
series (viscous, loading-rate, presliding), or one of its trials, as in 2.4/7.

examples:
  ballscrew rig --list
  ballscrew rig 2.4/7 --law modified_lugre --out out/trial
  ballscrew rig 2.8 presliding --law lugre --set plant.sigma0=6e4 --seed 3 --out out/trials
  ballscrew rig 2.4/7 --law lugre --export --out out/fmus
"""
DEFAULT_LAW = "modified_lugre"


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the command's sub-parsers, which make it a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "rig",
        help="run trials of the thesis on the virtual test rig",
        description="Write what the rig's instruments would have recorded, and the truth beside "
        "it. Exit code 1: recorded, but an instrument or the screw was past its range.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("trials", nargs="*", metavar="TRIAL", help="names of trials or tables")
    add("--list", action="store_true", help="print all trials, one line each")
    add(
        "--law",
        default=DEFAULT_LAW,
        metavar="NAME",
        help=f"friction law between block and table (default {DEFAULT_LAW})",
    )
    add(
        "--set",
        action="append",
        default=[],
        metavar="PART.NAME=VALUE",
        help="a parameter, such as plant.sigma0=6e4 or encoder.counts=2048",
    )
    add("--seed", default="0", metavar="N", help="decides all noise (default 0)")
    add(
        "--export",
        action="store_true",
        help="instead, write the rig's parts as FMUs, what wires them (wiring.json), and all that "
        "one trial gives them (values.json, outside.csv)",
    )
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder for the record; with several trials, for a folder of each",
    )
    parser.set_defaults(action=_rig)


def _rig(options: argparse.Namespace) -> int:
    from .cli import NOT_TRUSTED, TRUSTED, BadRequest, _prepare, _Progress, _write

    if options.list:
        from .rig.trials import TRIALS

        for trial in TRIALS.values():
            print(trial.line())
        return TRUSTED
    if not options.trials or options.out is None:
        missing = "a TRIAL" if not options.trials else "--out DIR"
        raise BadRequest(f"{missing} is missing; ballscrew rig --list prints all trials")
    trials = _trials(options.trials)
    seed = _seed(options.seed)
    values = _values(options.set)
    if options.export and len(trials) > 1:
        raise BadRequest(f"--export takes one TRIAL, as in 2.4/7; these are {len(trials)}")
    _prepare(options.out)
    from .plant.law import UnknownLaw
    from .rig.bench import BadRig, run_trial
    from .rig.fmu_bench import export_trial
    from .solver.codegen import UnsupportedComponent
    from .solver.kernel import IntegrationError

    if options.export:
        paths: list[Path] = []
        request = (options.out, trials[0], options.law, values, seed)
        try:
            _write(lambda: paths.extend(export_trial(*request)))
        except (BadRig, UnknownLaw, UnsupportedComponent) as error:
            raise BadRequest(str(error)) from error
        print(*paths, sep="\n")
        return TRUSTED
    progress = _Progress(sum(t.duration for t in trials))
    done, believed = 0.0, True
    try:
        for trial in trials:
            record = run_trial(
                trial,
                options.law,
                values,
                seed,
                progress=lambda t, before=done: progress(before + t),  # type: ignore[misc]
            )
            done += trial.duration
            folder = options.out / trial.folder if len(trials) > 1 else options.out
            _write(lambda r=record, f=folder: r.save(f))
            progress.finish()
            print(f"{trial.line()}: {folder}")
            for note in record.notes:
                believed = False
                print(f"{trial.name}: not to be believed: {note}", file=sys.stderr)
    except (BadRig, UnknownLaw, UnsupportedComponent) as error:
        raise BadRequest(str(error)) from error
    except IntegrationError as error:
        raise BadRequest(f"{error}; a parameter makes no sense") from error
    return TRUSTED if believed else NOT_TRUSTED


def _trials(names: list[str]) -> list[Trial]:
    from .cli import BadRequest
    from .rig.trials import UnknownTrial, trials_named

    try:
        found = [trial for name in names for trial in trials_named(name)]
    except UnknownTrial as error:
        raise BadRequest(str(error)) from error
    return list({trial.name: trial for trial in found}.values())


def _values(texts: list[str]) -> dict[str, float]:
    from .cli import BadRequest, _number, _pair

    values = {}
    for text in texts:
        name, value = _pair("--set", text, "PART.NAME=VALUE")
        if "." not in name:
            raise BadRequest(f"--set {text!r}: expected PART.NAME=VALUE, as in plant.sigma0=6e4")
        values[name] = _number(f"--set {name}", value)
    return values


def _seed(text: str) -> int:
    from .cli import BadRequest

    if not text.isascii() or not text.isdigit():
        raise BadRequest(f"--seed is {text!r}, expected a whole number from 0 up")
    return int(text)
