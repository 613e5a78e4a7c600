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
    "truth in the set": ("all records: the right cause is in the answer", "95 %"),
    "truth in the set, clear effects": ("clear effects: the right cause is in the answer", "95 %"),
    "named rightly, clear effects": ("clear effects: named correctly", "65 %"),
    "the likeliest is right, clear effects": ("clear effects: the most likely cause is right", "-"),
    "at most two with the truth, clear effects": (
        "clear effects: at most two members, one of them right",
        "85 %",
    ),
    "named wrongly, of records with effects": ("records with effects: a wrong name", "at most 2 %"),
    "named wrongly, faultless": ("faultless records: a name", "at most 2 %"),
    "faultless, nothing is ruled out": (
        "faultless records: a fault is reported",
        "at most 3 %",
    ),
    "clear effects, nothing is ruled out": ("clear effects: a fault is reported", "-"),
}
LOOP = {
    "clear effects, first built in is right": "clear effects: the first cause built in is right",
    "clear effects, named rightly": "clear effects: named correctly",
    "clear effects, truth in the answer": "clear effects: the right cause is in the answer",
    "clear effects, truth among at most two": (
        "clear effects: at most two members, one of them right"
    ),
    "clear effects, mean number of names and suspects": (
        "clear effects: members of the answer, mean"
    ),
    "effects, a wrong name": "records with effects: a wrong name",
    "faultless, a name": "faultless records: a name",
    "faultless, anything but none": "faultless records: a fault is reported",
    "intervals of right causes that hold the truth": (
        "intervals of right causes that contain the true size"
    ),
    "processor seconds, median": "processor time [s], median",
}
PIECES = {
    "all pieces": "- (all pieces)",
    "blocks held out": "scoring on held-out blocks",
    "a limit to what many numbers tell": "limit for many numbers in a band",
    "taking out the noise of instruments": "subtraction of the instruments' noise",
    "noise that is always there": "least noise of a model",
    "a speed that follows within an interval": "speed within a sampling interval",
    "sizes between the points of grids": "sizes between grid points",
}


def per_cent(share: Mapping[str, Any]) -> str:
    """A share and its number of records."""
    if not share["records"]:
        return "-"
    return f"{100 * share['share']:.1f} % of {share['records']}"


def bounds(share: Mapping[str, Any]) -> str:
    """Bounds of Wilson's interval."""
    low, high = (100 * b for b in share["wilson_95"])
    return f"{low:.1f} to {high:.1f} %"


def sets(proof: Mapping[str, Any], of: str) -> list[str]:
    """How often the sets contain the right cause."""
    found = proof[of]
    lines = ["| | found | 95 % interval (Wilson) | target |", "|---|---|---|---|"]
    for key, (says, asked) in ASKED.items():
        lines.append(f"| {says} | {per_cent(found[key])} | {bounds(found[key])} | {asked} |")
    size = found["mean number of suspects, clear effects"]
    lines.insert(4, f"| clear effects: members of the set, mean | {size:.1f} | - | 2 |")
    return lines


def worlds(proof: Mapping[str, Any]) -> list[str]:
    """The same for each world."""
    lines = [
        "| world, the worst first | right cause in the answer | clear effects: members, mean | "
        "named correctly |",
        "|---|---|---|---|",
    ]
    for world, found in proof["worlds, the worst first"].items():
        size = found["mean number of suspects, clear effects"]
        lines.append(
            f"| `{world}` | {per_cent(found['truth in the set'])} | "
            f"{'-' if size is None else f'{size:.1f}'} | "
            f"{per_cent(found['named rightly, clear effects'])} |"
        )
    return lines


def loop(proof: Mapping[str, Any]) -> list[str]:
    """Complete diagnoses, before and after the next experiment."""
    before, after = (proof[k] for k in ("before", "after"))
    lines = ["| | one record | with the experiment |", "|---|---|---|"]
    for key, first in before.items():
        if isinstance(first, Mapping):
            both = [
                f"{round(s['share'] * s['records'])} of {s['records']}" if s["records"] else "-"
                for s in (first, after[key])
            ]
        else:
            both = [f"{value:.1f}" for value in (first, after[key])]
        lines.append(f"| {LOOP[key]} | {both[0]} | {both[1]} |")
    both = []
    for when in ("before", "after"):
        answers = [row[when] for row in proof["rows"] if row[when]["verdict"] == "explained"]
        holds = [held for answer in answers for held in answer["holds"]]
        both.append(f"{sum(holds)} of {len(holds)}")
    lines.insert(-1, f"| the same where the verdict is `explained` | {both[0]} | {both[1]} |")
    return lines


def ablation(proof: Mapping[str, Any]) -> list[str]:
    """The scores without each of their pieces."""
    lines = [
        "| without | clear effects: the right cause has the best score | distinguished from "
        "faultless ones | seconds, median |",
        "|---|---|---|---|",
    ]
    for piece, found in proof["without"].items():
        right = per_cent(found["clear effects, the truth has the best score"])
        apart = found["clear and faultless told apart by the best score"]
        name, took = PIECES.get(piece, piece), found["seconds, median"]
        lines.append(f"| {name} | {right} | {apart:.3f} | {took:.1f} |")
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
    of_diagnosis = {
        "sets": sets(stored("diagnosis_sets"), "all worlds"),
        "worlds": worlds(stored("diagnosis_sets")),
        "held back": sets(stored("diagnosis_held_back"), "all worlds"),
        "loop": loop(stored("diagnosis_loop")),
        "ablation": ablation(stored("ablation")),
    }
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
