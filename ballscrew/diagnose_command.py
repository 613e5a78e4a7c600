"""``ballscrew diagnose``: the errors of a model, their causes, and the corrected model."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Stages
from .options import NOT_TRUSTED, TRUSTED, check_name, out_folder
from .params_option import add_params, read_params
from .record_options import add_record_options, print_notes, read_record_options
from .results_folder import prepare_folder, save_results
from .solver.errors import ContractError, UserError

if TYPE_CHECKING:
    from .measurement.diagnosis.diagnosis import Diagnosis, Level
    from .orchestration.loop.parameter_file import ParameterFile
    from .solver.component import Component


_EXAMPLES = """DATA are files of measured data with the columns time [s], u [V] and x [m], or v
[m/s] if no position was recorded, and i [A] if it was measured. If there is i and no u, i is used
as the command. Several files are one study. Separators, decimal commas, lines before the table and
a line of units are detected automatically; a column without a name is called by its number. With
kind = "drive", u may be a force or a torque, as in --unit u=N. FILE.toml describes your model, see
docs/parameters.md: kind ("ball_screw" or "drive"), law, [plant] in SI units and [tolerance], the
relative tolerance of each value (default half of its interval, else 0.03).

examples:
  ballscrew diagnose run.csv --params axis.toml --out out/diagnosis
  ballscrew diagnose a.csv b.csv --law modified_lugre --map t=time --map pos=x \
    --unit time=ms --unit x=mm --out out/diagnosis
  ballscrew diagnose emps.mat --params emps.toml --map vir=u --map qm=x --map t=time \
    --unit time=s --unit x=m --unit u=V --out out/emps
  ballscrew diagnose drive.csv --params drive.toml --unit time=ms --unit x=deg --unit u=N*m \
    --lead 0.005 --out out/drive
  ballscrew run --controller nctf --plant out/diagnosis/extended_plant.fmu --out out/loop
  ballscrew diagnose run.csv --params axis.toml --take backlash --out out/backlash
  ballscrew compare other.csv --params out/diagnosis/parameters.toml
