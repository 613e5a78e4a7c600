"""The FMU container's own command packs an exported .ssp, which then moves where it is to go.

It reads a system's elements and connections and no parameter sets, so that what is in those has to
be in the FMUs, too.
"""

import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.whole_loop import run_monolithic

pytestmark = pytest.mark.ci
STOP = 1.0  # seconds; the error is largest at 0.36 s, also of a run over 20 s
COMMAND = Path(sys.executable).with_name("fmucontainer")


@pytest.mark.parametrize("build", [[], ["--native"]])
def test_the_command_packs_an_exported_system_that_then_goes_to_its_set_point(tmp_path, build):
    assert main(["export", "--ssp", *build, "--only", "iol", "--out", str(tmp_path)]) == 0
    loop = Loop("iol", reference=Reference.constant(0.08), stop=STOP)
    exact = run_monolithic(loop, 1e-3).outputs["x"]
    errors = []
    for step in (1e-3, 2e-4):
        words = [COMMAND, "-container", f"iol.ssp:{step!r}", "-auto-local"]
        subprocess.run(words, cwd=tmp_path, check=True)
        times = {"stop_time": STOP, "step_size": step, "output_interval": 1e-3}
        course = fmpy.simulate_fmu(str(tmp_path / "iol.fmu"), **times, output=["plant.x"])
        errors.append(np.abs(course["plant.x"] - exact).max())
    assert errors == pytest.approx([4.24e-4, 1.82e-5], rel=0.02)  # of a Jacobi master
