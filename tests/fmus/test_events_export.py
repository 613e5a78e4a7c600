"""Components with modes and events as FMUs."""

import numpy as np
import pytest
from fmu_host import opened

from ballscrew.fmus.export import export, with_law_ports
from ballscrew.orchestration.fmu_instance import FmuInstance, StepFailed
from ballscrew.plant.ball_screw import ball_screw
from ballscrew.plant.classical import classical
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    Event,
    Input,
    Mode,
    Output,
    State,
    symbol,
)
from ballscrew.solver.kernel import Model


@pytest.fixture(scope="module")
def sticking(tmp_path_factory):
    """The axis with classical friction, as FMU and as compiled equations."""
    component = ball_screw(classical, "sticking_axis")
    path = export(component, tmp_path_factory.mktemp("fmu") / "sticking_axis.fmu")
    return path, generate(with_law_ports(component))


VOLTAGES = (0.1, 1.0, 0.2, -0.1, -3.0, 3.0, 0.0)


def test_sticking_and_sliding_in_an_fmu_is_the_equations_to_the_last_bit(sticking):
    path, kernel = sticking
    plant, model = FmuInstance(path, "plant"), Model(kernel)
    plant.initialize({}, 1.0)
    write, read = plant.writer(["u"]), plant.reader(["x", "v", "friction", "stuck"])
    seen = []
    for k in range(7 * 50):
        t = 2e-3 * k
        voltage = VOLTAGES[k // 50]
        write(np.array([voltage]))
        model.set_input("u", voltage)
        plant.step(t, 2e-3)
        model.advance(t, t + 2e-3)
        y = model.outputs(t + 2e-3, model.x)
        seen.append(read())
        assert seen[-1].tolist() == [y["x"], y["v"], y["friction"], y["stuck"]]
    plant.close()
    stuck = np.array(seen)[:, 3]
    assert [int(stuck[50 * k + 49]) for k in range(7)] == [1, 0, 1, 1, 0, 0, 1]
    assert model.info[4] == 6  # break-aways and stops; the reversal is one of each


def test_a_state_saved_while_sticking_goes_on_sticking(sticking):
    plant = FmuInstance(sticking[0], "plant")
    plant.initialize({}, 1.0)
    write, read = plant.writer(["u"]), plant.reader(["v", "stuck"])
    write(np.array([0.1]))
    plant.step(0.0, 1e-2)
    saved = plant.save()
    write(np.array([5.0]))
    plant.step(1e-2, 1e-2)
    v, stuck = read()
    assert v > 1e-3
    assert stuck == 0.0
    plant.restore(saved)
    assert read().tolist() == [0.0, 1.0]
    write(np.array([5.0]))
    plant.step(1e-2, 1e-2)
    assert read().tolist() == [v, 0.0]
    plant.close()


def test_a_body_that_starts_in_motion_slides_from_the_start(sticking):
    slave, at = opened(sticking[0], {"v_start": -0.01})
    assert slave.getReal([at["stuck"]])[0] == 0.0
    assert slave.getReal([at["friction"]])[0] < -1.0
    slave.terminate()
    slave.freeInstance()


def test_events_without_end_fail_the_step_with_the_reason(tmp_path):
    there = Event("there", symbol("u") - 1, direction=1, next_mode="b")
    back = Event("back", symbol("u") - 1, direction=1, next_mode="a")
    component = Component(
        "flipping",
        "two modes switch to each other",
        inputs=(Input("u", "1", "signal"),),
        states=(State("x", "1", "time", TIME * 0 + 1),),
        outputs=(Output("x", "1", "time", symbol("x")),),
        modes=(Mode("a", events=(there,)), Mode("b", events=(back,))),
    )
    part = FmuInstance(export(component, tmp_path / "flipping.fmu"), "part")
    part.initialize({}, 1.0)
    part.step(0.0, 1.0)
    part.writer(["u"])(np.array([2.0]))
    with pytest.raises(StepFailed, match=r"part: events follow each other without end at t = 1 s"):
        part.step(1.0, 1.0)
    part.close()
