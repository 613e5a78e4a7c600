"""Processor time of complete commands: the first run after installation, and the second.

    python benchmarks/start.py

Each command runs in a separate process with an empty cache folder, then again with the filled
cache. Prints processor seconds of the command and of all processes that it starts, the minimum of
three runs.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

RUNS = 3
COMMANDS = {
    "run --controller iol --stop 5": ("run", "--controller", "iol", "--stop", "5"),
    "lyapunov --controller nctf --stop 20": ("lyapunov", "--controller", "nctf", "--stop", "20"),
    "map, 25 cells": (
        "map --controller iol --x sigma0_hat=66966:66967:5 --y sigma1_hat=340:367:5 --stop 5"
    ).split(),
}


def processor_seconds(arguments: tuple[str, ...], home: Path, out: Path) -> float:
    """Processor time of one command, including its child processes."""
    before = os.times()
    environment = os.environ | {"HOME": str(home), "BALLSCREW_CACHE": str(home / "cache")}
    environment.pop("XDG_CACHE_HOME", None)
    subprocess.run(
        [sys.executable, "-m", "ballscrew", *arguments, "--out", str(out)],
        env=environment,
        cwd=home,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=False,  # some end with 1: computed, but not trusted
    )
    after = os.times()
    return (after.children_user - before.children_user) + (
        after.children_system - before.children_system
    )


def main() -> None:
    print(f"{'processor seconds':40} {'first':>7} {'again':>7}")
    for name, arguments in COMMANDS.items():
        first, again = [], []
        for _ in range(RUNS):
            with tempfile.TemporaryDirectory() as folder:
                home = Path(folder)
                first.append(processor_seconds(arguments, home, home / "first"))
                again.append(processor_seconds(arguments, home, home / "again"))
        print(f"{name:40} {min(first):7.2f} {min(again):7.2f}", flush=True)


if __name__ == "__main__":
    main()
