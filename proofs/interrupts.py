"""Interrupted and killed commands end in time, and what they wrote before stays complete.

Each long command is interrupted and killed at 20 random instants, in processor time of all its
processes, from its first line of code to `LATEST` seconds, with SIGINT and SIGTERM alternately. Its
folder has the results of an earlier run and a file of the user.
"""

from __future__ import annotations

import signal
import subprocess
import tempfile
import time
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from long_commands import BALLSCREW, COMMANDS, Command, interrupted, seen_in, write_data
from runner import Row

from ballscrew.orchestration.loop.run_folder import settle

SEED, TIMES = 16, 20
LATEST = 8.0  # s of processor time
OF_ALL = 0.7  # of a command's processor time, the latest for those that end sooner


def latest_of(name: str, data: Path, out: Path) -> float:
    """Processor time of a command up to which it is interrupted [s]."""
    command, used = Command(name, data, out), 0.0
    while command.process.poll() is None and OF_ALL * used < LATEST:
        used = max(used, sum(command.processes().values()))
        time.sleep(0.02)
    command.process.send_signal(signal.SIGINT)
    command.process.communicate()
    forget_chunks(out)
    return min(LATEST, OF_ALL * used)


def forget_chunks(out: Path) -> None:
    for part in out.glob("map.parts/*"):  # kept for --resume
        part.unlink()


def stopped(name: str, k: int, latest: float, data: Path, out: Path) -> Row:
    """Interrupt one command once, and kill it once; what was wrong, empty texts if nothing."""
    random = np.random.default_rng([SEED, list(COMMANDS).index(name), k])
    before, instant = seen_in(out), float(random.uniform(0.0, latest))
    command = Command(name, data, out)
    command.wait_until_busy(instant)
    ending = interrupted(command, (signal.SIGINT, signal.SIGTERM)[k % 2])
    fault = ending.fault() or "the earlier results changed" * (seen_in(out) != before)
    forget_chunks(out)
    command = Command(name, data, out)
    command.wait_until_busy(instant)
    command.process.send_signal(signal.SIGKILL)
    command.process.communicate()
    left = len(command.left_after(5.0))
    settle(out)
    changed = "the earlier results changed" * (seen_in(out) != before)
    forget_chunks(out)
    killed = f"{left} processes left" if left else changed
    return {"seconds": ending.seconds, "interrupted": fault, "killed": killed}


def tasks(asked: Namespace) -> dict[str, tuple[str, int]]:
    return {name: (name, asked.draws or TIMES) for name in COMMANDS}


def trial(name: str, times: int) -> Row:
    with tempfile.TemporaryDirectory(prefix="ballscrew-proof-") as place:
        data, out = Path(place) / "data", Path(place) / "out"
        write_data(data)
        earlier = "run --controller iol --stop 0.5 --out".split()
        subprocess.run([BALLSCREW, *earlier, out], capture_output=True)
        (out / "notes.txt").write_text("the user's")
        latest = min(latest_of(name, data, out) for _ in range(2))  # the first may compile
        trials = [stopped(name, k, latest, data, out) for k in range(times)]
    return {
        "command": COMMANDS[name],
        "latest_processor_time_s": round(latest, 2),
        "times": times,
        "longest_s": round(max(t["seconds"] for t in trials), 3),
        "faults": [t["interrupted"] for t in trials if t["interrupted"]],
        "faults_of_kills": [t["killed"] for t in trials if t["killed"]],
    }


def report(rows: Sequence[Row]) -> Row:
    faults = sum(len(r["faults"]) + len(r["faults_of_kills"]) for r in rows)
    return {"seed": SEED, "commands": rows, "holds": not faults}


def says(report: Row) -> str:
    rows = report["commands"]
    faults = sum(len(r["faults"]) + len(r["faults_of_kills"]) for r in rows)
    longest, times = max(r["longest_s"] for r in rows), sum(2 * r["times"] for r in rows)
    return f"{times} interrupts and kills, {faults} faults; the longest end took {longest:.2g} s"
