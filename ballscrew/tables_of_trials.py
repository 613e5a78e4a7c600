"""``ballscrew diagnose --trials`` and ``--directions``: tables with a row per trial."""

from __future__ import annotations

import argparse
import json
import os
from typing import TYPE_CHECKING

from .options import NOT_TRUSTED, TRUSTED, BadRequest
from .results_folder import prepare_folder, save_results

if TYPE_CHECKING:
    from .diagnosis.averaging_cost import AveragingCost
    from .diagnosis.trials import TrialsDiagnosis


def explain_trials(options: argparse.Namespace) -> int:
    from .diagnosis.trials import BadTable, explain_scatter
    from .solver.files import finite_or_null

    if os.path.realpath(options.out / "trials.json") == os.path.realpath(options.trials):
        raise BadRequest(f"{options.trials} would be overwritten by the result")
    prepare_folder(options.out, [options.trials])
    try:
        result = explain_scatter(options.trials, options.value)
    except BadTable as error:
        raise BadRequest(str(error)) from error
    save_results(options.out, result.save)
    if options.json:
        print(json.dumps(finite_or_null(result.to_dict())))
    else:
        print(_trials_table(result))
        print(f"trials.json in {options.out}")
    told = any(c.explains for c in result.conditions) or all(c.can_tell for c in result.conditions)
    return TRUSTED if told else NOT_TRUSTED


def _trials_table(result: TrialsDiagnosis) -> str:
    names = [
        f"{c.name} (as {', '.join(c.same_as)})" if c.same_as else c.name for c in result.conditions
    ]
    wide = max(map(len, ["condition", *names]))
    lines = [
        result.answer,
        f"{result.trials} trials, mean {result.mean:.5g}, deviation {result.deviation:.4g}; all "
        f"conditions together explain {100 * result.explained:.3g} %, less what chance would "
        f"{100 * result.adjusted:.3g} %",
        "",
        f"{'condition':<{wide}}{'share':>8}{'difference':>13}{'effect':>9}{'p':>9}{'corrected':>11}"
        f"{'smallest':>10}",
    ]
    for name, c in zip(names, result.conditions, strict=True):
        lines.append(
            f"{name:<{wide}}{100 * c.share:>6.3g} %{c.difference:>13.4g}{c.standardized:>9.3g}"
            f"{c.p_value:>9.2g}{c.corrected:>11.2g}{c.smallest_corrected:>10.2g}"
        )
    if result.conditions:
        lines.append(
            "difference between levels, and effect: the same in standard deviations of what is "
            "left; smallest: corrected p that these trials could have given"
        )
    lines += [f"{name}: no condition, {why}" for name, why in result.no_conditions.items()]
    if result.left_out:
        lines.append(f"{result.left_out} trials left out: a cell is empty")
    return "\n".join(lines)


def cost_of_averaging(options: argparse.Namespace) -> int:
    from .diagnosis.averaging_cost import averaging_cost
    from .diagnosis.trials import BadTable

    written = options.out / "averaging_cost.json"
    if os.path.realpath(written) == os.path.realpath(options.directions):
        raise BadRequest(f"{options.directions} would be overwritten by the result")
    prepare_folder(options.out, [options.directions])
    try:
        cost = averaging_cost(options.directions)
    except BadTable as error:
        raise BadRequest(str(error)) from error
    save_results(options.out, cost.save)
    print(written.read_text(encoding="utf-8") if options.json else _averaging_table(cost))
    if not options.json:
        print(f"{written.name} in {options.out}")
    return TRUSTED


def _averaging_table(cost: AveragingCost) -> str:
    rows = {
        "average less forwards": cost.forwards,
        "average less backwards": cost.backwards,
        "what one curve for both leaves at least": cost.unavoidable,
        "averaged parameters less averaged forces": cost.of_parameters,
    }
    lines = [
        f"One averaged friction curve for both directions is {cost.forwards.rms:.3g} N rms off "
        f"forwards and {cost.backwards.rms:.3g} N backwards, from rest to "
        f"{1e3 * cost.fastest:g} mm/s.",
        "",
        f"{'':<44}{'rms [N]':>9}{'share':>9}{'largest [N]':>13}{'at [mm/s]':>11}",
    ]
    lines += [
        f"{name:<44}{e.rms:>9.3g}{100 * e.share:>7.3g} %{e.largest:>13.3g}{1e3 * e.at_speed:>11.3g}"
        for name, e in rows.items()
    ]
    return "\n".join(lines)
