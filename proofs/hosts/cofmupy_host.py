"""CoFmuPy: its coordinator and its default master."""

import fmpy
from cofmupy.coordinator import Coordinator
from host import GOAL, answer, steps


def first_outputs(path):
    """What a controller puts out at first: the master begins with zeros if nobody tells it."""
    described = fmpy.read_model_description(path)
    at = {v.name: v.valueReference for v in described.modelVariables if v.causality != "parameter"}
    fmu = fmpy.instantiate_fmu(fmpy.extract(path), described, "CoSimulation")
    fmu.setupExperiment(startTime=0.0)
    fmu.setReal([at["x_d"]], [GOAL])
    fmu.enterInitializationMode()
    names = [v.name for v in described.modelVariables if v.causality == "output"]
    return dict(zip(names, fmu.getReal([at[n] for n in names]), strict=True))


def run(job):
    fmus = [{"id": n, "path": f, "initialization": {}} for n, f in job["fmus"].items()]
    fmus[-1]["initialization"]["x_d"] = GOAL
    first = first_outputs(fmus[-1]["path"])
    fmus[0]["initialization"] |= {
        b: first[y] for (_, y), (_, b) in job["connections"] if y in first
    }

    def end(port):
        return {"id": port[0], "variable": port[1], "type": "fmu"}

    wires = [{"source": end(a), "target": [end(b)]} for a, b in job["connections"]]
    coordinator = Coordinator()
    coordinator.start(
        {"fmus": fmus, "connections": wires, "cosim_method": job["method"], "iterative": False}
    )
    time, x = [], []
    for _ in range(steps(job)):
        coordinator.do_step(job["step"])
        time.append(coordinator.master.current_time)
        x.append(coordinator.get_results()[fmus[0]["id"], "x"][-1])
    return time, x


answer(run)
