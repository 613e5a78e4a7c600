"""Modes in model exchange work under the actions of hosts.

A host adds round-off to the states, uses random communication steps and tolerances, and stops
before, at or after an event; half of the runs are by FMI 2.0 and half by FMI 3.0. At tolerances of
1e-9 to 1e-6 a run may differ from co-simulation by at most ten times the effect of the same
tolerance, steps and round-off there. At any tolerance, a body must never stick above its break-away
force.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from exchange_courses import COMPONENTS, TOLERANCES, cases, complaint, outcome
from runner import Row

COURSES = 200


def tasks(asked: Namespace) -> dict[str, tuple[Any, ...]]:
    each = (asked.draws or COURSES) // (2 * len(COMPONENTS))
    return {f"{name}, FMI {fmi}": (name, fmi, each) for name in COMPONENTS for fmi in (2, 3)}


def trial(name: str, fmi: int, count: int) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        kernel, path = COMPONENTS[name].made(fmi, Path(folder))
        seen = [outcome(kernel, path, one) for one in cases(name, fmi, count)]
    return [
        {"component": name, "fmi": fmi, "seed": one.case.seed, "complaint": complaint(one)}
        | {"share": one.distance / one.allowed, "judged": one.case.tolerance <= TOLERANCES[1]}
        for one in seen
    ]


def report(found: Sequence[list[Row]]) -> Row:
    rows = [row for some in found for row in some]
    wrong = [r for r in rows if r["complaint"]]
    largest = {"largest_share_of_allowed": max(r["share"] for r in rows if r["judged"])}
    return {"courses": len(rows), "wrong": wrong, **largest, "holds": not wrong}


def says(report: Row) -> str:
    share = report["largest_share_of_allowed"]
    return f"{report['courses']} courses: the largest error is {share:.2f} of the allowed one"
