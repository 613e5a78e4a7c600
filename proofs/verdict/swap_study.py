"""Two equal controllers are seldom called different; one that is 10 % worse mostly is.

In each of 300 small studies the same controller takes part twice, tuned with different seeds, so
that the two differ only by chance in the tuning. Then the errors of one are increased by 10 %. The
errors come from real runs, but an increase of exactly 10 % on every plant is artificial, so the
second rate is an upper bound.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from runner import Row, lower, seeds, upper

from ballscrew.orchestration.study import study as studies
from ballscrew.orchestration.study.plan import Duty, Entrant, Plan, Tuning, Variation
from ballscrew.orchestration.study.result import compare
from ballscrew.orchestration.study.workers import Processes

FIRST, STUDIES = 1000, 300  # smaller seeds were used to choose the level of the intervals
WORSE, MOST_CALLED_DIFFERENT, LEAST_TOLD_APART = 1.1, 0.10, 0.80
AGAIN = 7  # the row that is kept, to be made again
GAINS = {"Kp": (30.0, 3000.0), "Ki": (1.0, 3000.0), "Kd": (0.1, 200.0)}
PLAN = Plan(
    plant="plant",
    entrants=(Entrant("first", "pid", tune=GAINS), Entrant("second", "pid", tune=GAINS)),
    duties=(
        Duty("tune", "move:distance=0.01,speed=0.1,start=0,dwell=0.1,back=0", 0.4, True),
        Duty("judge", "move:distance=-0.006,speed=0.1,start=0,dwell=0.1,back=0", 0.35),
    ),
    variations=(Variation(("Fc", "Fs", "sigma2"), (0.7, 1.3)), Variation(("m",), (1.0, 1.5))),
    tuning=Tuning(budget=40, plants=0, seeds=3),
    plants=20,
    period=0.0,
)


def tasks(asked: Namespace) -> dict[str, tuple[int]]:
    return {f"study {seed}": (seed,) for seed in seeds(asked, STUDIES, FIRST)}


def trial(seed: int) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        work = studies.Work.of(replace(PLAN, seed=seed), Path(folder), Processes(1))
        errors = work.figures(work.tunings())["rms_error"][:, :, 0]
    equal = compare(errors[0], errors[1])
    row = {"seed": seed, "ratio": equal.ratio, "low": equal.low, "high": equal.high}
    worse = compare(WORSE * errors[0], errors[1])
    return row | {"equal_told_apart": equal.told_apart, "worse_told_apart": worse.told_apart}


def report(rows: Sequence[Row]) -> Row:
    count, wrong = len(rows), [r for r in rows if r["equal_told_apart"]]
    right = sum(r["worse_told_apart"] for r in rows)
    most, least = upper(len(wrong), count), lower(right, count)
    summary = {"studies": count, "equal_called_different": len(wrong), "worse_told_apart": right}
    summary |= {"equal_called_different_upper_95": most, "worse_told_apart_lower_95": least}
    return {
        "seeds": [rows[0]["seed"], rows[-1]["seed"] + 1],
        "summary": summary,
        "wrong": wrong,
        "again": rows[AGAIN % count],
        "holds": most <= MOST_CALLED_DIFFERENT and least >= LEAST_TOLD_APART,
    }


def says(report: Row) -> str:
    found = report["summary"]
    equal, worse = found["equal_called_different"], found["worse_told_apart"]
    return f"of {found['studies']} pairs {equal} equal ones and {worse} unequal ones told apart"
