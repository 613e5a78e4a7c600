"""A plant without inputs runs alone: as an FMU, for exponents and in maps."""

import csv
import json

import numpy as np
import pytest

import ballscrew
from ballscrew.cli import main

OMEGA, DECAY = 5.0, 0.3
FILE = f"""
from ballscrew import Component, Output, Parameter, State, symbol
def pendulum():
    x, v = symbol("x"), symbol("v")
    return Component("pendulum", "small swings",
        parameters=(Parameter("w", {OMEGA}, "1/s", "frequency", "test"),
                    Parameter("d", {DECAY}, "1/s", "decay", "test", minimum=0.0)),
        states=(State("x", "rad", "angle", v, start=0.2),
                State("v", "rad/s", "speed", -2 * symbol("d") * v - symbol("w")**2 * x)),
        outputs=(Output("x", "rad", "angle", x), Output("v", "rad/s", "speed", v)))
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    path = tmp_path_factory.mktemp("alone") / "swing.py"
    path.write_text(FILE)
    return f"{path}:pendulum"


def exact(t):
    w = np.sqrt(OMEGA**2 - DECAY**2)
    return 0.2 * np.exp(-DECAY * t) * (np.cos(w * t) + DECAY / w * np.sin(w * t))


def test_its_fmu_follows_the_exact_course_and_nothing_of_a_set_point_is_written(
    place, tmp_path, capsys
):
    asked = ["run", "--controller", "none", "--plant", place, "--stop", "2", "--step", "0.01"]
    assert main([*asked, "--out", str(tmp_path)]) == 0
    with (tmp_path / "trajectory.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert set(rows[0]) == {"time", "x", "v"}
    t, x = (np.array([float(r[n]) for r in rows]) for n in ("time", "x"))
    assert np.max(np.abs(x - exact(t))) < 1e-6
    figures = json.loads((tmp_path / "metrics.json").read_text())
    assert figures["controller"] == "pendulum"
    assert "there is no coupling" in figures["verdict_reason"]
    assert "peak voltage" not in capsys.readouterr().out


def test_its_exponents_are_the_real_parts_of_its_eigenvalues(place):
    found = ballscrew.lyapunov("none", place, stop=20.0)
    assert found.label == "pendulum"
    assert found.motion.kind.value == "isolated fixed point"
    assert found.motion.limit == pytest.approx([-DECAY, -DECAY], rel=1e-6)
