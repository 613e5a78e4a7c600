"""``controller+instrument+...`` names a controller that measures through instruments."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.cli import main

NAME = "pid_sampled+position_encoder"
SHORT = ["--stop", "0.05", "--step", "1e-3"]


def course(folder):
    return np.genfromtxt(folder / "trajectory.csv", delimiter=",", names=True)


@pytest.mark.ci
def test_equations_fmus_and_an_ssp_run_to_the_same_course(tmp_path, capsys):
    """What a run wrote of both as one part has no place in an .ssp, where they are two."""
    coarse = ["--set", "controller.position_encoder_resolution=1e-5"]
    assert main(["run", "--controller", NAME, *coarse, *SHORT, "--out", str(tmp_path / "a")]) == 0
    monolithic = ["--coupling", "monolithic", *coarse, *SHORT]
    assert main(["run", "--controller", NAME, *monolithic, "--out", str(tmp_path / "b")]) == 0
    export = ["export", "--ssp", "--only", NAME, "--out", str(tmp_path)]
    assert main(export) == 0
    system = ["--system", str(tmp_path / f"{NAME}.ssp")]
    given = ["--set", "position_encoder.resolution=1e-5", *SHORT]
    assert main(["run", *system, *given, "--out", str(tmp_path / "c")]) == 0
    first = course(tmp_path / "a")
    for other in "bc":
        for signal in ("x", "v", "i"):
            apart = np.abs(course(tmp_path / other)[signal] - first[signal]).max()
            assert apart < 1e-7 * np.ptp(first[signal]), (other, signal)
    assert main([*export, "--params", str(tmp_path / "a" / "parameters.toml")]) == 2
    assert "in an .ssp its instruments are separate parts" in capsys.readouterr().err
