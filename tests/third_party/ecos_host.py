"""Run a loop in Ecos, through its Python API."""

import json
import sys
import time
from pathlib import Path

from ecospy import EcosSimulation, EcosSimulationStructure


def main(job, result):
    with EcosSimulationStructure() as structure:
        for name, path in job["fmus"].items():
            structure.add_model(name, path)
        for (source, output), (sink, inlet) in job["connections"]:
            structure.make_real_connection(f"{source}::{output}", f"{sink}::{inlet}")
        starts = {f"{name}::{variable}": value for name, variable, value in job["starts"]}
        structure.add_parameter_set("start", starts)
        with EcosSimulation(structure=structure, step_size=job["step"]) as simulation:
            if not simulation.init(parameter_set="start"):
                raise SystemExit("Ecos cannot initialize; see its log")
            if job.get("timed"):
                simulation.step(1)
                start = time.perf_counter()
                simulation.step(job["steps"])
                result(1e6 * (time.perf_counter() - start) / job["steps"])
            else:
                result(course(simulation, job))
            simulation.terminate()


def course(simulation, job):
    wanted = [f"plant::{name}" for name in job["outputs"]]
    rows = [[simulation.get_real(name) for name in wanted]]
    for _ in range(job["steps"]):
        simulation.step(1)
        rows.append([simulation.get_real(name) for name in wanted])
    return rows


main(
    json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")),
    lambda data: Path(sys.argv[2]).write_text(json.dumps(data), encoding="utf-8"),
)
