"""PathSim with pathsim-fmi: blocks around FMUs."""

from host import GOAL, answer
from pathsim import Connection, Simulation
from pathsim.blocks import Constant, Scope
from pathsim_fmi import CoSimulationFMU


def run(job):
    """Run; a block steps at the start of an interval, so outputs are labelled one step early."""
    goal, scope = Constant(GOAL), Scope()
    last = list(job["fmus"])[-1]
    blocks = {
        n: CoSimulationFMU(f, n, {"x_d": GOAL} if n == last else None, job["step"])
        for n, f in job["fmus"].items()
    }
    wires = [Connection(blocks[a][y], blocks[b][u]) for (a, y), (b, u) in job["connections"]]
    shown = next(iter(blocks.values()))
    wires += [Connection(goal, blocks[last]["x_d"]), Connection(shown["x"], scope)]
    Simulation([goal, scope, *blocks.values()], wires, dt=job["step"], log=False).run(job["stop"])
    time, (x,) = scope.read()
    return [t + job["step"] for t in time[:-1]], x[:-1]


answer(run)
