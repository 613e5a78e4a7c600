"""Interrupt and kill each long command at 20 random instants; docs/proof/interrupts.json.

Instants are random in processor time of all processes of a command, from its first line of code to
`LATEST` seconds, with SIGINT and SIGTERM alternately. The folder of each command contains the
results of an earlier run and a file of the user.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from long_commands import (  # noqa: E402
    BALLSCREW,
    COMMANDS,
    Command,
    interrupted,
    seen_in,
    write_data,
)
from provenance import provenance  # noqa: E402

from ballscrew.orchestration.loop.run_folder import settle  # noqa: E402

SEED = 16
LATEST = 8.0  # s of processor time
OF_ALL = 0.7  # of a command's processor time, the latest for those that end sooner


def latest_of(name: str, data: Path, out: Path) -> float:
    """Processor time of a command up to which it is interrupted [s]: the first run may compile."""
    return min(_latest(name, data, out) for _ in range(2))


def _latest(name: str, data: Path, out: Path) -> float:
    command = Command(name, data, out)
    used = 0.0
    while command.process.poll() is None and OF_ALL * used < LATEST:
        used = max(used, sum(command.processes().values()))
        time.sleep(0.02)
    command.process.send_signal(signal.SIGINT)
    command.process.communicate()
    _forget_chunks(out)
    return min(LATEST, OF_ALL * used)


def trial(name: str, k: int, latest: float, data: Path, out: Path) -> dict[str, Any]:
    """Interrupt one command once, and kill it once; what was wrong, empty texts if nothing."""
    random = np.random.default_rng([SEED, list(COMMANDS).index(name), k])
    before = seen_in(out)
    instant = float(random.uniform(0.0, latest))
    command = Command(name, data, out)
    command.wait_until_busy(instant)
    ending = interrupted(command, (signal.SIGINT, signal.SIGTERM)[k % 2])
    fault = ending.fault()
    if not fault and seen_in(out) != before:
        fault = "the earlier results changed"
    _forget_chunks(out)
    command = Command(name, data, out)
    command.wait_until_busy(instant)
    command.process.send_signal(signal.SIGKILL)
    command.process.communicate()
    left = len(command.left_after(5.0))
    settle(out)
    killed = f"{left} processes left" if left else ""
    if not killed and seen_in(out) != before:
        killed = "the earlier results changed"
    _forget_chunks(out)
    return {"instant": instant, "seconds": ending.seconds, "interrupted": fault, "killed": killed}


def _forget_chunks(out: Path) -> None:
    for part in out.glob("map.parts/*"):  # kept for --resume
        part.unlink()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--times", type=int, default=20)
    times = parser.parse_args().times
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="ballscrew-proof-") as place:
        data, out = Path(place) / "data", Path(place) / "out"
        write_data(data)
        earlier = ["run", "--controller", "iol", "--stop", "0.5", "--out", str(out)]
        subprocess.run([str(BALLSCREW), *earlier], capture_output=True, check=False)
        (out / "notes.txt").write_text("the user's")
        for name in COMMANDS:
            latest = latest_of(name, data, out)
            trials = [trial(name, k, latest, data, out) for k in range(times)]
            figures[name] = {
                "command": COMMANDS[name],
                "latest_processor_time_s": round(latest, 2),
                "interrupts": times,
                "faults": [t["interrupted"] for t in trials if t["interrupted"]],
                "longest_s": round(max(t["seconds"] for t in trials), 3),
                "kills": times,
                "faults_of_kills": [t["killed"] for t in trials if t["killed"]],
            }
            print(name, json.dumps(figures[name]), flush=True)
    about = {**provenance("interrupts"), "seed": SEED}
    target = ROOT / "docs" / "proof" / "interrupts.json"
    target.write_text(json.dumps(about | {"commands": figures}, indent=1) + "\n", encoding="utf-8")
    if any(f["faults"] or f["faults_of_kills"] for f in figures.values()):
        sys.exit("some interrupt or kill was not met as promised")


if __name__ == "__main__":
    main()
