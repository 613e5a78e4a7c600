"""Proof: on records of this program, with their true parameters, no cause is named.

A hundred records of `run`, `swap` and `rig` are made and diagnosed with the user's commands. Writes
``docs/proof/own_records.json``. A record that is rejected with a reason is not a wrong name.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; workers run in parallel

import argparse
import contextlib
import io
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from provenance import provenance

from ballscrew.cli import main as ballscrew
from ballscrew.measurement.diagnosis.diagnose import diagnose
from ballscrew.measurement.rig.trials import trials_named
from ballscrew.options import add_worker_options, open_workers
from ballscrew.solver.files import write_atomically

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "own_records.json"
SEED = 1700
RUNS, SWAPS, TRIALS = 40, 10, 40  # a swap writes two records
CONTROLLERS = ("pid", "pid_sampled", "iol", "nctf")
TABLES = ("2.3.1", "2.4", "2.6", "viscous", "loading-rate")  # tables in which the block slides
LASTS = 12.0  # duration [s]


@dataclass(frozen=True)
class Row:
    """One record and its diagnosis."""

    record: str
    verdict: str
    named: list[str]
    seconds: float
    message: str


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
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = ballscrew([str(a) for a in arguments])
    if code not in (0, 1):
        raise RuntimeError(f"{arguments[0]} ended with {code}: {said.getvalue()[-300:]}")


def made(kind: str, number: int, folder: Path) -> Iterator[tuple[str, Path, Path | None]]:
    """Names and files of records, and the parameter file of each."""
    if kind == "rig":
        trials = [t.name for table in TABLES for t in trials_named(table)]
        name = trials[number * 7 % len(trials)]
        quiet("rig", name, "--seed", str(number), "--out", folder)
        yield f"rig {name} seed {number}", folder / "record.csv", folder / "parameters.toml"
        return
    motion = folder / "motion.csv"
    reference(number, motion)
    out, stop = folder / "out", str(LASTS)
    common = ("--reference", motion, "--stop", stop, "--out", out)
    if kind == "run":
        controller = CONTROLLERS[number // 3 % len(CONTROLLERS)]
        quiet("run", "--controller", controller, *common)
        yield f"run {controller} motion {number}", out / "trajectory.csv", None
        return
    pair = (CONTROLLERS[number % 4], CONTROLLERS[(number + 1) % 4])
    quiet("swap", "--controllers", *pair, *common)
    for controller in pair:
        yield f"swap {controller} motion {number}", out / f"trajectory_{controller}.csv", None


def trial(task: tuple[str, int]) -> list[Row]:
    """Make the records of one command and diagnose each."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, path, params in made(*task, Path(folder)):
            began = time.process_time()
            try:
                found = diagnose([path], params=params)
                named = [c.name for c in found.causes]
                row = Row(name, found.verdict, named, time.process_time() - began, "")
            except ValueError as reason:
                said = str(reason).replace(str(path), path.name)
                row = Row(name, "refused", [], time.process_time() - began, said)
            rows.append(row)
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    add_worker_options(parser)
    parser.add_argument("--every", type=int, default=1, help="of so many commands one only")
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    tasks = [("run", k) for k in range(RUNS)] + [("swap", 100 + k) for k in range(SWAPS)]
    tasks += [("rig", k) for k in range(TRIALS)]
    rows: list[Row] = []
    jobs = iter([(f"{kind} {k}", ((kind, k),)) for kind, k in tasks[:: options.every]])
    workers = open_workers(options)
    for _, some in workers.map(trial, jobs):
        rows += some
        for row in some:
            print(f"{row.record}: {row.verdict} {row.named} {row.message}", file=sys.stderr)
    rows.sort(key=lambda row: row.record)  # they arrive in the order in which they finish
    named = [r for r in rows if r.named]
    report = {
        **provenance("own_records"),
        "seed": SEED,
        "records": len(rows),
        "with_a_name": len(named),
        "verdicts": dict(Counter(r.verdict for r in rows)),
        "rows": [asdict(r) for r in rows],
    }
    write_atomically(options.out, (json.dumps(report, indent=1) + "\n").encode())
    print(json.dumps({"records": len(rows), "with_a_name": len(named)}))
    return 0 if not named else 1


if __name__ == "__main__":
    raise SystemExit(main())
