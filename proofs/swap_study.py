"""Proof: two equal controllers are seldom called different; one that is 10 % worse mostly is.

Writes ``docs/proof/swap_study.json``: 300 small studies. In each, the same controller takes part
twice, tuned with different seeds, so that the two differ only by chance in the tuning. Then the
errors of one are increased by 10 %. The errors come from real runs, but an increase of exactly 10 %
on every plant is artificial, so the second rate is an upper bound.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from provenance import provenance
from scipy.stats import binomtest

from ballscrew.orchestration.fmu.operating_system import pool
from ballscrew.orchestration.study import study as studies
from ballscrew.orchestration.study.plan import Duty, Entrant, Plan, Tuning, Variation
from ballscrew.orchestration.study.result import compare
from ballscrew.orchestration.study.workers import Processes

TARGET = Path(__file__).resolve().parents[1] / "docs" / "proof" / "swap_study.json"
STUDIES = 300
FIRST_SEED = 1000  # smaller seeds were used to choose the level of the intervals
WORSE = 1.1
MOST_CALLED_DIFFERENT, LEAST_TOLD_APART = 0.10, 0.80
GAINS = {"Kp": (30.0, 3000.0), "Ki": (1.0, 3000.0), "Kd": (0.1, 200.0)}
PLAN = Plan(
    plant="plant",
    entrants=(Entrant("first", "pid", tune=GAINS), Entrant("second", "pid", tune=GAINS)),
    duties=(
        Duty("tune", "move:distance=0.01,speed=0.1,start=0,dwell=0.1,back=0", 0.4, True),
        Duty("judge", "move:distance=-0.006,speed=0.1,start=0,dwell=0.1,back=0", 0.35),
    ),
    variations=(
        Variation(("Fc", "Fs", "sigma2"), (0.7, 1.3)),
        Variation(("m",), (1.0, 1.5)),
    ),
    tuning=Tuning(budget=40, plants=0, seeds=3),
    plants=20,
    period=0.0,
)


def outcome(seed: int) -> dict[str, Any]:
    """One study: whether the equal, and the unequal, controllers are distinguished."""
    plan = replace(PLAN, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        work = studies.Work.of(plan, Path(folder), Processes(1))
        figures = work.figures(work.tunings())
    errors = figures["rms_error"][:, :, 0]
    equal = compare(errors[0], errors[1])
    return {
        "seed": seed,
        "ratio": equal.ratio,
        "low": equal.low,
        "high": equal.high,
        "equal_told_apart": equal.told_apart,
        "worse_told_apart": compare(WORSE * errors[0], errors[1]).told_apart,
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Rates with one-sided 95 % bounds (Clopper-Pearson)."""
    count = len(rows)
    wrong = sum(r["equal_told_apart"] for r in rows)
    right = sum(r["worse_told_apart"] for r in rows)
    below = binomtest(wrong, count, alternative="less").proportion_ci(0.95, method="exact").high
    above = binomtest(right, count, alternative="greater").proportion_ci(0.95, method="exact").low
    return {
        "studies": count,
        "equal_called_different": wrong,
        "equal_called_different_upper_95": float(below),
        "worse_told_apart": right,
        "worse_told_apart_lower_95": float(above),
        "met": bool(below <= MOST_CALLED_DIFFERENT and above >= LEAST_TOLD_APART),
    }


def main() -> None:
    with pool(2) as workers:
        rows = list(workers.map(outcome, range(FIRST_SEED, FIRST_SEED + STUDIES)))
    found = summary(rows)
    report = provenance("swap_study") | {"summary": found, "outcomes": rows}
    TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
