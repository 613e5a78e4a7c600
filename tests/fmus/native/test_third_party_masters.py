"""Hosts that are not ours run the native FMUs of FMI 2.0, as parts and as a whole system."""

import subprocess
import sys

import numpy as np
import pytest
from pyssp_standard.ssp import SSP
from wired_loop import missing_for_ecos, run_in, wired

from ballscrew.fmus.system_export import export_system
from ballscrew.orchestration.loop import SystemLoop
from ballscrew.orchestration.run import run_closed_loop

HOSTS = ["libcosim", "ecos", "container"]
STEP = 1e-4


def course(host, plant, controller):
    missing = missing_for_ecos() if host == "ecos" else ""
    if missing:
        pytest.skip(missing)
    return np.array(run_in(host, wired(plant, controller, STEP, 0.3, law=True)))


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("controller", ["nctf", "iol"])
def test_a_stranger_s_master_gets_the_same_course_from_native_and_python_fmus(
    fmus, native, host, controller
):
    ours = course(host, native("plant"), native(controller))
    theirs = course(host, fmus["plant"], fmus[controller])
    span = np.ptp(theirs, axis=0)
    assert (span > 0).all()
    assert (np.abs(ours - theirs).max(axis=0) <= 1e-9 * span).all()


def test_a_system_of_native_fmus_is_read_and_run(native, tmp_path):
    """An .ssp with them inside, by our reader and master; pyssp_standard opens it, too."""
    path = tmp_path / "loop.ssp"
    export_system(native("plant"), native("nctf"), path, name="loop")
    result = run_closed_loop(SystemLoop(path, None, 0.2, step=1e-3))
    assert result.trusted, result.figures()["verdict_reason"]
    with SSP(path) as opened:
        assert len(opened.resources) >= 2


SYSTEM_HOSTS = {
    "libcosim": """
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
execution = CosimExecution.from_ssp_file(path, round(step * 1e9))
last = CosimObserver.create_last_value()
execution.add_observer(last)
plant = execution.slave_index_from_instance_name("plant")
x = next(v.reference for v in execution.slave_variables(plant) if v.name == b"x")
for _ in range(steps):
    assert execution.step()
    print("at", last.last_real_values(plant, [x])[0].hex())
""",
    "ecos": """
from ecospy import EcosSimulation
with EcosSimulation(step, ssp_path=path) as simulation:
    assert simulation.init(parameter_set="parameters")
    for _ in range(steps):
        simulation.step()
        print("at", simulation.get_real("plant::x").hex())
""",
}


@pytest.mark.parametrize("host", SYSTEM_HOSTS)
def test_a_stranger_reads_a_system_of_native_fmus_and_gets_the_same_course(
    fmus, native, tmp_path, host
):
    missing = missing_for_ecos() if host == "ecos" else ""
    if missing:
        pytest.skip(missing)
    courses = []
    for kind, plant, controller in (
        ("python", fmus["plant"], fmus["iol"]),
        ("native", native("plant"), native("iol")),
    ):
        path = export_system(plant, controller, tmp_path / f"{kind}.ssp", name="iol")
        head = f"path, step, steps = {str(path)!r}, 1e-4, 500\n"
        done = subprocess.run(
            [sys.executable, "-c", head + SYSTEM_HOSTS[host]],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            timeout=120,
        )
        assert done.returncode == 0, done.stderr[-2000:]
        numbers = [line[3:] for line in done.stdout.splitlines() if line.startswith("at ")]
        courses.append([float.fromhex(number) for number in numbers])
    theirs, ours = map(np.array, courses)
    assert len(theirs) == 500
    assert np.ptp(theirs) > 1e-4  # metres: it moves
    assert np.abs(ours - theirs).max() <= 1e-9 * np.ptp(theirs)
