"""Scatter in the thesis' tables of trials, and the error by its averaged friction curve.

Writes ``docs/proof/tables_of_trials.json`` and the text between the marks of
``docs/tables-of-trials.md``. With ``--trials TABLE --value COLUMN`` or ``--directions TABLE`` it
prints the results for another table, and writes nothing.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from provenance import provenance
from thesis_trials.averaging_cost import AveragingCost, averaging_cost
from thesis_trials.scatter import TrialsDiagnosis, explain_scatter

from ballscrew.solver.files import finite_or_null

ROOT = Path(__file__).resolve().parents[1]
DOCS, DATA = ROOT / "docs", ROOT / "tests" / "data"
PAGE = DOCS / "tables-of-trials.md"
BEGIN, END = "<!-- made by proofs/tables_of_trials.py -->\n```text\n", "\n```\n<!-- until here -->"
SCATTER = (
    ("table_2_5_dahl.csv", "sigma_N_m"),
    ("table_2_5_dahl.csv", "Fc_N"),
    ("table_2_9_lugre.csv", "sigma0_N_m"),
)
DIRECTIONS = "table_2_3_stribeck.csv"


def text_of_scatter(result: TrialsDiagnosis) -> str:
    """The answer, and a row for each condition."""
    names = [
        f"{c.name} (as {', '.join(c.same_as)})" if c.same_as else c.name for c in result.conditions
    ]
    wide = max(map(len, ["condition", *names]))
    lines = [
        f"{result.table}, {result.value}: {result.answer}",
        f"{result.trials} trials, mean {result.mean:.5g}, deviation {result.deviation:.4g}; all "
        f"conditions together explain {100 * result.explained:.3g} %, less what chance would "
        f"{100 * result.adjusted:.3g} %",
        f"{'condition':<{wide}}{'share':>8}{'difference':>13}{'effect':>9}{'p':>9}{'corrected':>11}"
        f"{'smallest':>10}",
    ]
    for name, c in zip(names, result.conditions, strict=True):
        lines.append(
            f"{name:<{wide}}{100 * c.share:>6.1f} %{c.difference:>13.4g}{c.standardized:>9.3g}"
            f"{c.p_value:>9.2g}{c.corrected:>11.2g}{c.smallest_corrected:>10.2g}"
        )
    lines += [f"{name}: no condition, {why}" for name, why in result.no_conditions.items()]
    if result.left_out:
        lines.append(f"{result.left_out} trials left out: a cell is empty")
    return "\n".join(lines)


def text_of_cost(cost: AveragingCost) -> str:
    """The answer, and a row for each error."""
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
        f"{'':<44}{'rms [N]':>9}{'share':>9}{'largest [N]':>13}{'at [mm/s]':>11}",
    ]
    lines += [
        f"{name:<44}{e.rms:>9.3g}{100 * e.share:>7.3g} %{e.largest:>13.3g}{1e3 * e.at_speed:>11.3g}"
        for name, e in rows.items()
    ]
    return "\n".join(lines)


def thesis() -> tuple[list[TrialsDiagnosis], AveragingCost, str]:
    """Results for the thesis' tables, and their text."""
    scatter = [explain_scatter(DATA / table, value) for table, value in SCATTER]
    cost = averaging_cost(DATA / DIRECTIONS)
    parts = [*map(text_of_scatter, scatter), f"{DIRECTIONS}: {text_of_cost(cost)}"]
    return scatter, cost, "\n\n".join(parts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=Path, metavar="TABLE.csv", help="a trial in each row")
    parser.add_argument("--value", metavar="COLUMN", help="whose scatter is to be explained")
    parser.add_argument("--directions", type=Path, metavar="TABLE.csv", help="as Table 2.3")
    options = parser.parse_args()
    if (options.trials is None) != (options.value is None):
        parser.error("--trials and --value: expected both or neither")
    if options.trials:
        print(text_of_scatter(explain_scatter(options.trials, options.value)))
    if options.directions:
        print(text_of_cost(averaging_cost(options.directions)))
    if options.trials or options.directions:
        return 0
    scatter, cost, text = thesis()
    print(text)
    report = {
        **provenance("tables_of_trials"),
        "scatter": [{"answer": s.answer, **asdict(s)} for s in scatter],
        "averaging": asdict(cost),
    }
    told = json.dumps(finite_or_null(report), indent=1, allow_nan=False)
    (DOCS / "proof" / "tables_of_trials.json").write_text(told + "\n", encoding="utf-8")
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(before + BEGIN + text + END + rest.split(END)[1], encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
