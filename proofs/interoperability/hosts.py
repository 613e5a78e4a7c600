"""Other tools run FMUs and Modelica, each in its own environment: ``hosts.py TOOL JOB RESULT``.

A job is a JSON file with ``fmus`` by name (the first shows ``x``, the last takes ``x_d``),
``connections``, ``step`` and ``stop``; the result is one with ``time`` and ``x``. For the compilers
of Modelica, a job has ``models`` and ``columns``, and the result has them by model.
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


def _steps(job: Job) -> int:
    return round(job["stop"] / job["step"])


def _ends(job: Job) -> tuple[str, str]:
    """Names of the FMU that shows x and of the one that takes the set-point."""
    names = list(job["fmus"])
    return names[0], names[-1]


def _path(job: Job) -> str:
    return str(next(iter(job["fmus"].values())))


def _first_outputs(path: str) -> dict[str, float]:
    """First outputs of a controller; without them, the master begins with zeros."""
    import fmpy

    described = fmpy.read_model_description(path)
    at = {v.name: v.valueReference for v in described.modelVariables if v.causality != "parameter"}
    fmu = fmpy.instantiate_fmu(fmpy.extract(path), described, "CoSimulation")
    fmu.setupExperiment(startTime=0.0)
    fmu.setReal([at["x_d"]], [GOAL])
    fmu.enterInitializationMode()
    names = [v.name for v in described.modelVariables if v.causality == "output"]
    return dict(zip(names, fmu.getReal([at[n] for n in names]), strict=True))


def _first_commands(job: Job) -> dict[str, float]:
    """First commands of the controller by the plant's inputs."""
    first = _first_outputs(job["fmus"][_ends(job)[1]])
    return {u: first[y] for (_, y), (_, u) in job["connections"] if y in first}


def casadi(job: Job):
    """An FMU as a function, and CVODES over it."""
    import casadi as ca

    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(_path(job)) as archive:
            archive.extractall(folder)
        model = ca.DaeBuilder("loop", folder)
        time = [k * job["step"] for k in range(_steps(job) + 1)]
        tolerance = job["tolerance"]
        options = {"reltol": tolerance, "abstol": 1e-2 * tolerance, "max_num_steps": 10**7}
        solver = ca.integrator("solver", "cvodes", model.create(), 0.0, time, options)
        course = solver(x0=model.start(model.x()), u=GOAL)["xf"]
        return time, course[model.x().index("x"), :].full()[0]


def cofmupy(job: Job):
    """Its coordinator and its default master."""
    from cofmupy.coordinator import Coordinator

    def end(port):
        return {"id": port[0], "variable": port[1], "type": "fmu"}

    fmus = [{"id": n, "path": f, "initialization": {}} for n, f in job["fmus"].items()]
    fmus[-1]["initialization"]["x_d"] = GOAL
    fmus[0]["initialization"] |= _first_commands(job)
    wires = [{"source": end(a), "target": [end(b)]} for a, b in job["connections"]]
    told = {"fmus": fmus, "connections": wires, "cosim_method": job["method"], "iterative": False}
    coordinator = Coordinator()
    coordinator.start(told)
    time, x = [], []
    for _ in range(_steps(job)):
        coordinator.do_step(job["step"])
        time.append(coordinator.master.current_time)
        x.append(coordinator.get_results()[fmus[0]["id"], "x"][-1])
    return time, x


def ecos(job: Job):
    """Through ecospy: its fixed-step algorithm."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    first, last = _ends(job)
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
            for k in range(_steps(job)):
                simulation.step(1)
                time.append((k + 1) * job["step"])
                x.append(simulation.get_real(f"{first}::x"))
            simulation.terminate()
    return time, x


def estim8(job: Job):
    """Its model class around an FMU, with a tolerance that is passed to the FMU's solver."""
    from estim8.models import FmuModel

    model = FmuModel(_path(job), fmi_type=job["kind"], r_tol=1e-8)
    run = model.simulate(0.0, job["stop"], job["step"], observe=["x"])
    return run["x"].timepoints, run["x"].values


def fmpy(job: Job):
    """Its own simulation of one FMU, as co-simulation or by its CVODE."""
    import fmpy

    course = fmpy.simulate_fmu(
        _path(job),
        fmi_type=job["kind"],
        stop_time=job["stop"],
        step_size=job["step"],
        output_interval=job["step"],
        relative_tolerance=job.get("tolerance"),
        output=["x"],
    )
    return course["time"], course["x"]


