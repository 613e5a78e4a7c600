"""SysSimX: FMU components in a system, with its Jacobi or Gauss-Seidel algorithm."""

from host import GOAL, answer
from syssimx import Connection, System
from syssimx.components import FMUComponent
from syssimx.system.algorithms.gauss_seidel import GaussSeidelAlgorithm
from syssimx.system.algorithms.jacobi import JacobiAlgorithm


class Part(FMUComponent):
    """A component as in its example: a system begins with steps of zero length, not part of FMI."""

    def _do_step_internal(self, t, dt):
        if dt > 0.0:
            super()._do_step_internal(t, dt)


def run(job):
    system = System("axis")
    parts = {n: Part(n, f) for n, f in job["fmus"].items()}
    for part in parts.values():
        system.add_component(part)
    for (a, y), (b, u) in job["connections"]:
        system.add_connection(Connection(a, y, b, u))
    name = list(parts)[-1]
    methods = {"jacobi": JacobiAlgorithm, "gauss_seidel": GaussSeidelAlgorithm}
    system.set_algorithm(methods[job["method"]]())
    system.initialize(0.0)
    parts[name].set_inputs({"x_d": GOAL})
    result = system.run(0.0, job["stop"], job["step"])
    time, courses = result.histories[next(iter(parts))]
    return time, courses["x"]


answer(run)
