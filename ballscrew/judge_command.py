"""``ballscrew diagnose --judge``: how well the models of a diagnosis do on another record."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from .options import TRUSTED, BadRequest
from .params_option import bad_parameters
from .record_options import read_record_options
from .results_folder import prepare_folder, save_results

if TYPE_CHECKING:
    from .diagnosis.blocks import Estimate
    from .diagnosis.judge import Judgement

_NAMES = {"prior": "prior model", "adjusted": "values adjusted", "corrected": "corrected"}
_WIDE = 30  # of a column of figures


def judge_models(options: argparse.Namespace) -> int:
    """Judge the models of ``--params`` on the records of ``--judge``, and print the scores.

    Raises
    ------
    BadRequest
    """

    given = {"DATA": options.data, "--law": options.law}
    for name, value in given.items():
        if value:
            raise BadRequest(f"{name} and --judge: expected one of them")
    if options.params is None:
        raise BadRequest("--judge needs --params, the parameters.toml that a diagnosis wrote")
    columns = read_record_options(options)
    if options.out is not None:
        prepare_folder(options.out, [*options.judge, options.params])
    from .diagnosis.judge import judge_records
    from .orchestration.parameter_reading import read_parameters
    from .records.bad_record import BadRecord
    from .records.reading import read_drive_records
    from .solver.files import finite_or_null

    with bad_parameters():
        told = read_parameters(options.params)
        try:
            records = read_drive_records(
                options.judge, columns.mapping, columns.units, columns.lead_with(told)
            )
            result = judge_records(records, told)
        except BadRecord as error:
            raise BadRequest(str(error)) from error
    if options.out is not None:
        save_results(options.out, result.save)
    print(json.dumps(finite_or_null(result.to_dict())) if options.json else table(result))
    for note in result.notes:
        print(f"note: {note}", file=sys.stderr)
    return TRUSTED


def table(result: Judgement) -> str:
    """The scores for a reader, 95 % intervals in brackets."""
    from .identification.motion_parts import PARTS

    causes = ", ".join(result.causes) or "no cause"
    wide = max(map(len, PARTS)) + 12
    lines = [
        f"{', '.join(result.records)} ({result.seconds:.3g} s), judged by what was diagnosed of "
        f"{', '.join(result.diagnosed)}; corrected: values, and {causes}",
        "",
        f"{'what is left, rms (95 %)':<{wide}}"
        + "".join(f"{name:>{_WIDE}}" for name in _NAMES.values()),
    ]

    def row(name: str, found: list[Estimate], size: float = 1.0) -> str:
        return f"{name:<{wide}}" + "".join(f"{_figure(e, size):>{_WIDE}}" for e in found)

    scores = [result.scores[name] for name in _NAMES]
    lines.append(row("force [N]", [s.force for s in scores]))
    for part, share in result.shares.items():
        label = f"  {part}, {100 * share:.2g} %"
        lines.append(row(label, [s.parts[part] for s in scores]))
    lines.append(row("position over 1 s [um]", [s.position for s in scores], 1e6))
    lines += [
        f"noise of the instruments alone: {result.floor.force:.3g} N, "
        f"{1e6 * result.floor.position:.3g} um; behind a part: its share of the moving samples",
        "",
        f"{'gain, share of the mean square':<42}{'force [%]':>{_WIDE}}{'position [%]':>{_WIDE}}",
    ]
    for g in result.gains:
        name = f"{_NAMES[g.model]} over {_NAMES[g.over]}"
        figures = "".join(f"{_figure(e, 100.0):>{_WIDE}}" for e in (g.force, g.position))
        lines.append(f"{name:<42}{figures}")
    if result.scores["prior"].force.interval is None:
        lines.append("no intervals: the record is too short to tell them")
    return "\n".join(lines)


def _figure(found: Estimate, size: float) -> str:
    value = f"{size * found.value:.3g}"
    if found.interval is None:
        return value
    low, high = (f"{size * end:.3g}" for end in found.interval)
    return f"{value} ({low} to {high})"
