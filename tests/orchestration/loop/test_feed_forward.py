"""Derivatives of the set-point reach a controller's inputs, over FMUs and in one solver."""

import numpy as np
import pytest

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
    study = Loop(str(path), str(native("plant")), MOTION, STOP, step=STEP)
    result = run_closed_loop(study)
    assert not [note for note in result.notes if "is used as the set-point" in note]
    run = result.run
    np.testing.assert_allclose(run.outputs["x"], alone.outputs["x"], atol=2e-6)
    np.testing.assert_allclose(run.commands["u"], alone.commands["u"], atol=1e-6)
