"""gemseo-fmu: an FMU as a discipline."""

from gemseo_fmu.disciplines.fmu_discipline import FMUDiscipline
from host import GOAL, answer
from numpy import array


def run(job):
    """Run with named inputs; otherwise it sets all parameters during the run, which FMUs reject."""
    loop = FMUDiscipline(
        next(iter(job["fmus"].values())),
        input_names=["x_d"],
        output_names=["x"],
        final_time=job["stop"],
        time_step=job["step"],
    )
    data = loop.execute({"x_d": array([GOAL])})
    return loop.time, data["x"]


answer(run)
