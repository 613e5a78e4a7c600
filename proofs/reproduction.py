"""Comparison of Chapter 3 of the thesis with the results of this program.

Writes ``docs/reproduction.md`` and its figures, ``docs/proof/reproduction.json``. Everything except
the numbers of the thesis is computed here. ``--only PART`` computes one part and prints its lines
of the page, ``--page`` writes the page from the stored figures, ``--pictures`` draws Figs. 3.4 to
3.24 into ``docs/images/reproduction``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from provenance import provenance
from thesis.claim import Claim
from thesis.commands import REPEATS
from thesis.concept import concept, concept_claims
from thesis.linearization import linearization, linearization_claims
from thesis.loops import SWING, Figures
from thesis.model import friction_model, model_claims, parameters
from thesis.nctf import coasting, nctf, nctf_claims
from thesis.pictures import CAPTIONS, PICTURES, save
from thesis.plane import plane, plane_claims
from thesis.solvers import loose_solvers, solver_table
from thesis.systems import spectra, system_claims
from thesis.tables import exponent_tables, table_claims, tables
from thesis.undecided import undecided

from ballscrew.solver.files import finite_or_null

ROOT = Path(__file__).resolve().parents[1]


PAGE = ROOT / "docs" / "reproduction.md"


FIGURES = ROOT / "docs" / "proof" / "reproduction.json"


PARTS: dict[str, Callable[[], Figures]] = {
    "parameters": parameters,
    "concept": concept,
    "friction_model": friction_model,
    "linearization": linearization,
    "coasting": coasting,
    "nctf": nctf,
    "spectra": spectra,
    "plane": plane,
    "loose_solvers": loose_solvers,
    "tables": tables,
}


SECTIONS: tuple[tuple[str, Callable[[Figures], list[Claim]]], ...] = (
    ("3.2 Concept of Lyapunov exponents", concept_claims),
    ("3.3 State space model", model_claims),
    ("3.4.1 Input-output linearization", linearization_claims),
    ("3.4.2 NCTF controller", nctf_claims),
    ("3.5.1.1-3.5.1.2 Two perturbed linearizing loops", system_claims),
    ("3.5.1.3 The region of Fig. 3.18", plane_claims),
    ("3.5.2 NCTF controllers of perturbed plants", table_claims),
)


def page(report: Figures) -> str:
    """The text of ``docs/reproduction.md`` from ``docs/proof/reproduction.json``."""
    f = report["figures"]
    sections = [(title, make(f)) for title, make in SECTIONS]
    claims = [c for _, found in sections for c in found]
    counted = [c for c in claims if c.printed]
    agree = sum(c.agrees for c in counted)
    lines = [
        "# Chapter 3 of the thesis beside this program",
        "",
        f"{len(counted)} numbers and statements of Chapter 3, compared with this program: "
        f"{agree} agree, {len(counted) - agree} differ. {len(claims) - len(counted)} more lines "
        "are "
        'marked "not counted": the thesis prints nothing that they could be compared with. The '
        'column "here", and every number in an explanation that is not the thesis\' own, was '
        f"computed by `python proofs/reproduction.py` (commit {report['commit'][:12]} of "
        f"{report['committed'][:10]}). The figures are in "
        "[proof/reproduction.json](proof/reproduction.json). The pictures show Figs. 3.4 to 3.24 "
        "as this program computes them. What is black in them is what the thesis says or prints.",
        "",
        "Exponents are in bits/s. The first tangent vectors are the identity in the order x, v, "
        "z, i, controller, in SI units. If nothing else is said, the step is 8 cm from rest and "
        "20 s long, and the linearizing controller computes x1'' from its estimates. \"Stands\", "
        '"swings" and "diverges" describe the last two of 20 s. A loop swings if x moves by more '
        f"than {1e6 * SWING:g} um to either side.",
        "",
    ]
    extra = {4: solver_table, 6: exponent_tables}
    drawn = {2: ("linearization",), 3: ("nctf",), 4: ("system_1", "system_2"), 5: ("plane",)}
    drawn[6] = ("nctf_70", "nctf_130")
    for k, (title, found) in enumerate(sections):
        lines += [f"## {title}", "", "| | where | the thesis says | thesis | here | agree if | |"]
        lines.append("|---|---|---|---|---|---|---|")
        for n, c in enumerate(found, start=1):
            cells = (_label(k, n), c.where, c.says, c.thesis, c.here, c.rule, c.verdict)
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
        for n, c in enumerate(found, start=1):
            if c.why:
                lines += [f"**{_label(k, n)}.** {c.why}", ""]
        if k in extra:
            lines += [*extra[k](f), ""]
        for name in drawn.get(k, ()):
            lines += [f"![{CAPTIONS[name]}](images/reproduction/{name}.png)", ""]
            lines += [f"{CAPTIONS[name]}", ""]
        lines += ["To repeat the lines of this section:", "", *_commands(k, len(found)), ""]
    lines += ["## What cannot be decided from the text", ""]
    lines += [f"- {text}" for text in undecided(f)]
    return "\n".join(lines).replace("|m|", "\\|m\\|") + "\n"


def _commands(section: int, count: int) -> list[str]:
    """A table of lines and the commands that repeat them."""
    by_command: dict[str, list[str]] = {}
    for label in (_label(section, n) for n in range(1, count + 1)):
        by_command.setdefault(REPEATS[label], []).append(label)
    rows = [f"| {', '.join(labels)} | `{command}` |" for command, labels in by_command.items()]
    return ["| lines | command |", "|---|---|", *rows]


def _label(section: int, n: int) -> str:
    return f"{chr(ord('A') + section)}{n}"


def labelled(figures: Figures) -> list[tuple[str, Claim]]:
    """All lines of the page with their labels."""
    made = [make(figures) for _, make in SECTIONS]
    return [(_label(k, n), c) for k, found in enumerate(made) for n, c in enumerate(found, start=1)]


def stored() -> dict[str, Any]:
    """Content of ``docs/proof/reproduction.json``."""
    report: dict[str, Any] = json.loads(FIGURES.read_text(encoding="utf-8"))
    return report


def repeat(part: str) -> None:
    """Compute one part again and print its lines; the other parts are as stored."""
    anew = json.loads(json.dumps(finite_or_null(PARTS[part]())))
    for label, c in labelled(stored()["figures"] | {part: anew}):
        if REPEATS[label].endswith(f" --only {part}"):
            print(f"{label} {c.where}: {c.says}: thesis {c.thesis}, here {c.here}: {c.verdict}")


def whole() -> int:
    """Compute everything, write the figures and the page; 1 if a difference is not explained."""
    figures: Figures = {}
    for name, compute in PARTS.items():
        before = time.perf_counter()
        figures[name] = compute()
        print(f"{name}: {time.perf_counter() - before:.0f} s", file=sys.stderr)
    text = (
        json.dumps(finite_or_null({**provenance("reproduction"), "figures": figures}), indent=1)
        + "\n"
    )
    FIGURES.write_text(text, encoding="utf-8")
    report = stored()
    PAGE.write_text(page(report), encoding="utf-8")
    found = [c for _, c in labelled(report["figures"])]
    for c in found:
        if not c.agrees:
            print(f"differs: {c.where}: {c.says}: {c.thesis}, here {c.here}")
    unexplained = [c.says for c in found if not c.agrees and not any(map(str.isdigit, c.why))]
    return 1 if unexplained else 0


def parser() -> argparse.ArgumentParser:
    """The options of this script."""
    made = argparse.ArgumentParser(description=__doc__)
    one = made.add_mutually_exclusive_group()
    one.add_argument(
        "--only", choices=PARTS, help="compute one part, print its lines, write nothing"
    )
    one.add_argument("--page", action="store_true", help="write the page from the stored figures")
    one.add_argument("--pictures", action="store_true", help="draw Figs. 3.4 to 3.24 (a minute)")
    return made


def main() -> int:
    asked = parser().parse_args()
    if asked.only:
        repeat(asked.only)
    elif asked.page:
        PAGE.write_text(page(stored()), encoding="utf-8")
    elif asked.pictures:
        for name in PICTURES:
            save(name)
    else:
        return whole()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
