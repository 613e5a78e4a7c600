"""``ballscrew rig``: run trials of the thesis, or in a machine's size, on the virtual test rig."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Progress, print_notes
from .options import NOT_TRUSTED, TRUSTED, out_folder, read_named, read_number
from .params_option import add_params, read_params
from .plant import DEFAULT_LAW
from .results_folder import prepare_folder, save_results
from .solver.errors import BadParameter, UserError

if TYPE_CHECKING:
    from .measurement.rig.machine import Machine
    from .measurement.rig.trials import Trial

_EXAMPLES = """TRIAL is a table (2.2, 2.4, 2.6, 2.8, 2.10, 2.11), the constant velocities (2.3.1),
a series (viscous, loading-rate, presliding), or one of its trials, such as 2.4/7. Your own
machine, kind = "drive" or "rotary_drive" in FILE.toml, has the same trials in its own size.
The size is trial.speed, trial.force and trial.travel; by default they follow from its friction
and the limit of its command.

examples:
  ballscrew rig --list
  ballscrew rig --list --params machine.toml
  ballscrew rig viscous 2.4/7 --params machine.toml --set trial.travel=0.3 --out out/machine
  ballscrew rig 2.4/7 --law modified_lugre --out out/trial
  ballscrew rig 2.8 presliding --law lugre --set plant.sigma0=6e4 --seed 3 --out out/trials
  ballscrew rig 2.4/7 --params out/identified/parameters.toml --out out/again
"""
MOST_DIGITS = 40  # of a seed: more than 128 bits need


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "rig",
        help="run trials on the virtual test rig, with the axis of the thesis or your own drive",
        description="Write the record of the rig's instruments, and the true signals next "
        "to it. Exit code 1: recorded, but an instrument or the travel was out of range.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("trials", nargs="*", metavar="TRIAL", help="names of trials or tables")
    add("--list", action="store_true", help="print all trials of the machine, one line each")
    add(
        "--law",
        metavar="NAME",
        help=f"friction law between block and table (default that of --params, or {DEFAULT_LAW})",
    )
    add_params(
        add, "parameter file of the machine, with values of the rig's parts; --set has priority"
    )
    add(
        "--set",
        action="append",
        default=[],
        metavar="PART.NAME=VALUE",
        help="a parameter, such as plant.sigma0=6e4, encoder.counts=2048 or trial.speed=0.1",
    )
    add("--seed", metavar="N", help="seed of all noise (default 0)")
    add(
        "--out",
        type=out_folder,
        metavar="DIR",
        help="folder for the record; with several trials, for a folder of each",
    )
    parser.set_defaults(action=_rig)


def _rig(options: argparse.Namespace) -> int:
    if options.list:
        for name in ("trials", "seed", "out"):
            if getattr(options, name):
                given = "a TRIAL" if name == "trials" else f"--{name}"
                raise UserError(f"--list and {given}: expected one of them")
    elif not options.trials or options.out is None:
        missing = "a TRIAL" if not options.trials else "--out DIR"
        raise UserError(f"{missing} is missing; ballscrew rig --list prints all trials")
    seed = _seed(options.seed or "0")
    values = _values(options.set)
    told = read_params(options)
    law = options.law or (told and told.law) or DEFAULT_LAW
    from .measurement.rig.machine import Machine
    from .measurement.rig.setup import set_up

    machine = Machine(law, values, told)
    if options.list:
        return _list(machine)
    trials = _trials(options.trials, machine)
    for trial in trials:
        set_up(trial, machine)
    prepare_folder(options.out, [options.params])
    from .measured_results import RigRecord
    from .measurement.rig.bench import run_trial
    from .orchestration.loop.loop import aside
    from .solver.kernel import IntegrationError

    progress = Progress(sum(t.duration for t in trials))
    notes: dict[str, Sequence[str]] = {}

    def record(folder: Path) -> None:
        done = 0.0
        for trial in trials:
            recorded = run_trial(
                trial,
                law,
                values,
                seed,
                progress=lambda t, before=done: progress(before + t),  # type: ignore[misc]
                told=told,
            )
            done += trial.duration
            place = folder / trial.folder if len(trials) > 1 else folder
            RigRecord.of(recorded).save(place, command=options.command)
            notes[trial.name] = recorded.notes
            if told is not None and trial is trials[0]:
                print_notes(aside(told, recorded.used.plant, "the rig"))
        progress.finish()

    try:
        save_results(options.out, record)
    except IntegrationError as error:
        raise UserError(f"{error}; a parameter is invalid") from error
    for trial in trials:
        folder = options.out / trial.folder if len(trials) > 1 else options.out
        print(f"{trial.line()}: {folder}")
        for note in notes[trial.name]:
            print(f"{trial.name}: not trusted: {note}", file=sys.stderr)
    return NOT_TRUSTED if any(notes.values()) else TRUSTED


def _list(machine: Machine) -> int:
    """Print the machine's trials; for trials that do not apply to it, print the reason."""
    from .measurement.rig.setup import set_up

    for trial in machine.trials.values():
        try:
            if not machine.is_axis:  # all of them are made for this
                set_up(trial, machine)
            print(trial.line())
        except BadParameter as error:
            print(f"{trial.name:<16}refused: {error}")
    return TRUSTED


def _trials(names: list[str], machine: Machine) -> list[Trial]:
    from .measurement.rig.trials import trials_named

    found = [trial for name in names for trial in trials_named(name, machine.trials)]
    return list({trial.name: trial for trial in found}.values())


def _values(texts: list[str]) -> dict[str, float]:

    values = {}
    for name, value in read_named("--set", texts, "PART.NAME=VALUE").items():
        if "." not in name:
            raise UserError(
                f"--set {name}={value}: expected PART.NAME=VALUE, as in plant.sigma0=6e4"
            )
        values[name] = read_number(f"--set {name}", value)
    return values


def _seed(text: str) -> int:

    if not text.isascii() or not text.isdigit() or len(text) > MOST_DIGITS:
        raise UserError(
            f"--seed is {text!r}, expected a whole number from 0 up of at most {MOST_DIGITS} digits"
        )
    return int(text)
