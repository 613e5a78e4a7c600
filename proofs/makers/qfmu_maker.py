"""qfmu: a state-space model as C, by its command; inputs u1, u2, u3 are x_d, x, v and y1 is u."""

import json
import subprocess
import sys
from pathlib import Path

from maker import answer


def make(gains, scratch: Path, target: Path):
    """Make the FMU with Euler steps of 1e-5 s."""
    matrices = {
        "A": [[0.0]],
        "B": [[1.0, -1.0, 0.0]],
        "C": [[gains["Ki"]]],
        "D": [[gains["Kp"], -gains["Kp"], -gains["Kd"]]],
    }
    told = [part for n, matrix in matrices.items() for part in (f"-{n}", json.dumps(matrix))]
    command = [Path(sys.executable).with_name("qfmu"), "ss", *told, "-dt", "1e-5", "-o", target]
    subprocess.run(command, cwd=scratch, check=True)


answer(make)
