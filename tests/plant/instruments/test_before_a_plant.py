"""What acts on a plant: amplifier, late command, load, payload."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew import Component, ForceBalance, ForceTerm, Output, Parameter, State, symbol
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.plant.ball_screw import ball_screw, bare_ball_screw
from ballscrew.plant.classical import classical, with_sticking
from ballscrew.plant.direct_drive import bare_direct_drive, with_command_limit
from ballscrew.plant.instruments.late_command import with_late_command
from ballscrew.plant.instruments.load import with_load
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model


def course(kernel, values, u=100.0):
    model = Model(kernel, values)
    model.set_input("u", u)
    return model.simulate(np.linspace(0, 0.05, 501))


def test_a_voltage_limit_acts_like_that_voltage():
    axis = generate(component("plant"))
    limited, asked = course(axis, {"voltage_limit": 36.0}), course(axis, {}, 36.0)
    np.testing.assert_allclose(limited.outputs["v"], asked.outputs["v"], rtol=1e-6, atol=1e-9)
    backwards = course(axis, {"voltage_limit": 36.0}, -100.0)
    np.testing.assert_allclose(backwards.outputs["v"], -limited.outputs["v"], rtol=1e-6, atol=1e-9)


@pytest.mark.ci
@pytest.mark.parametrize(("command", "arrives"), [(3.0, 2.0), (-3.0, -2.0), (1.5, 1.5)])
def test_a_limit_cuts_the_command_of_a_drive_either_way(command, arrives):
    drive = with_command_limit(bare_direct_drive())
    (force,) = (t.force for t in drive.terms if t.name == "drive")
    given = {"u": command, "voltage_limit": 2.0, "gain": 35.15, "offset": 0.0}
    values = {symbol(n): v for n, v in given.items()}
    assert float(force.subs(values)) == pytest.approx(35.15 * arrives)


def test_the_current_meets_its_limit_and_never_crosses_it():
    axis = generate(component("plant"))
    assert course(axis, {}).outputs["i"].max() > 2.0
    limited = course(axis, {"current_limit": 0.2})
    assert limited.outputs["i"].max() <= 0.2 * (1 + 1e-6)
    assert limited.outputs["i"].max() > 0.199


DELAY = 3e-4
PARAMETER = Parameter("delay", DELAY, "s", "of the command", "example value", minimum=1e-7)
JUMPS = ((0.0, 5.0), (2e-3, -3.0), (2.2e-3, 8.0), (2.4e-3, 0.0))


def moved(component, late):
    """The axis after jumps of the command, which come so much late."""
    model, start = Model(generate(component), tolerance=1e-11), late
    if late:
        model.advance(0.0, late)
    for (_, u), (end, _) in zip(JUMPS, (*JUMPS[1:], (6e-3, 0.0)), strict=True):
        model.set_input("u", u)
        model.advance(start, end + late)
        start = end + late
    return model.x


def test_the_plant_moves_as_under_a_command_that_is_given_later():
    model = Model(generate(with_late_command(ball_screw(), PARAMETER)), tolerance=1e-11)
    for (start, u), (end, _) in zip(JUMPS, (*JUMPS[1:], (6e-3 + DELAY, 0.0)), strict=True):
        model.set_input("u", u)
        model.advance(start, end)
    expected = moved(ball_screw(), DELAY)
    assert model.x == pytest.approx(expected, rel=1e-8)
    assert np.abs(expected).max() > 0.0


MASS, DRIVE = 2.0, 1.0
BODY = Component(
    name="body",
    description="A mass under a constant force.",
    parameters=(Parameter("m", MASS, "kg", "mass", "test", minimum=1e-3),),
    states=(State("v", "m/s", "velocity"),),
    outputs=(Output("v", "m/s", "velocity", symbol("v")),),
    balances=(ForceBalance("v", symbol("m"), (ForceTerm("drive", DRIVE, "drive"),)),),
)
KERNEL = generate(with_load(BODY))
TIME = np.linspace(0, 0.5, 51)


def speed(**values):
    return Model(KERNEL, values, tolerance=1e-10).simulate(TIME)


def impulse(rise, force, begin, t):
    """Of the ramp up to each time."""
    ramp = force * np.clip(t - begin, 0, rise) ** 2 / (2 * rise)
    return ramp + force * np.clip(t - begin - rise, 0, None)


@pytest.mark.parametrize("rise", [1e-9, 0.2])
def test_the_momentum_is_the_impulse_of_all_forces(rise):
    run = speed(load_force=-3.0, load_time=0.1, load_rise=rise)
    expected = (DRIVE * TIME + impulse(rise, -3.0, 0.1, TIME)) / MASS
    np.testing.assert_allclose(run.outputs["v"], expected, atol=2e-9)
    assert run.outputs["load"][0] == 0.0
    assert run.outputs["load"][-1] == -3.0


def test_the_sine_has_its_amplitude_frequency_and_phase():
    run = speed(load_amplitude=2.5, load_frequency=7.0, load_phase=0.4)
    turn = 2 * np.pi * 7.0
    expected = DRIVE * TIME + 2.5 / turn * (np.cos(0.4) - np.cos(turn * TIME + 0.4))
    np.testing.assert_allclose(run.outputs["v"], expected / MASS, atol=1e-8)


def test_the_payload_comes_with_the_speed_of_the_plant():
    run = speed(payload=3.0, payload_time=0.25)
    before = DRIVE * np.minimum(TIME, 0.25) / MASS
    after = DRIVE * np.clip(TIME - 0.25, 0, None) / (MASS + 3.0)
    np.testing.assert_allclose(run.outputs["v"], before + after, atol=2e-9)


def test_a_plant_that_sticks_is_torn_off_by_its_load_alone():
    plant = with_sticking(with_load(bare_ball_screw(classical)))
    held, torn = (Model(generate(plant), {"load_force": f, "load_time": 0.01}) for f in (0.5, 20.0))
    for model in (held, torn):
        model.settle(0.0)
        model.advance(0.0, 0.05)
    x = [s.name for s in held.kernel.states].index("x")
    assert held.x[x] == 0.0
    assert torn.x[x] > 1e-6