"""


_FMU, _PARAMETERS, _CURVES = "extended_plant.fmu", "parameters.toml", "curves"


_NEXT = "next_experiment.csv"


_TABLES = (f"{_CURVES}.parquet", f"{_CURVES}.csv")
_FILES = ("diagnosis.json", "report.html", _FMU, _PARAMETERS, _NEXT, *_TABLES)


_SHARES = {"": "share"}


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "diagnose",
        help="find the errors of a model on measured data, and their causes",
        description="Simulate your model on the recorded data, name the causes of its errors, "
        "and measure the improvement on held-out data. Writes diagnosis.json, report.html, "
        "curves.parquet "
        "(curves.csv without pyarrow), pictures, the corrected values as parameters.toml, "
        "extended_plant.fmu if causes are found, and next_experiment.csv for the machine "
        "unless everything is explained. Exit code 0: nothing is wrong, or all is explained, "
        "also by either of two causes; 1: partly, unexplained, or undecided because a fault "
        "above a fifth of the friction would not be seen; 2: bad input.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "data",
        nargs="+",
        type=Path,
        metavar="DATA",
        help="text, MAT, TDMS, MDF, HDF5, Excel, Parquet or NumPy files",
    )
    add_params(add, "parameter file of your model")
    add("--law", metavar="NAME", help="friction law, instead of the law in the file")
    add_record_options(add)
    add(
        "--take",
        metavar="CAUSE",
        help="include this cause, one of several suspects, in the model and measure its gain",
    )
    add("--out", required=True, type=out_folder, metavar="DIR", help="folder for the results")
    add("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(action=_diagnose)


def _diagnose(options: argparse.Namespace) -> int:
    columns = read_record_options(options)
    from .measurement.diagnosis.causes import CAUSES
    from .plant import LAWS

    for option, name, known in (("--law", options.law, LAWS), ("--take", options.take, CAUSES)):
        if name is not None:
            check_name(option, name, known)
    _check_overwritten(options)
    prepare_folder(options.out, [*options.data, options.params])
    from .measurement.diagnosis.corrected import corrected
    from .measurement.diagnosis.diagnose import diagnose_records
    from .measurement.diagnosis.diagnosis import ANSWERED
    from .measurement.diagnosis.drive import drive_of
    from .measurement.diagnosis.report_words import DOES_NOT_HOLD, does_not_hold
    from .measurement.records.reading import read_drive_records
    from .orchestration.loop.parameter_file import ParameterFile

    told = (read_params(options) or ParameterFile()).with_lead(columns.lead)
    model = drive_of(told, options.law)
    progress = Stages()
    try:
        progress("reading")
        records = read_drive_records(
            options.data, columns.mapping, columns.units, columns.lead_with(told)
        )
        result = diagnose_records(records, model, progress, options.take)
    finally:
        progress.finish()
    extension = _extended(result)
    values = corrected(result, extension.plant, told)
    progress("writing")
    made_by = options.command
    save_results(
        options.out, lambda folder: _save_diagnosis(result, extension, values, folder, made_by)
    )
    progress.finish()
    if options.json:
        print(json.dumps(result.to_dict()))
    else:
        from .orchestration.loop.shown_units import words_for

        print(words_for(result.notes)(_diagnosis_table(result, extension, options.out)))
    notes = [*result.notes, *([extension.because] if extension.because else [])]
    if does_not_hold(result):
        notes.append(DOES_NOT_HOLD)
    print_notes(notes, options.json)
    return TRUSTED if result.verdict in ANSWERED else NOT_TRUSTED


def _check_overwritten(options: argparse.Namespace) -> None:
    """Results must not overwrite the files they were made from."""

    results = {os.path.realpath(options.out / name) for name in _FILES}
    for path in (*options.data, options.params):
        if path is not None and os.path.realpath(path) in results:
            raise UserError(f"{path} would be overwritten by a result; choose another --out")


class _Extension:
    """The extended plant, or why there is none."""

    def __init__(self, plant: Component | None, because: str = "") -> None:
        self.plant = plant
        self.because = because


def _extended(result: Diagnosis) -> _Extension:
    if not result.causes:
        return _Extension(None)
    from .measurement.diagnosis.with_causes import with_causes

    try:
        return _Extension(with_causes(result.corrected, result.found()))
    except ContractError as error:
        return _Extension(None, f"no extended plant is written: {error}")


def _save_diagnosis(
    result: Diagnosis, extension: _Extension, values: ParameterFile, folder: Path, command: str
) -> None:
    from .fmus.export import export
    from .measured_results import DiagnosisResult
    from .measurement.diagnosis.with_causes import as_it_moves

    DiagnosisResult.of(result).save(folder, command=command)
    if extension.plant is not None:
        export(as_it_moves(extension.plant, result.corrected), folder / _FMU)
    values.save(folder)


def _diagnosis_table(result: Diagnosis, extension: _Extension, folder: Path) -> str:
    from .measurement.diagnosis.report_words import micrometres, suspect_lines, verdict_sentence
    from .solver.files import table_path

    lines = [f"{result.verdict}: {verdict_sentence(result)}", result.where, ""]
    lines.append(f"{'residual, rms':<34}{'force [N]':>11}{'position [um]':>15}")
    rows: Sequence[tuple[str, Level]] = (
        ("prior model", result.baseline_residual),
        (f"with adjusted values, {result.held_out} held out", result.adjusted_residual),
        (f"with causes, {result.held_out} held out", result.final_residual),
        ("noise alone", result.floor),
    )
    lines += [f"{n:<34}{v.force:>11.4g}{micrometres(v.position):>15}" for n, v in rows]
    for c in result.causes:
        low, high = c.gain_interval
        lines += [
            "",
            f"{c.name}: {c.says}{'' if c.certain else ' (most probable, not certain)'}",
            f"  gain {100 * c.gain_heldout:.3g} % of the mean square in force "
            f"({100 * low:.3g} to {100 * high:.3g} %"
            f"{', with all others included' if len(result.causes) > 1 else ''}), "
            f"probability {c.probability:.2f}",
        ]
        for name, value in c.parameters.items():
            known = c.intervals.get(name)
            between = f"  {known[0]:.4g} .. {known[1]:.4g}" if known else ""
            unit = _SHARES.get(c.units.get(name, ""), c.units.get(name, ""))
            lines.append(f"  {name:<20}{value:>11.4g} {unit:<8}{between}".rstrip())
    lines += ["", *suspect_lines(result.suspects)]
    lines += [f"no cause found: the remaining error varies {where}" for where in result.unnamed]
    if result.next_experiment is not None:
        lines.append(f"next experiment: {result.next_experiment.says}")
        lines.append(f"  {result.next_experiment.motion.says}: {_NEXT}")
    plant = f", {_FMU}" if extension.plant is not None else ""
    curves = table_path(folder, _CURVES).name
    lines.append(
        f"report.html, diagnosis.json, {_PARAMETERS}, {curves}, diagnosis.png, forces.png, "
        f"places.png{plant} in {folder}"
    )
    return "\n".join(lines)
