"""``ballscrew identify``, ``diagnose``, ``compare`` and ``rig``: measured data."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from . import measured_api
from .api import check_whole_number, file_of
from .console import (
    NOT_TRUSTED,
    TRUSTED,
    Progress,
    Stages,
    print_notes,
    print_result,
    text_of,
    warn,
)
from .options import columns_of, exclude, named
from .orchestration.fmu.limits import as_number
from .plant import DEFAULT_LAW
from .results_folder import prepare_folder, save_result, save_results
from .solver.errors import BadParameter, ContractError, UserError
from .solver.files import table_path

if TYPE_CHECKING:
    from .measured_results import DiagnosisResult
    from .measurement.rig.machine import Machine
    from .measurement.rig.trials import Trial
    from .orchestration.loop.parameter_file import ParameterFile
    from .solver.component import Component

IDENTIFY = r"""
Write the parameters with their intervals, what cannot be identified and why, a parameter file,
report.html, and pictures. Exit code 1: a parameter is not identified, or the law does not describe
the records.

DATA are folders written by `ballscrew rig`, or files with the columns time [s], force [N] (on the
block, positive in +x) and x [m], x_fine [m] or v [m/s]; of a rotary drive the torque and x in rad,
deg or rev, or v in rpm. Separators, decimal commas, lines before the table and a line of units are
detected; a column without a name is called by its number.

examples:
  ballscrew identify out/trials --law modified_lugre --out out/identified
  ballscrew identify a.csv b.csv --law dahl --map t=time --map F=force \
      --unit time=s --unit force=N --unit x=mm --out out/dahl
  ballscrew identify out/trials --law lugre --params out/trials/parameters.toml --out out/lugre
  ballscrew identify drive.csv --law lugre --map "Pos. [deg]=x" --map Torque=force \
      --unit force=mN*m --lead 0.005 --mass 95 --out out/drive
  ballscrew identify a.csv b.csv --law classical --mass fit --offset --fix Vs=1e-3 --out out/loaded
  ballscrew identify shaken.csv --response --out out/response
"""
DIAGNOSE = r"""
Simulate your model on the recorded data, name the causes of its errors, and measure the
improvement on held-out data. Writes diagnosis.json, report.html, curves.parquet (curves.csv
without pyarrow), a picture, the corrected values as parameters.toml, extended_plant.fmu if causes
are found, and next_experiment.csv unless everything is explained. Exit code 0: nothing is wrong, or
all is explained, also by either of two causes; 1: partly, unexplained, or undecided because a fault
above a fifth of the friction would not be seen; 2: bad input.

DATA are files with the columns time [s], u [V] and x [m], or v [m/s] if no position was recorded,
and i [A] if it was measured; without u, i is the command. Several files are one study. Layouts are
detected as by `ballscrew identify`. With kind = "drive", u may be a force or a torque, as in
--unit u=N. FILE.toml describes your model, see docs/parameters.md: kind, law, [plant] in SI units
and [tolerance], the relative tolerance of each value (default half of its interval, else 0.03).

examples:
  ballscrew diagnose run.csv --params axis.toml --out out/diagnosis
  ballscrew diagnose drive.csv --params drive.toml --unit time=ms --unit x=deg --unit u=N*m \
      --lead 0.005 --out out/drive
  ballscrew diagnose run.csv --params axis.toml --take backlash --out out/backlash
"""
COMPARE = r"""
Print the errors of the model of a parameter file on a record: of the force, by part of the motion,
and of the position predicted from the start of each second. Nothing is fitted. With --out:
compare.json, report.html and a picture.

DATA are as for `ballscrew diagnose`. FILE.toml is a file of identify or diagnose, or your own, see
docs/parameters.md. For a file of diagnose, three models are compared: the prior one, the one with
adjusted values, and the corrected one.

examples:
  ballscrew compare run.csv --params axis.toml
  ballscrew compare other.csv --params out/diagnosis/parameters.toml --out out/compare
  ballscrew compare drive.csv --params drive.toml --unit x=deg --unit u=N*m --lead 0.005 --json
"""
RIG = r"""
Write the record of the rig's instruments, and the true signals next to it. Exit code 1: recorded,
but an instrument or the travel was out of range.

TRIAL is a table (2.2, 2.4, 2.6, 2.8, 2.10, 2.11), the constant velocities (2.3.1), a series
(viscous, loading-rate, presliding), or one of its trials, such as 2.4/7. Your own machine,
kind = "drive" or "rotary_drive" in FILE.toml, has the same trials in its own size: trial.speed,
trial.force and trial.travel, by default from its friction and the limit of its command.

