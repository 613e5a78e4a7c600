"""Whole diagnoses of records of the worlds, with one effect or none in each.

Counts how often the rule names rightly and wrongly, by world, and whether the force on held-out
data falls with what is built in. The numbers of `ballscrew.measurement.diagnosis.rule` were set on
other seeds. The worlds of `HELD_BACK` are drawn only if they are asked for by name (``--only``).
"""

from __future__ import annotations

import random
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from runner import Row, share
from worlds import HELD_BACK, OUTSIDE, WORLDS, Unusable

from ballscrew.measurement.diagnosis.causes import entry_of
from ballscrew.measurement.diagnosis.diagnose import diagnose_records
from ballscrew.solver.errors import BadRecord
from diagnosis.trials import VISIBLE, Trial, drawn, plan_trials, right_names

FIRST, RECORDS = 2_100_000, 130


def tasks(asked: Namespace) -> dict[str, tuple[Trial]]:
    worlds = [w for w in WORLDS if (w in asked.only if asked.only else w not in HELD_BACK)]
    plan = plan_trials(asked.first or FIRST, worlds)
    random.Random(0).shuffle(plan)
    return {t.key: (t,) for t in plan[: asked.draws or RECORDS]}


def trial(asked: Trial) -> Row:
    """Draw a record and diagnose it."""
    row: Row = {"world": asked.world, "effect": asked.effect, "seed": asked.seed}
    try:
        case = drawn(asked)
        began = time.process_time()
        found = diagnose_records(case.records, case.model)
    except (Unusable, BadRecord) as reason:
        return row | {"message": str(reason)}
    causes = [
        {"name": c.name, "certain": c.certain, "alike": c.alike, "gain": c.gain_interval[0]}
        for c in found.causes
    ]
    return row | {
        "ratio": case.ratio,
        "right": sorted(right_names(asked.effect, case.shared)) if asked.effect else [],
        "verdict": found.verdict,
        "causes": causes,
        "suspects": [s.name for s in found.suspects],
        "seconds": round(time.process_time() - began, 2),
    }


def clear(row: Row) -> bool:
    """Whether a row has an effect of the catalogue that its record shows clearly."""
    return bool(row["effect"] and row["effect"] not in OUTSIDE and row["ratio"] > VISIBLE)


def entries(names: Iterable[str]) -> set[str]:
    """Entries of the catalogue."""
    return {entry_of(name) for name in names}


def named(row: Row) -> set[str]:
    return entries(c["name"] for c in row["causes"] if c["certain"])


def answer(row: Row) -> set[str]:
    return entries([*(c["name"] for c in row["causes"]), *row["suspects"]])


def right(row: Row) -> set[str]:
    return entries(row["right"])


def first(row: Row) -> set[str]:
    """The entry of the first cause that is built in."""
    return entries(c["name"] for c in row["causes"][:1])


def measured(rows: Sequence[Row]) -> Row:
    """Shares of the answers."""
    some = {
        "clear effects": [r for r in rows if clear(r)],
        "records with effects": [r for r in rows if r["effect"]],
        "faultless records": [r for r in rows if not r["effect"]],
        "answers with a cause built in": [r for r in rows if r["causes"]],
    }
    hits: dict[str, Callable[[Row], bool]] = {
        "clear effects: named rightly": lambda r: bool(named(r) & right(r)),
        "clear effects: the first cause built in is right": lambda r: bool(first(r) & right(r)),
        "clear effects: the right cause is in the answer": lambda r: bool(answer(r) & right(r)),
        "clear effects: at most two in the answer, one of them right": lambda r: (
            len(answer(r)) <= 2 and bool(answer(r) & right(r))
        ),
        "clear effects: `none`": lambda r: r["verdict"] == "none",
        "records with effects: a wrong name": lambda r: bool(named(r) - right(r)),
        "faultless records: a name": lambda r: bool(named(r)),
        "faultless records: a fault is reported": lambda r: (
            r["verdict"] not in ("none", "undecided")
        ),
        "faultless records: `undecided`": lambda r: r["verdict"] == "undecided",
        "answers with a cause built in: the force on held-out data may grow": lambda r: (
            min(c["gain"] for c in r["causes"]) <= 0.0
        ),
    }
    return {what: share([hit(r) for r in some[what.split(":")[0]]]) for what, hit in hits.items()}


def report(rows: Sequence[Row]) -> Row:
    usable = [r for r in rows if "verdict" in r]
    worlds = sorted({r["world"] for r in rows})
    return {
        "seeds": [min(r["seed"] for r in rows), max(r["seed"] for r in rows)],
        "records": len(usable),
        "not usable": len(rows) - len(usable),
        "all worlds": measured(usable),
        "processor seconds, median": float(np.median([r["seconds"] for r in usable])),
        "worlds": {w: measured([r for r in usable if r["world"] == w]) for w in worlds},
        "wrong": [r for r in usable if named(r) - right(r)],
        "example": next((r for r in usable if clear(r) and named(r) & right(r)), None),
    }


def says(report: Row) -> str:
    found = report["all worlds"]
    clear, wrong = (
        found[k] for k in ("clear effects: named rightly", "records with effects: a wrong name")
    )
    return (
        f"{clear.get('share', 0):.0%} of {clear['records']} clear effects are named rightly, "
        f"{wrong.get('share', 0):.0%} of {wrong['records']} records with effects wrongly"
    )
