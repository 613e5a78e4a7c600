"""Other tools run FMUs and Modelica, each in its own environment: ``hosts.py JOB RESULT``.

A job is a JSON file with the name of the ``tool``, ``fmus`` by name (the first shows ``x``, the
last takes ``x_d``), ``connections``, ``step`` and ``steps``; the result has ``time`` and ``x``. For
the compilers of Modelica, a job has ``models`` and ``columns``, and the result has them by model.
"""

from __future__ import annotations

import json
import logging
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

GOAL = 0.08  # [m]
Job = dict[str, Any]


def first_commands(job: Job) -> dict[str, float]:
    """First commands of the controller by the plant's inputs; else the master begins with zeros."""
    import fmpy

    path = job["fmus"][job["last"]]
    described = fmpy.read_model_description(path)
    at = {v.name: v.valueReference for v in described.modelVariables if v.causality != "parameter"}
    fmu = fmpy.instantiate_fmu(fmpy.extract(path), described, "CoSimulation")
    fmu.setupExperiment(startTime=0.0)
    fmu.setReal([at["x_d"]], [GOAL])
    fmu.enterInitializationMode()
    wires = [(y, u) for (a, y), (_, u) in job["connections"] if a == job["last"]]
    return dict(zip((u for _, u in wires), fmu.getReal([at[y] for y, _ in wires]), strict=True))


def casadi(job: Job):
    """An FMU as a function, and CVODES over it."""
    import casadi as ca

    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(job["path"]) as archive:
            archive.extractall(folder)
        model = ca.DaeBuilder("loop", folder)
        tolerance = job["tolerance"]
        options = {"reltol": tolerance, "abstol": 1e-2 * tolerance, "max_num_steps": 10**7}
        solver = ca.integrator("solver", "cvodes", model.create(), 0.0, job["times"], options)
        course = solver(x0=model.start(model.x()), u=GOAL)["xf"]
        return job["times"], course[model.x().index("x"), :].full()[0]


def cofmupy(job: Job):
    from cofmupy.coordinator import Coordinator

    def end(port):
        return {"id": port[0], "variable": port[1], "type": "fmu"}

    fmus = [{"id": n, "path": f, "initialization": {}} for n, f in job["fmus"].items()]
    fmus[-1]["initialization"]["x_d"] = GOAL
    fmus[0]["initialization"] |= first_commands(job)
    wires = [{"source": end(a), "target": [end(b)]} for a, b in job["connections"]]
    told = {"fmus": fmus, "connections": wires, "cosim_method": job["method"], "iterative": False}
    coordinator = Coordinator()
    coordinator.start(told)
    time, x = [], []
    for _ in range(job["steps"]):
        coordinator.do_step(job["step"])
        time.append(coordinator.master.current_time)
        x.append(coordinator.get_results()[job["first"], "x"][-1])
    return time, x


def estim8(job: Job):
    """Its model class around an FMU, with a tolerance that is passed to the FMU's solver."""
    from estim8.models import FmuModel

    model = FmuModel(job["path"], fmi_type=job["kind"], r_tol=1e-8)
    run = model.simulate(0.0, job["stop"], job["step"], observe=["x"])
    return run["x"].timepoints, run["x"].values


def fmpy(job: Job, output="x"):
    """Its own simulation of one FMU, as co-simulation or by its CVODE."""
    import fmpy

    how = {"fmi_type": job.get("kind", "CoSimulation"), "relative_tolerance": job.get("tolerance")}
    how |= {"stop_time": job["stop"], "step_size": job["step"], "output_interval": job["step"]}
    course = fmpy.simulate_fmu(job["path"], output=[output], **how)
    return course["time"], course[output]


def fmucontainer(job: Job):
    """Its command on an .ssp; fmpy steps the FMU that it makes.

    Local variables are outputs of that FMU, because our .ssp has no connectors.
    """
    with tempfile.TemporaryDirectory() as folder:
        system = Path(shutil.copy(job["path"], folder))
        command = Path(sys.executable).with_name("fmucontainer")
        description = f"{system.name}:{job['step']!r}"
        subprocess.run([command, "-container", description, "-auto-local"], cwd=folder, check=True)
        return fmpy(job | {"path": str(system.with_suffix(".fmu"))}, "plant.x")


