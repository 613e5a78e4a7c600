"""Drive one FMU with a series of inputs through fmpy's simulate_fmu."""

import fmpy
import numpy as np
from job import JOB, answer

series = JOB["series"]
rows = [tuple(row) for row in zip(*series.values(), strict=True)]
course = fmpy.simulate_fmu(
    JOB["fmu"],
    stop_time=JOB["stop"],
    output_interval=JOB["step"],
    input=np.array(rows, dtype=[(name, float) for name in series]),
    output=JOB["outputs"],
)
answer({name: course[name].tolist() for name in ("time", *JOB["outputs"])})
