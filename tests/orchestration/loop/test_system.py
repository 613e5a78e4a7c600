"""Closed loops from .ssp files: ours, and third-party ones with more parts, units, start values."""

import numpy as np
import pytest
from instrument_loops import SIGNALS, apart, exact_course, exported

from ballscrew.fmus.system_export import export_system
from ballscrew.orchestration.loop.catalogue import component, fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop, SystemLoop
from ballscrew.orchestration.master.reference_signal import Reference

STEP = 1e-3  # where runs are compared with each other, none needs to choose its step


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ssp")
    return {
        name: export_system(fmu("plant"), fmu(name), folder / f"{name}.ssp", name=name)
        for name in ("iol", "nctf", "pid_sampled")
    }


def test_our_own_file_gives_the_same_run_as_the_parts_by_name(ours):
    for name, path in ours.items():
        by_file = run_closed_loop(SystemLoop(path, stop=0.2, step=STEP)).run
        by_name = run_closed_loop(Loop(name, stop=0.2, step=STEP)).run
        assert by_file.coupling is by_name.coupling
        assert by_file.verdict.word == by_name.verdict.word
        np.testing.assert_array_equal(by_file.time, by_name.time)
        np.testing.assert_array_equal(by_file.reference, by_name.reference)
        for column, course in by_name.outputs.items():
            np.testing.assert_array_equal(by_file.outputs[column], course)


def test_set_point_stop_time_and_parameters_come_from_the_file_unless_told(ours, tmp_path):
    short = export_system(
        fmu("plant"), fmu("nctf"), tmp_path / "short.ssp", name="s", setpoint=-0.03, stop=0.05
    )
    own = run_closed_loop(SystemLoop(short)).run
    assert own.time[-1] == 0.05
    assert set(own.reference) == {-0.03}
    told = run_closed_loop(
        SystemLoop(short, Reference.constant(0.02), stop=0.1, values={"plant.sigma0": 6e4})
    ).run
    same = run_closed_loop(
        Loop("nctf", reference=Reference.constant(0.02), stop=0.1, plant_values={"sigma0": 6e4})
    ).run
    np.testing.assert_array_equal(told.outputs["z"], same.outputs["z"])


@pytest.mark.parametrize("parts", [1, 2])
def test_our_master_runs_a_sampled_loop_with_instruments_exactly(tmp_path, parts):
    """To 1e-9 of each range, with communication steps of a period and of half of one."""
    controller, stop = "iol+sampled", 0.05
    instruments = ["position_encoder", "velocity_estimate", "current_sensor"]
    path = exported(tmp_path / "loop.ssp", controller, instruments)
    step = component(controller).sample_time.default / parts
    values = {"plant.solver_tolerance": 1e-10}
    result = run_closed_loop(SystemLoop(path, stop=stop, step=step, values=values))
    course = np.column_stack([result.run.outputs[n][::parts] for n in SIGNALS])
    exact = exact_course(controller, [component(n) for n in instruments], stop)
    assert result.run.verdict.trusted
    assert (apart(course, exact) < 1e-9).all()
    # what an encoder gives is recorded of the position of then, not of a step before
    counted = result.run.others["position_encoder.x_measured"] - result.run.outputs["x"]
    assert np.abs(counted).max() < 1e-6 < np.abs(np.diff(result.run.outputs["x"])).max()
    bare = exact_course(controller, [], stop)
    assert (apart(bare, exact) > 1e-8).all()  # the instruments do something
