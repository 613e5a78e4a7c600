"""jaxonomy: its blocks around FMUs, co-simulation and model exchange."""

import jaxonomy
from host import GOAL, answer, steps
from jaxonomy.library import Constant, ModelicaFMU, ModelicaFMUME


def run(job):
    """Run; in co-simulation, the output of its block is that before the step."""
    name, path = next(iter(job["fmus"].items()))
    builder = jaxonomy.DiagramBuilder()
    names = {"input_names": ["x_d"], "output_names": ["x"]}
    if job["kind"] == "ModelExchange":
        fmu = builder.add(ModelicaFMUME(path, name=name, **names))
        more = {
            "rtol": job["tolerance"],
            "atol": 1e-2 * job["tolerance"],
            "ode_solver_method": "dopri5",
        }
    else:
        fmu = builder.add(
            ModelicaFMU(path, job["step"], name=name, first_step_at_zero=True, **names)
        )
        more = {}
    goal = builder.add(Constant(GOAL, name="goal"))
    builder.connect(goal.output_ports[0], fmu.input_ports[0])
    diagram = builder.build()
    result = jaxonomy.simulate(
        diagram,
        diagram.create_context(),
        (0.0, job["stop"]),
        options=jaxonomy.SimulatorOptions(
            max_major_step_length=job["step"], max_major_steps=steps(job) + 10, **more
        ),
        recorded_signals={"x": fmu.output_ports[0]},
    )
    return result.time, result.outputs["x"]


answer(run)
