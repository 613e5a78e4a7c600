"""On records of this program, with their true parameters, no cause is named.

A hundred records of `run`, `swap` and `rig` are made and diagnosed with the user's commands. A
record that is rejected with a reason is not a wrong name.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from diagnosed import run
from runner import Row

from ballscrew import diagnose
from ballscrew.measurement.rig.trials import trials_named

SEED = 1700
RUNS, SWAPS, TRIALS = 40, 10, 40  # a swap writes two records
CONTROLLERS = ("pid", "pid_sampled", "iol", "nctf")
TABLES = ("2.3.1", "2.4", "2.6", "viscous", "loading-rate")  # tables in which the block slides
LASTS = 12.0  # duration [s]
AGAIN = ("run pid motion 1", "rig 2.4/16 seed 39")  # kept, to be made again


def reference(seed: int, path: Path) -> None:
    """Write a motion of `LASTS` seconds: sines, ramps between positions, or smooth steps."""
    random = np.random.default_rng([SEED, seed])
    t = np.arange(0.0, LASTS + 0.005, 0.01)
    kind = seed % 3
    if kind == 0:
        x = sum(
            0.01 * random.uniform(0.3, 1.0) * np.sin(2 * np.pi * f * t + random.uniform(0, 6))
            for f in random.uniform(0.1, 0.8, 3)
        )
        x = x - x[0]
    else:
        places = np.append(0.0, random.uniform(-0.03, 0.03, 8))
        at = np.linspace(0.0, LASTS, len(places))
        x = np.interp(t, at, places)
        if kind == 2:
            here = np.clip(np.searchsorted(at, t) - 1, 0, len(places) - 2)
            share = (t - at[here]) / (at[1] - at[0])
            x = places[here] + np.diff(places)[here] * (3 - 2 * share) * share**2
    np.savetxt(path, np.column_stack([t, x]), delimiter=",", header="time,x_d", comments="")


def quiet(*arguments: str | Path) -> None:
    """Run a command that must succeed, or end with a result that is not trusted."""
    code, _, said = run(*arguments)
    if code not in (0, 1):
        raise RuntimeError(f"{arguments[0]} ended with {code}: {said}")


def made(kind: str, number: int, folder: Path) -> Iterator[tuple[str, Path, Path | None]]:
    """Names and files of records, and the parameter file of each."""
    if kind == "rig":
        trials = [t.name for table in TABLES for t in trials_named(table)]
        name = trials[number * 7 % len(trials)]
        quiet("rig", name, "--seed", str(number), "--out", folder)
        yield f"rig {name} seed {number}", folder / "record.csv", folder / "parameters.toml"
        return
    motion, out = folder / "motion.csv", folder / "out"
    reference(number, motion)
    common = ("--reference", motion, "--stop", str(LASTS), "--out", out)
    if kind == "run":
        controller = CONTROLLERS[number // 3 % len(CONTROLLERS)]
        quiet("run", "--controller", controller, *common)
        yield f"run {controller} motion {number}", out / "trajectory.csv", None
        return
    pair = (CONTROLLERS[number % 4], CONTROLLERS[(number + 1) % 4])
    quiet("swap", "--controllers", *pair, *common)
    for controller in pair:
        yield f"swap {controller} motion {number}", out / f"trajectory_{controller}.csv", None


def tasks(asked: Namespace) -> dict[str, tuple[str, int]]:
    some = [("run", k) for k in range(RUNS)] + [("swap", 100 + k) for k in range(SWAPS)]
    return {f"{kind} {k}": (kind, k) for kind, k in some + [("rig", k) for k in range(TRIALS)]}


def trial(kind: str, number: int) -> list[Row]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, path, params in made(kind, number, Path(folder)):
            row = {"record": name, "verdict": "refused", "named": [], "message": ""}
            try:
                found = diagnose([path], params=params)
                row |= {"verdict": found.verdict, "named": [c.name for c in found.causes]}
            except ValueError as reason:
                row["message"] = str(reason).replace(str(path), path.name)
            rows.append(row)
    return rows


def report(found: Sequence[list[Row]]) -> Row:
    rows = [row for some in found for row in some]
    wrong = [r for r in rows if r["named"]]
    return {
        "seed": SEED,
        "records": len(rows),
        "with_a_name": len(wrong),
        "verdicts": dict(Counter(r["verdict"] for r in rows)),
        "refused": dict(Counter(r["message"] for r in rows if r["message"])),
        "wrong": wrong,
        "again": [r for r in rows if r["record"] in AGAIN],
        "holds": not wrong,
    }


def says(report: Row) -> str:
    return f"{report['records']} records: {report['with_a_name']} get the name of a cause"
