"""A command on its way: whole, after the delay, and not before."""

import numpy as np
import pytest

from ballscrew.plant.ball_screw import ball_screw
from ballscrew.plant.instruments.late_command import with_late_command
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Parameter
from ballscrew.solver.kernel import Model

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
    late = with_late_command(ball_screw(), PARAMETER)
    model = Model(generate(late), tolerance=1e-11)
    for (start, u), (end, _) in zip(JUMPS, (*JUMPS[1:], (6e-3 + DELAY, 0.0)), strict=True):
        model.set_input("u", u)
        model.advance(start, end)
    expected = moved(ball_screw(), DELAY)
    assert model.x == pytest.approx(expected, rel=1e-8)
    assert np.abs(expected).max() > 0.0