examples:
  ballscrew rig --list --params machine.toml
  ballscrew rig viscous 2.4/7 --params machine.toml --set trial.travel=0.3 --out out/machine
  ballscrew rig 2.4/7 --law modified_lugre --out out/trial
  ballscrew rig 2.8 presliding --law lugre --set plant.sigma0=6e4 --seed 3 --out out/trials
"""
_FMU, _CURVES, _NEXT = "extended_plant.fmu", "curves", "next_experiment.csv"


def identify(options: argparse.Namespace) -> int:
    if options.response:
        return _response(options)
    if options.law is None:
        raise UserError("--law is missing; expected a law, or --response for a frequency response")
    columns = columns_of(options)
    file = file_of(options.params)
    mass: float | bool = options.mass == "fit"
    if options.mass and not mass:
        mass = as_number("mass", options.mass)
    fixed = _fixed(options.fix, file)
    prepare_folder(options.out, [*options.data, options.params])
    how = {"fixed": fixed, "offset": options.offset, "params": file, "mass": mass, **columns}
    with Stages() as progress:
        result = measured_api.identify(options.data, options.law, **how, progress=progress)
    save_result(options, result)
    *tables, _ = result.tables()
    text = result.say("\n\n".join(map(text_of, tables)))
    files = "report.html, identified.json, parameters.toml, friction_map and residuals"
    print_result(options.json, result.to_dict(), text, files, options.out)
    of_records = [f"{r.name}: {note}" for r in result.records for note in r.notes]
    print_notes([*result.notes, *of_records], options.json)
    others = (w for w in result.warnings if w.split(":")[0] not in result.parameters)
    for line in (*result.unknown(), *(f"not trusted: {warning}" for warning in others)):
        warn(result.say(line))
    return TRUSTED if result.trusted else NOT_TRUSTED


def _response(options: argparse.Namespace) -> int:
    """The frequency response of one record; a law and its options are rejected."""
    why = "is not for --response; expected one record and no law"
    exclude(options, "response", "law mass fix offset", why)
    if len(options.data) != 1:
        got = f"{len(options.data)} files"
        raise UserError(f"--response: got {got}; expected one record and no law")
    columns = columns_of(options)
    from .measurement.identification.identification_pictures import response_figure
    from .measurement.identification.response import frequency_response
    from .measurement.records.reading import read_response_record
    from .orchestration.loop.pictures import drawing, write_figure

    file = file_of(options.params)
    columns["lead"] = columns["lead"] or (file.lead if file else None)
    record = read_response_record(options.data[0], **columns)
    result = frequency_response(record)
    prepare_folder(options.out, [*options.data, options.params])

    def save(folder: Path) -> None:
        result.save(folder)
        with drawing():
            write_figure(response_figure(result), folder, "response")

    save_results(options.out, save)
    files = "response.json, response.csv and response.png"
    print_result(options.json, result.to_dict(), result.said, files, options.out)
    print_notes(record.notes, options.json)
    return TRUSTED if result.highest > 0 else NOT_TRUSTED


def _fixed(texts: Sequence[str], file: ParameterFile | None) -> dict[str, float]:
    """Values of ``--fix``; names without a value take it from the parameter file."""
    given = named("--fix", [t for t in texts if "=" in t], "NAME=VALUE")
    fixed = {name: as_number(f"--fix {name}", text) for name, text in given.items()}
    for name in (t for t in texts if "=" not in t):
        if name in fixed:
            raise UserError(f"--fix {name} is given twice; expected once")
        if file is None or name not in file.plant:
            raise UserError(
                f"--fix {name}: it has no value; use --fix {name}=VALUE, or give {name} in --params"
            )
        fixed[name] = file.plant[name].value
    return fixed


def diagnose(options: argparse.Namespace) -> int:
    columns = columns_of(options)
    file = file_of(options.params)
    written = ("diagnosis.json", "report.html", _FMU, _NEXT, f"{_CURVES}.parquet", f"{_CURVES}.csv")
    prepare_folder(options.out, [*options.data, options.params], written)
    from .measurement.diagnosis.corrected import as_it_moves, corrected
    from .measurement.diagnosis.diagnosis import ANSWERED
    from .orchestration.loop.parameter_file import ParameterFile

    with Stages() as progress:
        progress("reading")
        asked = {"params": options.params, "law": options.law, "take": options.take, **columns}
        result = measured_api.diagnose(options.data, **asked, progress=progress)
        plant, notes = _extended(result)
        values = corrected(result, plant, (file or ParameterFile()).with_lead(columns["lead"]))
        progress("writing")

        def save(folder: Path) -> None:
            from .fmus.export import export

            result.save(folder, command=options.command)
            if plant is not None:
                export(as_it_moves(plant, result.corrected), folder / _FMU)
            values.save(folder)

        save_results(options.out, save)
    files = ["report.html", "diagnosis.json", "parameters.toml", table_path(Path(), _CURVES).name]
    files += ["diagnosis.png", *([_FMU] if plant else [])]
    text = result.say(_diagnosis_text(result))
    print_result(options.json, result.to_dict(), text, ", ".join(files), options.out)
    print_notes([*result.notes, *notes], options.json)
    return TRUSTED if result.verdict in ANSWERED else NOT_TRUSTED


def _extended(result: DiagnosisResult) -> tuple[Component | None, list[str]]:
    """The extended plant, or why there is none."""
    if not result.causes:
        return None, []
    from .measurement.diagnosis.corrected import with_causes

    try:
        return with_causes(result.corrected, result.found()), []
    except ContractError as error:
        return None, [f"no extended plant is written: {error}"]


def _diagnosis_text(result: DiagnosisResult) -> str:
    """What is wrong, the causes, and what to do next; the page has the rest."""
    shown = [t for t in result.tables() if t.title in ("Before and after", "Causes", "Do next")]
    said = [f"{t.title}: {t.says}\n{text_of(t)}" if t.says else text_of(t) for t in shown]
    return "\n\n".join([result.headline(), *said])


def compare(options: argparse.Namespace) -> int:
    columns = columns_of(options)
    if options.out is not None:
        prepare_folder(options.out, [*options.data, options.params])
    with Stages() as progress:
        asked = options.data, options.params
        result = measured_api.compare(*asked, **columns, progress=progress)
    if options.out is not None:
        save_result(options, result)
    *figures, about = map(text_of, result.tables())
    says = result.says[0].upper() + result.says[1:]
    text = result.say("\n\n".join([f"{says}.\n{about}", *figures]))
    files = "compare.json, compare.png and report.html"
    print_result(options.json, result.to_dict(), text, files, options.out)
    print_notes(result.notes, options.json)
    return TRUSTED


def rig(options: argparse.Namespace) -> int:
    exclude(options, "list", "seed out")
    if options.list and options.trials:
        raise UserError("--list and a TRIAL: expected one of them")
    if not options.list and not (options.trials and options.out):
        missing = "--out DIR" if options.trials else "a TRIAL"
        raise UserError(f"{missing} is missing; ballscrew rig --list prints all trials")
    seed = check_whole_number("seed", options.seed or "0", 0)
    texts = named("--set", options.set, "PART.NAME=VALUE")
    values = {name: as_number(f"--set {name}", value) for name, value in texts.items()}
    file = file_of(options.params)
    law = options.law or (file and file.law) or DEFAULT_LAW
    from .measurement.rig.machine import Machine

    machine = Machine(law, values, file)
    if options.list:
        return _list(machine)
    trials = _trials(options.trials, machine)
    prepare_folder(options.out, [options.params])
    from .measured_results import RigRecord
    from .measurement.rig.bench import run_trial
    from .orchestration.loop.loop import aside
    from .solver.kernel import IntegrationError

    folders = {t: options.out / t.folder if len(trials) > 1 else options.out for t in trials}
    notes: list[str] = []

    def record(stage: Path) -> None:
        done = 0.0
        with Progress(sum(t.duration for t in trials)) as progress:
            for trial in trials:

                def shown(t: float, before: float = done) -> None:
                    progress(before + t)

                recorded = run_trial(trial, law, values, seed, progress=shown, file=file)
                done += trial.duration
                place = stage / folders[trial].relative_to(options.out)
                RigRecord.of(recorded).save(place, command=options.command)
                notes.extend(f"{trial.name}: not trusted: {note}" for note in recorded.notes)
                if file is not None and trial is trials[0]:
                    print_notes(aside(file, recorded.used.plant, "the rig"))

    try:
        save_results(options.out, record)
    except IntegrationError as error:
        raise UserError(f"{error}; a parameter is invalid") from error
    for trial in trials:
        print(f"{trial.line()}: {folders[trial]}")
    for note in notes:
        warn(note)
    return NOT_TRUSTED if notes else TRUSTED


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
    """The trials with these names, each once, checked for this machine."""
    from .measurement.rig.setup import set_up
    from .measurement.rig.trials import trials_named

    found = {t.name: t for name in names for t in trials_named(name, machine.trials)}
    for trial in found.values():
        set_up(trial, machine)
    return [*found.values()]


COMMANDS = {
    "identify": (identify, IDENTIFY),
    "diagnose": (diagnose, DIAGNOSE),
    "compare": (compare, COMPARE),
    "rig": (rig, RIG),
}