def fmucontainer(job: Job):
    """Its command on an .ssp; fmpy steps the FMU that it makes.

    Local variables are outputs of that FMU, because our .ssp has no connectors.
    """
    import fmpy

    with tempfile.TemporaryDirectory() as folder:
        system = Path(shutil.copy(_path(job), folder))
        command = Path(sys.executable).with_name("fmucontainer")
        description = f"{system.name}:{job['step']!r}"
        subprocess.run([command, "-container", description, "-auto-local"], cwd=folder, check=True)
        course = fmpy.simulate_fmu(
            str(system.with_suffix(".fmu")),
            stop_time=job["stop"],
            step_size=job["step"],
            output_interval=job["step"],
            output=["plant.x"],
        )
        return course["time"], course["plant.x"]


def fmuloader(job: Job):
    """The functions of FMI by themselves, for FMI 2 and 3."""
    from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
    from fmuloader.fmi3 import Fmi3Slave

    with zipfile.ZipFile(_path(job)) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    (x,) = (int(v.get("valueReference")) for v in root.iter() if v.get("name") == "x")
    name = root.find("CoSimulation").get("modelIdentifier")
    if root.get("fmiVersion") == "2.0":
        fmu = Fmi2Slave(Path(_path(job)), model_identifier=name)
        fmu.instantiate("loop", Fmi2Type.CO_SIMULATION, guid=root.get("guid"))
        fmu.setup_experiment(0.0)
        read = fmu.get_real
    else:
        fmu = Fmi3Slave(Path(_path(job)), model_identifier=name)
        fmu.instantiate_co_simulation("loop", instantiation_token=root.get("instantiationToken"))
        read = fmu.get_float64
    fmu.enter_initialization_mode()
    fmu.exit_initialization_mode()
    time, course = [0.0], [read([x])[0]]
    for k in range(_steps(job)):
        fmu.do_step(k * job["step"], job["step"])
        time.append((k + 1) * job["step"])
        course.append(read([x])[0])
    return time, course


def gemseo(job: Job):
    """An FMU as a discipline, with named inputs: else it sets all parameters during the run."""
    from gemseo_fmu.disciplines.fmu_discipline import FMUDiscipline
    from numpy import array

    loop = FMUDiscipline(
        _path(job),
        input_names=["x_d"],
        output_names=["x"],
        final_time=job["stop"],
        time_step=job["step"],
    )
    data = loop.execute({"x_d": array([GOAL])})
    return loop.time, data["x"]


def jaxonomy(job: Job):
    """Its blocks around FMUs; in co-simulation, the output of its block is that before the step."""
    import jaxonomy as jx
    from jaxonomy.library import Constant, ModelicaFMU, ModelicaFMUME

    names = {"name": _ends(job)[0], "input_names": ["x_d"], "output_names": ["x"]}
    builder, more = jx.DiagramBuilder(), {}
    if job["kind"] == "ModelExchange":
        fmu = builder.add(ModelicaFMUME(_path(job), **names))
        tolerance = job["tolerance"]
        more = {"rtol": tolerance, "atol": 1e-2 * tolerance, "ode_solver_method": "dopri5"}
    else:
        fmu = builder.add(ModelicaFMU(_path(job), job["step"], first_step_at_zero=True, **names))
    goal = builder.add(Constant(GOAL, name="goal"))
    builder.connect(goal.output_ports[0], fmu.input_ports[0])
    diagram = builder.build()
    limits = {"max_major_step_length": job["step"], "max_major_steps": _steps(job) + 10}
    result = jx.simulate(
        diagram,
        diagram.create_context(),
        (0.0, job["stop"]),
        options=jx.SimulatorOptions(**limits, **more),
        recorded_signals={"x": fmu.output_ports[0]},
    )
    return result.time, result.outputs["x"]


def libcosim(job: Job):
    """Through libcosimpy: its fixed-step algorithm."""
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(round(job["step"] * 1e9))
    slaves = [CosimLocalSlave(path, name) for name, path in job["fmus"].items()]
    index = [execution.add_local_slave(slave) for slave in slaves]
    at = {
        (n, v.name.decode()): (i, v.reference)
        for n, i in zip(job["fmus"], index, strict=True)
        for v in execution.slave_variables(i)
        if v.type == CosimVariableType.REAL.value
    }
    first, last = _ends(job)
    wired = [execution.real_initial_value(*at[last, "x_d"], GOAL)]
    wired += [
        execution.connect_real_variables(*at[tuple(a)], *at[tuple(b)]) == 0
        for a, b in job["connections"]
    ]
    observer = CosimObserver.create_last_value()
    if not (all(wired) and execution.add_observer(observer)):
        raise SystemExit("libcosim refuses")
    slave, reference = at[first, "x"]
    time, x = [0.0], list(observer.last_real_values(slave, [reference]))
    for k in range(_steps(job)):
        if not execution.step(1):
            raise SystemExit(f"libcosim takes no step at {time[-1]} s")
        time.append((k + 1) * job["step"])
        x += observer.last_real_values(slave, [reference])
    return time, x


