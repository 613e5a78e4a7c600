"""The tables of ``docs/diagnosis.md`` and ``docs/emps.md``, from the stored proofs.

``python proofs/diagnosis_page.py`` writes them between the pages' marks; a test compares the
pages with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from provenance import ROOT, stored

PAGE = ROOT / "docs" / "diagnosis.md"
OF_EMPS = ROOT / "docs" / "emps.md"
ASKED = {
    "clear effects: named rightly": "65 %",
    "clear effects: at most two in the answer, one of them right": "80 %",
    "clear effects: `none`": "at most 8 %",
    "records with effects: a wrong name": "at most 2 %",
    "faultless records: a name": "at most 1 %",
    "faultless records: a fault is reported": "at most 3 %",
    "answers with a cause built in: the force on held-out data may grow": "0",
}


def per_cent(share: Mapping[str, Any]) -> str:
    """A share and its number of records."""
    if not share["records"]:
        return "-"
    return f"{100 * share['share']:.1f} % of {share['records']}"


def counts(share: Mapping[str, Any]) -> str:
    """A share as a count."""
    n = share["records"]
    return f"{round(share['share'] * n)} of {n}" if n else "-"


def bounds(share: Mapping[str, Any]) -> str:
    """Bounds of Wilson's interval."""
    low, high = (100 * b for b in share["wilson_95"])
    return f"{low:.1f} to {high:.1f} %"


def rule(proof: Mapping[str, Any]) -> list[str]:
    """How often the rule is right and wrong."""
    lines = ["| | found | 95 % interval (Wilson) | target |", "|---|---|---|---|"]
    for says, found in proof["all worlds"].items():
        lines.append(f"| {says} | {per_cent(found)} | {bounds(found)} | {ASKED.get(says, '-')} |")
    return lines


def worlds(proof: Mapping[str, Any]) -> list[str]:
    """The same for each world."""
    shown = {
        "clear effects: named rightly": "clear effects: named rightly",
        "records with effects: a wrong name": "effects: a wrong name",
        "faultless records: a name": "faultless: a name",
        "faultless records: a fault is reported": "faultless: a fault is reported",
    }
    lines = [f"| world | {' | '.join(shown.values())} |", "|---" * 5 + "|"]
    for world, found in proof["worlds"].items():
        lines.append(f"| `{world}` | {' | '.join(counts(found[k]) for k in shown)} |")
    return lines


HIDDEN = {
    "friction 10 % larger one way": "friction 10 % larger in one direction",
    "friction swings by 1 N, 100 times a metre": "friction varies by 1 N, 100 periods per metre",
    "ripple of 1 N, 60 times a metre": "ripple of 1 N, 60 periods per metre",
}


def hidden(proof: Mapping[str, Any]) -> list[str]:
    """Effects added to the record of EMPS, and the answers."""
    lines = [
        "| added force | rms | found | verdict, built in | residual on held-out data, before and "
        "after |",
        "|---|---|---|---|---|",
    ]
    for row in proof["hidden"]:
        built = ", ".join(f"`{c['name']}`" for c in row["causes"]) or "nothing"
        already = ", in the answer before" if row["had_it_already"] else ""
        force = [row[f"{when}_residual"]["force_N"] for when in ("adjusted", "final")]
        lines.append(
            f"| {HIDDEN.get(row['effect'], row['effect'])} (`{row['cause']}`{already}) | "
            f"{row['force_rms_N']:.1f} N | {'yes' if row['found'] else 'no'} | "
            f"{row['verdict']}: {built} | {force[0]:.2f} N, {force[1]:.2f} N |"
        )
    return lines


def pages() -> dict[Path, str]:
    """The pages with the figures as they are stored."""
    proof = stored("diagnosis_rule")
    of_diagnosis = {"rule": rule(proof), "worlds": worlds(proof)}
    return {
        PAGE: filled(PAGE, of_diagnosis),
        OF_EMPS: filled(OF_EMPS, {"hidden": hidden(stored("emps"))}),
    }


def filled(page: Path, tables: Mapping[str, list[str]]) -> str:
    """A page with these tables between its marks."""
    text = page.read_text(encoding="utf-8")
    for name, lines in tables.items():
        table = "\n".join(["", "", *lines, "", ""])
        mark = f"<!-- figures: {name} -->"
        before, _, rest = text.partition(mark)
        _, end, after = rest.partition("<!-- end -->")
        if not end:
            raise ValueError(f"{page}: expected {mark} and an end behind it")
        text = before + mark + table + end + after
    return text


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
