"""FMPy: its own simulation of one FMU, as co-simulation or by its CVODE."""

import fmpy
from host import answer


def run(job):
    """Run with a tolerance for CVODE or, in co-simulation, for the FMU's solver."""
    course = fmpy.simulate_fmu(
        next(iter(job["fmus"].values())),
        fmi_type=job["kind"],
        stop_time=job["stop"],
        step_size=job["step"],
        output_interval=job["step"],
        relative_tolerance=job.get("tolerance"),
        output=["x"],
    )
    return course["time"], course["x"]


answer(run)
