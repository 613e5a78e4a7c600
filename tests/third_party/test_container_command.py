"""The FMU container's own command packs an exported .ssp, which then moves where it is to go.

It reads a system's elements and connections and no parameter sets, so that what is in those has to
be in the FMUs, too.
"""

import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.whole_loop import run_monolithic

STOP = 1.0  # seconds; the error is largest at 0.36 s, also of a run over 20 s
COMMAND = Path(sys.executable).with_name("fmucontainer")


@pytest.mark.parametrize("build", [[], ["--native"]])
def test_the_command_packs_an_exported_system_that_then_goes_to_its_set_point(tmp_path, build):
    assert main(["export", "--ssp", *build, "--only", "iol", "--out", str(tmp_path)]) == 0
    exact = run_monolithic(
        Loop("iol", reference=Reference.constant(0.08), stop=STOP), 1e-3
    ).outputs["x"]
    errors = []
    for step in (1e-3, 2e-4):
        done = subprocess.run(
            [COMMAND, "-container", f"iol.ssp:{step!r}", "-auto-local"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        course = fmpy.simulate_fmu(
            str(tmp_path / "iol.fmu"),
            stop_time=STOP,
            step_size=step,
            output_interval=1e-3,
            output=["plant.x"],
        )["plant.x"]
        errors.append(np.abs(course - exact).max())
    assert errors == pytest.approx([4.24e-4, 1.82e-5], rel=0.02)  # of a Jacobi master


def test_in_a_system_the_controller_s_own_start_values_are_those_of_its_parameter_set(
    tmp_path,
):
    """With feed-forward: the set-point's derivatives start at zero."""
    assert main(["export", "--ssp", "--only", "p_pi", "--out", str(tmp_path)]) == 0
    with zipfile.ZipFile(tmp_path / "p_pi.ssp") as archive:
        archive.extract("resources/controller.fmu", tmp_path)
        told = ET.fromstring(archive.read("resources/controller.ssv"))
    variables = fmpy.read_model_description(str(tmp_path / "resources/controller.fmu"))
    starts = {v.name: float(v.start) for v in variables.modelVariables if v.start is not None}
    given = told.findall(".//{*}Parameter")
    values = {p.get("name"): float(p[0].get("value")) for p in given}
    assert values["x_d"] == 0.08
    assert values["v_d"] == values["a_d"] == 0.0
    assert {n: starts[n] for n in values} == values
