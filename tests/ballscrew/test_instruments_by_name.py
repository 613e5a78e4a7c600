"""``controller+instrument+...`` names a controller that measures through instruments."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.loop.catalogue import (
    component,
    fmu_kernel,
    has_equations,
    kept_as,
    name_of,
)
from ballscrew.plant.instruments import PartName

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


@pytest.mark.ci
def test_swap_compares_a_controller_with_and_without_instruments(tmp_path, capsys):
    given = ["--set", f"{NAME}.position_encoder_resolution=1e-3", *SHORT, "--json"]
    assert main(["swap", "--controllers", "pid_sampled", NAME, *given, "--out", str(tmp_path)]) == 0
    ideal, measured = json.loads(capsys.readouterr().out)
    assert measured["controller"] == NAME
    assert ideal["iae"] != measured["iae"]
    again = ["--controller", NAME, "--params", str(tmp_path / "parameters.toml"), *SHORT]
    assert main(["run", *again, "--json", "--out", str(tmp_path / "again")]) == 0
    assert json.loads(capsys.readouterr().out)["iae"] == measured["iae"]


def test_a_part_s_name_says_the_controller_and_its_instruments():
    named = PartName.of("c++/mine.py:pi+feed_forward+sampled+velocity_estimate+rotary+torque")
    whole = "c++/mine.py:pi", True, True, ("velocity_estimate",), ("rotary", "torque")
    assert named == PartName(*whole)
    for name in (str(named), "position_encoder", "sampled", "pid+position_encoder+sampled", "a+b"):
        assert str(PartName.of(name)) == name
    assert PartName.of("position_encoder").bare == "position_encoder"
    assert has_equations(NAME)
    assert not has_equations("some+position_encoder")
    assert name_of(NAME) == NAME
    assert kept_as(NAME)[0] == "pid_sampled_with_position_encoder"
    assert fmu_kernel(NAME).name == component(NAME).name
