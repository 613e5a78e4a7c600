"""Whole diagnoses of records of the worlds, with one effect or none in each.

Counts how often the rule names rightly and wrongly, by world, and whether the force on held-out
data falls with what is built in. The numbers of `ballscrew.measurement.diagnosis.rule` were set on
other seeds. The worlds of `HELD_BACK` are drawn only if they are asked for by name (``--only``).
"""

from __future__ import annotations

import random
from argparse import Namespace
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from runner import Row, share
from worlds import HELD_BACK, OUTSIDE, WORLDS, Unusable, draw_case, effects_of, write_case

from ballscrew import read_drive_records, read_parameters
from ballscrew.measurement.diagnosis.causes import OUTSIDE as IN_NO_CAUSE
from ballscrew.measurement.diagnosis.causes import entry_of
from ballscrew.measurement.diagnosis.diagnosis import diagnose_records
from ballscrew.measurement.diagnosis.model import Drive, commanded, drive_of
from ballscrew.measurement.records.record import Record
from ballscrew.solver.errors import BadRecord

FIRST, RECORDS = 2_700_000, 180
FAULTLESS = 10  # faultless records of a world, to one of each effect
VISIBLE = 12.0  # least ratio at which an answer is required
# equivalent names: a wrong value of these is that cause
SYNONYMS = {"m": "unmodelled_inertia", "Jm": "unmodelled_inertia", "offset": "load_bias"}
# a late command and early stamps of the command are equal in a record
LATE = {"input_delay", "time_shift"}


Trial = tuple[str, str, int]  # world, effect or an empty text, seed


def drawn(world: str, effect: str, seed: int) -> tuple[list[Record], Drive, list[Any]]:
    """A record read from its files, which do not contain the truth; and what is visible in it."""
    case = draw_case(world, (effect,) if effect else (), seed)
    with TemporaryDirectory() as folder:
        paths, believed = write_case(case, Path(folder))
        model = drive_of(read_parameters(believed))
        records, model, _ = commanded(read_drive_records(paths), model)
    return records, model, [*case.sights]


def right_names(effect: str, shared: Sequence[str]) -> set[str]:
    """The true cause, and causes with the same shape in the record."""
    truth = IN_NO_CAUSE if effect in OUTSIDE else effect
    same = {"parameter_error"} if truth in SYNONYMS.values() else set()
    return {truth, *shared, *same, *(LATE if truth in LATE else ())}


def plan_trials(first_seed: int, worlds: Sequence[str]) -> list[Trial]:
    """One record of every effect in every world and ten faultless ones, all alternately."""
    placed = []
    for world in worlds:
        names = ["", *(name for group in effects_of(world) for name in group)]
        for kind, name in enumerate(names):
            count = 1 if name else FAULTLESS
            for k in range(count):
                placed.append(((k + 0.5) / count, kind, (world, name, first_seed + k)))
    return [trial for *_, trial in sorted(placed, key=lambda p: p[:2])]


def tasks(asked: Namespace) -> dict[str, Trial]:
    worlds = [w for w in WORLDS if (w in asked.only if asked.only else w not in HELD_BACK)]
    plan = plan_trials(asked.first or FIRST, worlds)
    random.Random(0).shuffle(plan)
    chosen = plan[: asked.draws or RECORDS]
    return {":".join((w, e or "faultless", str(k))): (w, e, k) for w, e, k in chosen}


def trial(world: str, effect: str, seed: int) -> Row:
    row: Row = {"world": world, "effect": effect, "seed": seed}
    try:
        records, model, sights = drawn(world, effect, seed)
        found = diagnose_records(records, model)
    except (Unusable, BadRecord) as reason:
        return row | {"message": str(reason)}
    kept = [(c.name, c.certain, c.alike, c.gain_interval[0]) for c in found.causes]
    causes = [dict(zip(("name", "certain", "alike", "gain"), c, strict=True)) for c in kept]
    return row | {
        "ratio": sights[0].ratio if sights else 0.0,  # visibility of the effect
        "right": sorted(right_names(effect, sights[0].shared)) if sights else [],
        "verdict": found.verdict,
        "causes": causes,
        "suspects": [s.name for s in found.suspects],
    }


def clear(row: Row) -> bool:
    """Whether a row has an effect of the catalogue that its record shows clearly."""
    return bool(row["effect"] and row["effect"] not in OUTSIDE and row["ratio"] > VISIBLE)


def entries(names: Iterable[str]) -> set[str]:
    return {entry_of(name) for name in names}


def named(row: Row) -> set[str]:
    return entries(c["name"] for c in row["causes"] if c["certain"])


def answer(row: Row) -> set[str]:
    return entries([*(c["name"] for c in row["causes"]), *row["suspects"]])


def right(row: Row) -> set[str]:
    return entries(row["right"])


def measured(rows: Sequence[Row]) -> Row:
    some = {
        "clear effects": [r for r in rows if clear(r)],
        "records with effects": [r for r in rows if r["effect"]],
        "faultless records": [r for r in rows if not r["effect"]],
        "answers with a cause built in": [r for r in rows if r["causes"]],
    }
    hits: dict[str, Callable[[Row], bool]] = {
        "clear effects: named rightly": lambda r: bool(named(r) & right(r)),
        "clear effects: at most two in the answer, one of them right":
            lambda r: len(answer(r)) <= 2 and bool(answer(r) & right(r)),
        "clear effects: `none`": lambda r: r["verdict"] == "none",
        "records with effects: a wrong name": lambda r: bool(named(r) - right(r)),
        "faultless records: a name": lambda r: bool(named(r)),
        "faultless records: a fault is reported":
            lambda r: r["verdict"] not in ("none", "undecided"),
        "answers with a cause built in: the force on held-out data may grow":
            lambda r: min(c["gain"] for c in r["causes"]) <= 0.0,
    }  # fmt: skip
    return {what: share([hit(r) for r in some[what.split(":")[0]]]) for what, hit in hits.items()}


def report(rows: Sequence[Row]) -> Row:
    usable = [r for r in rows if "verdict" in r]
    worlds = sorted({r["world"] for r in rows})
    return {
        "seeds": [min(r["seed"] for r in rows), max(r["seed"] for r in rows)],
        "records": len(usable),
        "not usable": len(rows) - len(usable),
        "all worlds": measured(usable),
        "worlds": {w: measured([r for r in usable if r["world"] == w]) for w in worlds},
        "wrong": [r for r in usable if named(r) - right(r)],
        "example": next((r for r in usable if clear(r) and named(r) & right(r)), None),
    }


def says(report: Row) -> str:
    both = "clear effects: named rightly", "records with effects: a wrong name"
    clear, wrong = (report["all worlds"][k] for k in both)
    return (
        f"{clear.get('share', 0):.0%} of {clear['records']} clear effects are named rightly, "
        f"{wrong.get('share', 0):.0%} of {wrong['records']} records with effects wrongly"
    )
