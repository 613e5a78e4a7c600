"""What the hosts share: a job in, the times and positions of the block out."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

GOAL = 0.08  # [m]


def answer(run: Callable[[dict[str, Any]], tuple[Iterable[float], Iterable[float]]]) -> None:
    """Run the job of the first argument, write what it gives to the second."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    time, x = ([float(value) for value in column] for column in run(job))
    Path(sys.argv[2]).write_text(json.dumps({"time": time, "x": x}), encoding="utf-8")


def answer_models(run: Callable[..., tuple[list[float], dict[str, list[float]]]]) -> None:
    """Run the models of the first argument one by one, write what each gives, or why not."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    told = {}
    for name, text in job["models"].items():
        try:
            time, columns = run(job, name, text)
            told[name] = {"time": time, "columns": {n: columns[n] for n in job["columns"][name]}}
        except Exception as error:
            told[name] = {"why": f"{type(error).__name__}: {error}"[:300]}
    Path(sys.argv[2]).write_text(json.dumps(told), encoding="utf-8")


def steps(job: dict[str, Any]) -> int:
    """How many communication steps the run has."""
    return round(job["stop"] / job["step"])
