"""``controller+instrument+...`` names a controller that measures through instruments."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.fmus.catalogue import component, fmu_kernel, has_equations, kept_as, name_of
from ballscrew.instruments import without_instruments

NAME = "pid_sampled+position_encoder"
SHORT = ["--stop", "0.05", "--step", "1e-3"]


def course(folder):
    return np.genfromtxt(folder / "trajectory.csv", delimiter=",", names=True)


def test_equations_fmus_and_an_ssp_run_to_the_same_course(tmp_path):
    coarse = ["--set", "controller.position_encoder_resolution=1e-5"]
    assert main(["run", "--controller", NAME, *coarse, *SHORT, "--out", str(tmp_path / "a")]) == 0
    monolithic = ["--coupling", "monolithic", *coarse, *SHORT]
    assert main(["run", "--controller", NAME, *monolithic, "--out", str(tmp_path / "b")]) == 0
    assert main(["export", "--ssp", "--only", NAME, "--out", str(tmp_path)]) == 0
    system = [
        "--system",
        str(tmp_path / f"{NAME}.ssp"),
        "--set",
        "position_encoder.resolution=1e-5",
    ]
    assert main(["run", *system, *SHORT, "--out", str(tmp_path / "c")]) == 0
    first = course(tmp_path / "a")
    for other in "bc":
        for signal in ("x", "v", "i"):
            apart = np.abs(course(tmp_path / other)[signal] - first[signal]).max()
            assert apart < 1e-7 * np.ptp(first[signal]), (other, signal)


def test_swap_compares_a_controller_with_and_without_instruments(tmp_path, capsys):
    names = [
        "--controllers",
        "pid_sampled",
        NAME,
        "--set",
        f"{NAME}.position_encoder_resolution=1e-3",
    ]
    assert main(["swap", *names, *SHORT, "--json", "--out", str(tmp_path)]) == 0
    ideal, measured = json.loads(capsys.readouterr().out)
    assert measured["controller"] == NAME
    assert ideal["iae"] != measured["iae"]
    parameters = tmp_path / "parameters.toml"
    again = ["--controller", NAME, "--params", str(parameters), *SHORT]
    assert main(["run", *again, "--json", "--out", str(tmp_path / "again")]) == 0
    assert json.loads(capsys.readouterr().out)["iae"] == measured["iae"]


def test_an_ssp_has_no_place_for_the_values_of_both_as_one_part(tmp_path, capsys):
    run = ["run", "--controller", NAME, *SHORT, "--out", str(tmp_path / "run")]
    assert main(run) == 0
    told = ["--params", str(tmp_path / "run" / "parameters.toml")]
    assert main(["export", "--ssp", "--only", NAME, *told, "--out", str(tmp_path / "ssp")]) == 2
    assert "in an .ssp its instruments are separate parts" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("pid_sampled+camera", "no instrument 'camera'; there are position_encoder, "),
        ("pid_sampled+position_encoder+position_encoder", "is given twice"),
        ("position_encoder", "'position_encoder' is neither one of iol, "),
    ],
)
def test_what_is_no_such_part_is_refused_with_one_line(tmp_path, capsys, name, line):
    assert main(["run", "--controller", name, *SHORT, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1


def test_a_part_s_name_says_the_controller_and_its_instruments():
    assert without_instruments("c++/mine.py:pi+velocity_estimate") == (
        "c++/mine.py:pi",
        ("velocity_estimate",),
    )
    assert without_instruments("position_encoder") == ("position_encoder", ())
    assert has_equations(NAME)
    assert not has_equations("some+position_encoder")
    assert name_of(NAME) == NAME
    assert kept_as(NAME)[0] == "pid_sampled_behind_position_encoder"
    assert fmu_kernel(NAME).name == component(NAME).name


def test_instruments_sample_with_the_controller():
    made = component("nctf_sampled+velocity_estimate")
    assert made.sample_time.default == component("nctf_sampled").sample_time.default == 5e-5


def test_the_loaded_plant_runs_by_name_and_its_values_come_back(tmp_path, capsys):
    load = ["--plant", "plant_loaded", "--set", "plant.load_force=-5", "--set", "plant.load_time=0"]
    run = ["run", "--controller", "pid", *SHORT, "--json"]
    assert main([*run, *load, "--out", str(tmp_path / "a")]) == 0
    loaded = json.loads(capsys.readouterr().out)["iae"]
    assert main([*run, "--out", str(tmp_path / "b")]) == 0
    assert json.loads(capsys.readouterr().out)["iae"] < loaded
    told = ["--params", str(tmp_path / "a" / "parameters.toml"), "--plant", "plant_loaded"]
    assert main([*run, *told, "--out", str(tmp_path / "c")]) == 0
    assert json.loads(capsys.readouterr().out)["iae"] == loaded
