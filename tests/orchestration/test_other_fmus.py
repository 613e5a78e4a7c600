"""FMUs that are not FMI 2.0 co-simulation of real signals, as the master takes them."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.closed_loop import Study, run_study

STOP = 0.3


def course(plant, controller, **options):
    run = run_study(Study(str(controller), str(plant), stop=STOP, **options)).run
    assert not run.stopped
    return run, run.outputs | run.commands


@pytest.mark.parametrize("controller", ["iol", "pid_sampled"])
@pytest.mark.parametrize("isolate", [False, True])
def test_fmi_3_runs_as_fmi_2_does(native, controller, isolate):
    other, expected = course(native("plant"), native(controller))
    run, found = course(native("plant", 3), native(controller, 3), isolate=isolate)
    assert run.coupling is other.coupling
    assert run.verdict.trusted == other.verdict.trusted
    assert run.step_range == other.step_range
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-12)


def test_what_export_writes_as_fmi_3_run_takes(tmp_path, native):
    parts = ["--plant", str(native("plant", 3)), "--controller", str(native("pid", 3))]
    assert main(["run", *parts, "--stop", "0.05", "--out", str(tmp_path)]) == 0
    assert "verdict" in (tmp_path / "metrics.json").read_text()
