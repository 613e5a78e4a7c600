"""A plant, instruments and a controller, each an FMU, run as the one loop of their equations."""

import numpy as np
import pytest
from instrument_loops import SIGNALS, apart, exact_course, exported

from ballscrew.orchestration.loop.catalogue import component
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import SystemLoop


@pytest.mark.parametrize(
    ("controller", "instruments", "stop"),
    [
        pytest.param("pid_sampled", ["position_encoder"], 0.1, id="position"),
        pytest.param(
            "iol+sampled",
            ["position_encoder", "velocity_estimate", "current_sensor"],
            0.05,
            id="position-velocity-current",
        ),
    ],
)
@pytest.mark.parametrize("parts", [1, 2])
def test_our_master_runs_a_sampled_loop_with_instruments_exactly(
    tmp_path, controller, instruments, stop, parts
):
    """To 1e-9 of each range, with communication steps of a period and of half of one."""
    path = exported(tmp_path / "loop.ssp", controller, instruments)
    period = component(controller).sample_time.default
    values = {"plant.solver_tolerance": 1e-10}
    result = run_closed_loop(SystemLoop(path, stop=stop, step=period / parts, values=values))
    course = np.column_stack([result.run.outputs[n][::parts] for n in SIGNALS])
    exact = exact_course(controller, [component(n) for n in instruments], stop)
    assert result.run.verdict.trusted
    assert (apart(course, exact) < 1e-9).all()
    # what an encoder gives is recorded of the position of then, not of a step before
    counted = result.run.others["position_encoder.x_measured"] - result.run.outputs["x"]
    assert np.abs(counted).max() < 1e-6 < np.abs(np.diff(result.run.outputs["x"])).max()
    bare = exact_course(controller, [], stop)
    assert (apart(bare, exact) > 1e-8).all()  # the instruments do something
