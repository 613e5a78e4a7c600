"""The figures of ``docs/diagnosis.md``, from the stored proofs.

``python proofs/diagnosis_page.py`` writes them between the page's marks; a test compares the
page with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from provenance import ROOT, stored

PAGE = ROOT / "docs" / "diagnosis.md"
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
        lines.append(f"| {key} | {both[0]} | {both[1]} |")
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
        name = "- (all pieces)" if piece == "all pieces" else piece
        lines.append(f"| {name} | {right} | {apart:.3f} | {found['seconds, median']:.1f} |")
    return lines


def page() -> str:
    """The page with the figures as they are stored."""
    tables = {
        "sets": sets(stored("diagnosis_sets"), "all worlds"),
        "worlds": worlds(stored("diagnosis_sets")),
        "held back": sets(stored("diagnosis_held_back"), "all worlds"),
        "loop": loop(stored("diagnosis_loop")),
        "ablation": ablation(stored("ablation")),
    }
    text = PAGE.read_text(encoding="utf-8")
    for name, lines in tables.items():
        table = "\n".join(["", "", *lines, "", ""])
        mark = f"<!-- figures: {name} -->"
        before, _, rest = text.partition(mark)
        _, end, after = rest.partition("<!-- end -->")
        if not end:
            raise ValueError(f"{PAGE}: expected {mark} and an end behind it")
        text = before + mark + table + end + after
    return text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
