"""Over random stiff linear and nonlinear loops, no wrong result is called trusted.

A result is wrong if the error of some output is more than one percent of its range, and right if no
error is more than a third of that, compared with the exact solution or the complete loop in one
solver. A loop for which two such solutions differ by a hundredth of a percent is left out and
counted, because its truth is not known.

The verdict's constants were chosen on linear seeds below 6000 and nonlinear seeds below 1000; the
checks of command times and of switches came from loops with seeds from 30000 to 40200, so these are
not used.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence

from runner import Row, seeds

from verdict import linear, nonlinear
from verdict.parts import deceived, summary, told

FIRST, LINEAR, NONLINEAR = 50_000, 1000, 400  # a quarter of the nonlinear ones in each family
AGAIN = slice(200, 205)  # rows that are kept, to be made again
OUTCOMES = {"linear": linear.outcome, "nonlinear": nonlinear.outcome}


def tasks(asked: Namespace) -> dict[str, tuple[str, int]]:
    drawn = {"nonlinear": seeds(asked, NONLINEAR, FIRST), "linear": seeds(asked, LINEAR, FIRST)}
    return {f"{kind} {seed}": (kind, seed) for kind, some in drawn.items() for seed in some}


def trial(kind: str, seed: int) -> Row:
    return {"kind": kind, **OUTCOMES[kind](seed)}


def report(rows: Sequence[Row]) -> Row:
    kinds = {kind: some for kind in OUTCOMES if (some := [r for r in rows if r["kind"] == kind])}
    families = {f: [r for r in rows if r.get("family") == f] for f in nonlinear.FAMILIES}
    misled = deceived(rows)
    return {
        "seeds": {kind: [some[0]["seed"], some[-1]["seed"] + 1] for kind, some in kinds.items()},
        "summary": {name: summary(some) for name, some in (kinds | families).items()},
        "wrong": misled,
        "again": [row for some in kinds.values() for row in some[AGAIN]],
        "holds": not misled,
    }


def says(report: Row) -> str:
    kinds = ((kind, report["summary"][kind]) for kind in report["seeds"])
    return "; ".join(f"{found['loops']} {kind} loops: {told(found)}" for kind, found in kinds)
