"""Common part of the hosts: read a job, write times and positions of the block."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

GOAL = 0.08  # [m]


def answer(run: Callable[[dict[str, Any]], tuple[Iterable[float], Iterable[float]]]) -> None:
    """Run the job in the file of the first argument, write the result to that of the second."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    time, x = ([float(value) for value in column] for column in run(job))
    Path(sys.argv[2]).write_text(json.dumps({"time": time, "x": x}), encoding="utf-8")


def answer_models(run: Callable[..., tuple[list[float], dict[str, list[float]]]]) -> None:
    """Run the models of the first argument one by one, write each result or error."""
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
    """Number of communication steps of the run."""
    return round(job["stop"] / job["step"])


def first_outputs(path: str) -> dict[str, float]:
    """First outputs of a controller; without them, the master begins with zeros."""
    import fmpy  # not every environment has it

    described = fmpy.read_model_description(path)
    at = {v.name: v.valueReference for v in described.modelVariables if v.causality != "parameter"}
    fmu = fmpy.instantiate_fmu(fmpy.extract(path), described, "CoSimulation")
    fmu.setupExperiment(startTime=0.0)
    fmu.setReal([at["x_d"]], [GOAL])
    fmu.enterInitializationMode()
    names = [v.name for v in described.modelVariables if v.causality == "output"]
    return dict(zip(names, fmu.getReal([at[n] for n in names]), strict=True))
