"""A pair of parts: derivatives of the set-point reach the controller; a plant may run alone."""

import csv
import json

import numpy as np
import pytest

import ballscrew
from ballscrew.cli import main
from ballscrew.controllers.limited import measurements_of
from ballscrew.fmus.native.export import write_native
from ballscrew.fmus.native.sources import native_model
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.reference_motions import move
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.plant.axis import axis
from ballscrew.solver.component import Component, Input, Output, symbol

STOP, STEP = 0.3, 1e-3
MOTION = move(0.01, start=0.05, dwell=0.05, back=0.0)


def echo() -> Component:
    """Commands what it is told of the derivatives, and damps, so that it measures something."""
    command = 100 * symbol("v_d") + 3 * symbol("a_d") - 0 * symbol("x_d") - 1e-9 * symbol("v")
    told = (
        Input("v_d", "m/s", "desired velocity", role="reference"),  # its name decides
        Input("a_d", "m/s^2", "desired acceleration", role="reference"),
    )
    return Component(
        name="echo",
        description="Feed-forward alone",
        inputs=(*measurements_of(axis()), *told),
        outputs=(Output("u", "V", "motor terminal voltage", command, nominal=10.0),),
    )


@pytest.fixture(scope="module")
def alone():
    return run_monolithic(Loop(echo(), reference=MOTION, stop=STOP), STEP)


def test_the_whole_loop_feeds_the_derivatives(alone):
    v_d, a_d = (MOTION.on(alone.time, k) for k in (1, 2))
    np.testing.assert_allclose(alone.commands["u"], 100 * v_d + 3 * a_d, atol=1e-6)
    assert np.ptp(alone.commands["u"]) > 5


def test_fmus_are_fed_as_the_whole_loop_is(alone, tmp_path, native):
    path = tmp_path / "echo.fmu"
    write_native(native_model(echo()), path, fmi=2)
    result = run_closed_loop(Loop(str(path), str(native("plant")), MOTION, STOP, step=STEP))
    assert not [note for note in result.notes if "is used as the set-point" in note]
    run = result.run
    np.testing.assert_allclose(run.outputs["x"], alone.outputs["x"], atol=2e-6)
    np.testing.assert_allclose(run.commands["u"], alone.commands["u"], atol=1e-6)


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
    assert figures["error_estimate"] == {"x": 0.0, "v": 0.0}
    assert "peak voltage" not in capsys.readouterr().out


def test_its_exponents_are_the_real_parts_of_its_eigenvalues(place):
    found = ballscrew.lyapunov("none", place, stop=20.0)
    assert found.label == "pendulum"
    assert found.motion.kind.value == "isolated fixed point"
    assert found.motion.limit == pytest.approx([-DECAY, -DECAY], rel=1e-6)
