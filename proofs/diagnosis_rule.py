"""Proof: whole diagnoses of records of the worlds, with one effect or none in each.

Counts how often the rule names rightly and wrongly, by world, and whether the force on held-out
data falls with what is built in. Writes ``docs/proof/diagnosis_rule.json``; rows are kept and not
made again. The numbers of `ballscrew.measurement.diagnosis.rule` were set on other seeds::

    python proofs/diagnosis_rule.py --records 130 --first-seed 2100000
"""

from __future__ import annotations

import os

from ballscrew.solver.errors import BadRecord

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; workers run in parallel

import argparse
import json
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from provenance import provenance
from worlds import HELD_BACK, WORLDS, Unusable
from worlds import OUTSIDE as NOT_IN_CATALOGUE
from worlds_trials import VISIBLE, Trial, drawn, plan_trials, right_names, share

from ballscrew.measurement.diagnosis.causes import entry_of
from ballscrew.measurement.diagnosis.diagnose import diagnose_records
from ballscrew.options import add_worker_options, open_workers
from ballscrew.solver.files import write_json

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "diagnosis_rule.json"
ROWS = ROOT / "out" / "diagnosis_rule.jsonl"

Row = dict[str, Any]


def row_of(trial: Trial) -> Row:
    """Draw a record and diagnose it."""
    row: Row = {"world": trial.world, "effect": trial.effect, "seed": trial.seed}
    try:
        case = drawn(trial)
        records, model = case.read()
        began = time.process_time()
        found = diagnose_records(records, model)
    except (Unusable, BadRecord) as reason:
        return row | {"message": str(reason)}
    causes = [
        {"name": c.name, "certain": c.certain, "alike": c.alike, "gain": c.gain_interval[0]}
        for c in found.causes
    ]
    return row | {
        "ratio": case.ratio,
        "right": sorted(right_names(trial.effect, case.shared)) if trial.effect else [],
        "verdict": found.verdict,
        "causes": causes,
        "suspects": [s.name for s in found.suspects],
        "seconds": round(time.process_time() - began, 2),
    }


def clear(row: Row) -> bool:
    """Whether a row has an effect of the catalogue that its record shows clearly."""
    known = row["effect"] and row["effect"] not in NOT_IN_CATALOGUE
    return bool(known and row["ratio"] > VISIBLE)


def entries(names: Any) -> set[str]:
    return {entry_of(name) for name in names}


def named(row: Row) -> set[str]:
    """Entries of the catalogue that are named."""
    return entries(c["name"] for c in row["causes"] if c["certain"])


def answer(row: Row) -> set[str]:
    """Entries in the answer."""
    return entries([*(c["name"] for c in row["causes"]), *row["suspects"]])


def measured(rows: list[Row]) -> dict[str, Any]:
    """Shares of the answers."""
    effects, faultless = ([r for r in rows if bool(r["effect"]) == told] for told in (True, False))
    seen = [r for r in effects if clear(r)]

    def of(some: list[Row], hit: Callable[[Row], bool]) -> dict[str, Any]:
        return share([hit(r) for r in some])

    def right(row: Row) -> set[str]:
        return entries(row["right"])

    return {
        "clear effects: named rightly": of(seen, lambda r: bool(named(r) & right(r))),
        "clear effects: the first cause built in is right": of(
            seen, lambda r: bool(r["causes"]) and entry_of(r["causes"][0]["name"]) in right(r)
        ),
        "clear effects: the right cause is in the answer": of(
            seen, lambda r: bool(answer(r) & right(r))
        ),
        "clear effects: at most two in the answer, one of them right": of(
            seen, lambda r: len(answer(r)) <= 2 and bool(answer(r) & right(r))
        ),
        "clear effects: `none`": of(seen, lambda r: r["verdict"] == "none"),
        "records with effects: a wrong name": of(effects, lambda r: bool(named(r) - right(r))),
        "faultless records: a name": of(faultless, lambda r: bool(named(r))),
        "faultless records: a fault is reported": of(
            faultless, lambda r: r["verdict"] not in ("none", "undecided")
        ),
        "faultless records: `undecided`": of(faultless, lambda r: r["verdict"] == "undecided"),
        "answers with a cause built in: the force on held-out data may grow": of(
            [r for r in rows if r["causes"]], lambda r: min(c["gain"] for c in r["causes"]) <= 0.0
        ),
    }


def report(rows: list[Row]) -> dict[str, Any]:
    """Content of the proof file; rows only where the answer is wrong."""
    usable = [r for r in rows if "verdict" in r]
    wrong = [r for r in usable if named(r) - entries(r["right"])]
    worlds = sorted({r["world"] for r in rows})
    return {
        "seeds": [min(r["seed"] for r in rows), max(r["seed"] for r in rows)],
        "records": len(usable),
        "not usable": len(rows) - len(usable),
        "all worlds": measured(usable),
        "processor seconds, median": float(np.median([r["seconds"] for r in usable])),
        "worlds": {w: measured([r for r in usable if r["world"] == w]) for w in worlds},
        "wrong": wrong,
        "example": next((r for r in usable if clear(r) and named(r) & entries(r["right"])), None),
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--records", type=int, default=130)
    parser.add_argument("--first-seed", type=int, default=2100000)
    parser.add_argument("--held-back", action="store_true", help="the worlds never used before")
    add_worker_options(parser)
    parser.add_argument("--rows", type=Path, default=ROWS, help="kept rows, not made again")
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    worlds = tuple(w for w in WORLDS if (w in HELD_BACK) == options.held_back)
    kept = options.rows.read_text().splitlines() if options.rows.exists() else []
    rows = [json.loads(line) for line in kept]
    have = {(r["world"], r["effect"], r["seed"]) for r in rows}
    plan = plan_trials(1, options.first_seed, worlds)
    random.Random(0).shuffle(plan)
    plan = plan[: options.records]
    trials = [t for t in plan if (t.world, t.effect, t.seed) not in have]
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    with options.rows.open("a", encoding="utf-8") as file:
        workers = open_workers(options)
        for _, row in workers.map(row_of, iter([(t.key, (t,)) for t in trials])):
            rows.append(row)
            file.write(json.dumps(row) + "\n")
            file.flush()
    told = report(rows)
    write_json(options.out, {**provenance("diagnosis_rule"), **told})
    print(json.dumps(told["all worlds"], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
