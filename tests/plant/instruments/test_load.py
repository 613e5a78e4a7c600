"""A load and a payload: momentum follows the integral of the forces."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.plant.ball_screw import bare_ball_screw
from ballscrew.plant.classical import classical, with_sticking
from ballscrew.plant.instruments.load import with_load
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    Component,
    ForceBalance,
    ForceTerm,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.kernel import Model

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
