"""Drive one FMU with a series of inputs through fmpy's simulate_fmu."""

import json
import sys
from pathlib import Path

import fmpy
import numpy as np

job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
series = np.array(list(zip(*job["series"].values(), strict=True)))
course = fmpy.simulate_fmu(
    job["fmu"],
    stop_time=job["stop"],
    output_interval=job["step"],
    input=np.array([tuple(row) for row in series], dtype=[(name, float) for name in job["series"]]),
    output=job["outputs"],
)
rows = {name: course[name].tolist() for name in ("time", *job["outputs"])}
Path(sys.argv[2]).write_text(json.dumps(rows), encoding="utf-8")
