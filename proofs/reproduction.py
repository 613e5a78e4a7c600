"""Chapter 3 of the thesis beside what this program gets.

Writes ``docs/reproduction.md`` and the figures it is made of, ``docs/proof/reproduction.json``.
Everything but the thesis' own numbers is computed here.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

from provenance import provenance
from thesis.claim import Claim
from thesis.concept import concept, concept_claims
from thesis.linearization import linearization, linearization_claims
from thesis.loops import SWING, Figures
from thesis.model import friction_model, model_claims, parameters
from thesis.nctf import coasting, nctf, nctf_claims
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
    """The text of ``docs/reproduction.md`` from what ``docs/proof/reproduction.json`` holds."""
    f = report["figures"]
    sections = [(title, make(f)) for title, make in SECTIONS]
    claims = [c for _, found in sections for c in found]
    counted = [c for c in claims if c.printed]
    agree = sum(c.agrees for c in counted)
    lines = [
        "# Chapter 3 of the thesis beside this program",
        "",
        f"{len(counted)} numbers and statements that Chapter 3 prints, each beside what this "
        f"program gets: {agree} agree, {len(counted) - agree} differ. {len(claims) - len(counted)} "
        'more lines, marked "not counted", compare with nothing that the thesis prints or claims. '
        'All in the column "here", and every '
        "number in an explanation that is not the thesis' own, was computed by `python "
        f"proofs/reproduction.py` (commit {report['commit'][:12]} of {report['committed'][:10]}); "
        "the figures are in [proof/reproduction.json](proof/reproduction.json).",
        "",
        "Exponents are in bits/s. The first tangent vectors are the identity in the order x, v, "
        "z, i, controller, in SI units. Where nothing else is said the step is 8 cm from rest, 20 "
        "s long, and the linearizing controller takes x1'' from its estimates. \"Stands\", "
        '"swings" and "diverges" are said of the last two of 20 s; swinging means more than '
        f"{1e6 * SWING:g} um to either side.",
        "",
    ]
    extra = {4: solver_table, 6: exponent_tables}
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
    lines += ["## What cannot be decided from the text", ""]
    lines += [f"- {text}" for text in undecided(f)]
    return "\n".join(lines).replace("|m|", "\\|m\\|") + "\n"


def _label(section: int, n: int) -> str:
    return f"{chr(ord('A') + section)}{n}"


def main() -> int:
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
    report = json.loads(text)
    PAGE.write_text(page(report), encoding="utf-8")
    claims = [c for _, make in SECTIONS for c in make(report["figures"])]
    for c in claims:
        if not c.agrees:
            print(f"differs: {c.where}: {c.says}: {c.thesis}, here {c.here}")
    unexplained = [c.says for c in claims if not c.agrees and not any(map(str.isdigit, c.why))]
    return 1 if unexplained else 0


if __name__ == "__main__":
    raise SystemExit(main())
