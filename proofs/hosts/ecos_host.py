"""Ecos through ecospy: its fixed-step algorithm."""

from ecospy import EcosSimulation, EcosSimulationStructure
from host import GOAL, answer, steps


def run(job):
    first, last = (list(job["fmus"])[k] for k in (0, -1))
    with EcosSimulationStructure() as structure:
        for name, path in job["fmus"].items():
            structure.add_model(name, path)
        for (a, y), (b, u) in job["connections"]:
            structure.make_real_connection(f"{a}::{y}", f"{b}::{u}")
        structure.add_parameter_set("start", {f"{last}::x_d": GOAL})
        with EcosSimulation(structure=structure, step_size=job["step"]) as simulation:
            if not simulation.init(parameter_set="start"):
                raise SystemExit("Ecos does not initialize")
            time, x = [0.0], [simulation.get_real(f"{first}::x")]
            for k in range(steps(job)):
                simulation.step(1)
                time.append((k + 1) * job["step"])
                x.append(simulation.get_real(f"{first}::x"))
            simulation.terminate()
    return time, x


answer(run)