def fmuloader(job: Job):
    """The functions of FMI by themselves, for FMI 2 and 3."""
    from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
    from fmuloader.fmi3 import Fmi3Slave

    with zipfile.ZipFile(job["path"]) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    (x,) = (int(v.get("valueReference")) for v in root.iter() if v.get("name") == "x")
    name = root.find("CoSimulation").get("modelIdentifier")
    if root.get("fmiVersion") == "2.0":
        fmu = Fmi2Slave(Path(job["path"]), model_identifier=name)
        fmu.instantiate("loop", Fmi2Type.CO_SIMULATION, guid=root.get("guid"))
        fmu.setup_experiment(0.0)
        read = fmu.get_real
    else:
        fmu = Fmi3Slave(Path(job["path"]), model_identifier=name)
        fmu.instantiate_co_simulation("loop", instantiation_token=root.get("instantiationToken"))
        read = fmu.get_float64
    fmu.enter_initialization_mode()
    fmu.exit_initialization_mode()
    course = [read([x])[0]]
    for t in job["times"][:-1]:
        fmu.do_step(t, job["step"])
        course.append(read([x])[0])
    return job["times"], course


def gemseo(job: Job):
    """An FMU as a discipline, with named inputs: else it sets all parameters during the run."""
    from gemseo_fmu.disciplines.fmu_discipline import FMUDiscipline
    from numpy import array

    names = {"input_names": ["x_d"], "output_names": ["x"]}
    span = {"final_time": job["stop"], "time_step": job["step"]}
    loop = FMUDiscipline(job["path"], **names, **span)
    data = loop.execute({"x_d": array([GOAL])})
    return loop.time, data["x"]


def jaxonomy(job: Job):
    """Its blocks around FMUs; in co-simulation, the output of its block is that before the step."""
    import jaxonomy as jx
    from jaxonomy.library import Constant, ModelicaFMU, ModelicaFMUME

    names = {"name": job["first"], "input_names": ["x_d"], "output_names": ["x"]}
    builder, more = jx.DiagramBuilder(), {}
    if job["kind"] == "ModelExchange":
        fmu = builder.add(ModelicaFMUME(job["path"], **names))
        tolerance = job["tolerance"]
        more = {"rtol": tolerance, "atol": 1e-2 * tolerance, "ode_solver_method": "dopri5"}
    else:
        fmu = builder.add(ModelicaFMU(job["path"], job["step"], first_step_at_zero=True, **names))
    goal = builder.add(Constant(GOAL, name="goal"))
    builder.connect(goal.output_ports[0], fmu.input_ports[0])
    diagram = builder.build()
    limits = {"max_major_step_length": job["step"], "max_major_steps": job["steps"] + 10}
    result = jx.simulate(
        diagram,
        diagram.create_context(),
        (0.0, job["stop"]),
        options=jx.SimulatorOptions(**limits, **more),
        recorded_signals={"x": fmu.output_ports[0]},
    )
    return result.time, result.outputs["x"]


