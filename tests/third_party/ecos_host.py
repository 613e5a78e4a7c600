"""Run a loop in Ecos, through its Python API."""

from ecospy import EcosSimulation, EcosSimulationStructure
from job import JOB, answer, answer_with_time


def values(simulation):
    return [simulation.get_real(f"plant::{name}") for name in JOB["outputs"]]


with EcosSimulationStructure() as structure:
    for name, path in JOB["fmus"].items():
        structure.add_model(name, path)
    for (source, output), (sink, inlet) in JOB["connections"]:
        structure.make_real_connection(f"{source}::{output}", f"{sink}::{inlet}")
    starts = {f"{name}::{variable}": value for name, variable, value in JOB["starts"]}
    structure.add_parameter_set("start", starts)
    with EcosSimulation(structure=structure, step_size=JOB["step"]) as simulation:
        if not simulation.init(parameter_set="start"):
            raise SystemExit("Ecos cannot initialize; see its log")
        if JOB.get("timed"):
            simulation.step(1)
            answer_with_time(simulation.step)
        else:
            rows = [values(simulation)]
            for _ in range(JOB["steps"]):
                simulation.step(1)
                rows.append(values(simulation))
            answer(rows)
        simulation.terminate()