def pathsim(job: Job):
    """Blocks around FMUs; a block steps at the start of an interval, so labels are a step early."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Constant, Scope
    from pathsim_fmi import CoSimulationFMU

    goal, scope, (first, last) = Constant(GOAL), Scope(), _ends(job)
    blocks = {
        n: CoSimulationFMU(f, n, {"x_d": GOAL} if n == last else None, job["step"])
        for n, f in job["fmus"].items()
    }
    wires = [Connection(blocks[a][y], blocks[b][u]) for (a, y), (b, u) in job["connections"]]
    wires += [Connection(goal, blocks[last]["x_d"]), Connection(blocks[first]["x"], scope)]
    Simulation([goal, scope, *blocks.values()], wires, dt=job["step"], log=False).run(job["stop"])
    time, (x,) = scope.read()
    return [t + job["step"] for t in time[:-1]], x[:-1]


def sofirpy(job: Job):
    """FMUs that step and then exchange; the plant gets the first commands as start values."""
    from sofirpy import simulate

    shown, last = _ends(job)
    starts: dict[str, dict[str, float]] = {last: {"x_d": GOAL}}
    if job["connections"]:
        starts[shown] = _first_commands(job)
    wires: dict[str, list[dict[str, str]]] = {name: [] for name in job["fmus"]}
    for (a, y), (b, u) in job["connections"]:
        end = {"connect_to_system": a, "connect_to_external_parameter": y}
        wires[b].append({"parameter_name": u, **end})
    table = simulate(
        stop_time=job["stop"],
        step_size=job["step"],
        fmu_paths={n: Path(f) for n, f in job["fmus"].items()},
        connections_config=wires if job["connections"] else None,
        start_values=starts,
        parameters_to_log={shown: ["x"]},
    )
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
    first, last = _ends(job)
    parts[last].set_inputs({"x_d": GOAL})
    result = system.run(0.0, job["stop"], job["step"])
    time, courses = result.histories[first]
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
    values = ca.vertcat(*(v.value for v in known))
    symbols = ca.vertcat(*(v.symbol for v in known))
    numbers = {v.symbol.name(): v.value for v in known}
    states = {s.symbol.name(): s.symbol for s in model.states}
    rates = {f"der({s})": d.symbol for s, d in zip(states, model.der_states, strict=True)}
    others = {s.symbol.name(): s.symbol for s in model.alg_states}
    left = re.findall(r"^  (der\(\w+\)|\w+) = ", text.partition("\nequation\n")[2], re.M)
    named = {**others, **rates}
    right = {}
    for n, equation in zip(left, model.equations, strict=True):
        right[n] = ca.substitute(-ca.substitute(equation, named[n], 0), symbols, values)
    found: dict[str, Any] = {}
    while right:
        unknown = {named[k].name() for k in right}
        ready = [n for n, v in right.items() if not {s.name() for s in ca.symvar(v)} & unknown]
        for n in ready:
            found[n] = right.pop(n)
        if right:
            of = ca.vertcat(*(named[n] for n in ready))
            to = ca.vertcat(*(found[n] for n in ready))
            right = {n: ca.substitute(v, of, to) for n, v in right.items()}
    x = ca.vertcat(*states.values())
    time = [k * job["step"] for k in range(_steps(job) + 1)]
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
    """Modelica compiled and solved by its own BDF."""
    from rumoca import Session, SimConfig

    tolerance = job["tolerance"]
    config = SimConfig(solver="bdf", rtol=tolerance, atol=1e-3 * tolerance, dt=job["step"])
    result = Session().loads(text, model=name).simulate(job["stop"], config=config)
    return list(result.time), dict(zip(result.names, result.to_numpy().tolist(), strict=True))


def answer(tool: Callable[..., Any], job: Job) -> Job:
    """The result of a job, or of each of its models."""
    if "models" not in job:
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
    name, given, got = sys.argv[1:]
    asked = json.loads(Path(given).read_text(encoding="utf-8"))
    Path(got).write_text(json.dumps(answer(globals()[name], asked)), encoding="utf-8")
