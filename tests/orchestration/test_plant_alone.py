"""A plant without inputs runs alone: as an FMU, for exponents and in maps."""

import csv
import json
import re

import numpy as np
import pytest

import ballscrew
from ballscrew.cli import main
from ballscrew.gallery.bouncing_ball.findings import BALL
from ballscrew.solver.component import Component, Output, Parameter, State, symbol

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


def test_its_pictures_have_its_own_units(place):
    figures = ballscrew.run("none", place, stop=1.0, step=0.01).pictures()
    (axes,) = figures["position"].axes
    assert axes.get_ylabel() == "angle x [rad]"
    assert [line.get_label() for line in axes.lines] == ["position"]
    assert figures["phase"].axes[0].get_xlabel() == "angle x [rad]"
    assert figures["phase"].axes[0].get_ylabel() == "angular velocity v [rad/s]"
    axis = ballscrew.run("pid", stop=0.1, step=1e-3).pictures()
    assert axis["position"].axes[0].get_ylabel() == "position x [mm]"


def test_its_exponents_are_the_real_parts_of_its_eigenvalues(place):
    found = ballscrew.lyapunov("none", place, stop=20.0)
    assert found.label == "pendulum"
    assert found.motion.kind.value == "isolated fixed point"
    assert found.motion.limit == pytest.approx([-DECAY, -DECAY], rel=1e-6)


def test_its_map_tells_where_it_rests_and_has_its_units(place, tmp_path):
    made = ballscrew.stability_map(
        "none", "d=0.3:1:3", "x_start=0.1:0.2:2", tmp_path, plant=place, stop=40.0
    )
    assert made.summary.verdicts == {"isolated fixed point": 6}
    axes = made.plot().axes
    labels = [a.get_ylabel() for a in axes]
    for what in ("amplitude", "distance"):
        assert any(re.fullmatch(rf"{what} \[[mµn]?rad\]", label) for label in labels)
    assert {"Amplitude at the end", "Distance to zero at the end"} <= {a.get_title() for a in axes}


def test_a_map_shows_exponents_of_minus_infinity_with_the_lowest_colour(tmp_path):
    """Of a ball that has come to rest, where no disturbance is left."""
    made = ballscrew.stability_map(
        "none", "e=0.5:0.95:2", "v_min=0.1:0.2:2", tmp_path, plant=BALL, stop=2.0, exponents=True
    )
    rates = made.plot().axes[3].collections[0]
    low, high = rates.get_clim()
    assert np.array_equal(rates.get_array()[:, 0], [low, low])
    assert np.all(rates.get_array()[:, 1] > 0.0)
    assert 0.0 < high < 10.0


def test_a_plant_with_inputs_is_refused_in_one_line(tmp_path, capsys):
    for command in ("run", "lyapunov"):
        assert main([command, "--controller", "none", "--stop", "1", "--out", str(tmp_path)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "'u'" in line


def test_other_defaults_belong_to_a_copy_and_must_have_a_parameter():
    k = symbol("k")
    one = Component(
        "decay",
        "decays",
        parameters=(Parameter("k", 1.0, "1/s", "rate", "test", minimum=0.0),),
        states=(State("x", "m", "position", -k * symbol("x"), start=1.0),),
        outputs=(Output("x", "m", "position", symbol("x")),),
    )
    other = one.with_defaults({"k": 3.0}, "a table")
    assert [(p.default, p.source) for p in other.parameters] == [(3.0, "a table")]
    assert one.parameters[0].default == 1.0
    with pytest.raises(ValueError, match="no parameter 'q'"):
        one.with_defaults({"q": 1.0}, "a table")
    with pytest.raises(ValueError, match="within"):
        one.with_defaults({"k": -1.0}, "a table")