def pathsim(job: Job):
    """Blocks around FMUs; a block steps at the start of an interval, so labels are a step early."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Constant, Scope
    from pathsim_fmi import CoSimulationFMU

    goal, scope, last = Constant(GOAL), Scope(), job["last"]
    blocks = {
        n: CoSimulationFMU(f, n, {"x_d": GOAL} if n == last else None, job["step"])
        for n, f in job["fmus"].items()
    }
    wires = [Connection(blocks[a][y], blocks[b][u]) for (a, y), (b, u) in job["connections"]]
    wires += [Connection(goal, blocks[last]["x_d"]), Connection(blocks[job["first"]]["x"], scope)]
    Simulation([goal, scope, *blocks.values()], wires, dt=job["step"], log=False).run(job["stop"])
    time, (x,) = scope.read()
    return [t + job["step"] for t in time[:-1]], x[:-1]


def sofirpy(job: Job):
    """FMUs that step and then exchange; the plant gets the first commands as start values."""
    from sofirpy import simulate

    shown = job["first"]
    starts: dict[str, dict[str, float]] = {job["last"]: {"x_d": GOAL}}
    if job["connections"]:
        starts[shown] = first_commands(job)
    wires: dict[str, list[dict[str, str]]] = {name: [] for name in job["fmus"]}
    for (a, y), (b, u) in job["connections"]:
        end = {"connect_to_system": a, "connect_to_external_parameter": y}
        wires[b].append({"parameter_name": u, **end})
    how = {"fmu_paths": {n: Path(f) for n, f in job["fmus"].items()}, "start_values": starts}
    how |= {"connections_config": wires if job["connections"] else None}
    how |= {"stop_time": job["stop"], "step_size": job["step"]}
    table = simulate(parameters_to_log={shown: ["x"]}, **how)
    return table["time"], table[f"{shown}.x"]


def syssimx(job: Job):
    """FMU components in a system, with its Jacobi or Gauss-Seidel algorithm."""
    from syssimx import Connection, System
    from syssimx.components import FMUComponent
    from syssimx.system.algorithms.gauss_seidel import GaussSeidelAlgorithm
    from syssimx.system.algorithms.jacobi import JacobiAlgorithm

    class Part(FMUComponent):
        def _do_step_internal(self, t, dt):
            if dt > 0.0:  # a system begins with steps of zero length, which FMI does not have
                super()._do_step_internal(t, dt)

    system = System("axis")
    parts = {n: Part(n, f) for n, f in job["fmus"].items()}
    for part in parts.values():
        system.add_component(part)
    for (a, y), (b, u) in job["connections"]:
        system.add_connection(Connection(a, y, b, u))
    methods = {"jacobi": JacobiAlgorithm, "gauss_seidel": GaussSeidelAlgorithm}
    system.set_algorithm(methods[job["method"]]())
    system.initialize(0.0)
    parts[job["last"]].set_inputs({"x_d": GOAL})
    result = system.run(0.0, job["stop"], job["step"])
    time, courses = result.histories[job["first"]]
    return time, courses["x"]


def pymoca(job: Job, name: str, text: str):
    """Modelica as CasADi's expressions, solved by CVODES.

    Each equation of the files has one name on its left side. The equations are substituted into
    each other until derivatives and outputs depend only on time and states.
    """
    import casadi as ca
    from pymoca.backends.casadi.api import transfer_model

    logging.disable(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as folder:
        # it has the inverse tangent with CasADi's name
        (Path(folder) / f"{name}.mo").write_text(text.replace("atan(", "arctan("))
        model = transfer_model(folder, name, {"cache": False})
    known = [*model.parameters, *model.constants]
    symbols, values = (ca.vertcat(*(getattr(v, k) for v in known)) for k in ("symbol", "value"))
    numbers = {v.symbol.name(): v.value for v in known}
    states = {s.symbol.name(): s.symbol for s in model.states}
    rates = {f"der({s})": d.symbol for s, d in zip(states, model.der_states, strict=True)}
    others = {s.symbol.name(): s.symbol for s in model.alg_states}
    left = re.findall(r"^  (der\(\w+\)|\w+) = ", text.partition("\nequation\n")[2], re.M)
    named, right, found = {**others, **rates}, {}, {}
    for n, equation in zip(left, model.equations, strict=True):
        right[n] = ca.substitute(-ca.substitute(equation, named[n], 0), symbols, values)
    while right:
        unknown = {named[k].name() for k in right}
        ready = [n for n, v in right.items() if not {s.name() for s in ca.symvar(v)} & unknown]
        found |= {n: right.pop(n) for n in ready}
        if right:
            of, to = (ca.vertcat(*(some[n] for n in ready)) for some in (named, found))
            right = {n: ca.substitute(v, of, to) for n, v in right.items()}
    x, time = ca.vertcat(*states.values()), job["times"]
    shown = ca.Function("shown", [model.time, x], [ca.vertcat(*(found[n] for n in others))])
    rows = []
    if states:
        dae = {"x": x, "t": model.time, "ode": ca.vertcat(*(found[n] for n in rates))}
        options = {"reltol": job["tolerance"], "abstol": 1e-3 * job["tolerance"]}
        solver = ca.integrator("solver", "cvodes", dae, 0.0, time, options)
        rows = solver(x0=[float(numbers[f"{s}_start"]) for s in states])["xf"].full().tolist()
    at = ca.DM(rows) if rows else ca.DM.zeros(0, len(time))
    rows += shown(ca.DM(time).T, at).full().tolist()
    return time, dict(zip([*states, *others], rows, strict=True))


def rumoca(job: Job, name: str, text: str):
    from rumoca import Session, SimConfig

    tolerance = job["tolerance"]
    config = SimConfig(solver="bdf", rtol=tolerance, atol=1e-3 * tolerance, dt=job["step"])
    result = Session().loads(text, model=name).simulate(job["stop"], config=config)
    return list(result.time), dict(zip(result.names, result.to_numpy().tolist(), strict=True))


def answer(tool: Callable[..., Any], job: Job) -> Job:
    job["times"] = [k * job["step"] for k in range(job["steps"] + 1)]
    job["stop"] = job["steps"] * job["step"]
    if "models" not in job:
        names = list(job["fmus"])
        job |= {"first": names[0], "last": names[-1], "path": job["fmus"][names[0]]}
        time, x = ([float(value) for value in column] for column in tool(job))
        return {"time": time, "x": x}
    found: Job = {}
    for name, text in job["models"].items():
        try:
            time, columns = tool(job, name, text)
            found[name] = {"time": time, "columns": {n: columns[n] for n in job["columns"][name]}}
        except Exception as error:
            found[name] = {"why": f"{type(error).__name__}: {error}"[:300]}
    return found


if __name__ == "__main__":
    given, got = sys.argv[1:]
    asked = json.loads(Path(given).read_text(encoding="utf-8"))
    Path(got).write_text(json.dumps(answer(globals()[asked["tool"]], asked)), encoding="utf-8")
