"""A command on its way against an exact delay, by frequency and by moment."""

import numpy as np
import pytest
import sympy as sp

from ballscrew.instruments.late_command import ORDER, with_late_command
from ballscrew.plant.ball_screw import ball_screw
from ballscrew.solver.component import Parameter, symbol

DELAY = 3e-4
PARAMETER = Parameter("delay", DELAY, "s", "of the command", "example value", minimum=1e-7)


@pytest.fixture(scope="module")
def line():
    """The linear system from the command to what arrives, as matrices."""
    plain = ball_screw()
    late = with_late_command(plain, PARAMETER)
    parts = [symbol(f"u_late{k}") for k in range(1, ORDER + 1)]
    rates = sp.Matrix([late.derivative(s.name) for s in parts]).subs(symbol("delay"), DELAY)
    per_volt = sp.diff(plain.derivative("i"), symbol("u"))
    arrives = (late.derivative("i") - plain.derivative("i").subs(symbol("u"), 0)) / per_volt
    a = np.array(rates.jacobian(parts), dtype=float)
    b = np.array(rates.jacobian([symbol("u")]), dtype=float)
    c = np.array(sp.Matrix([sp.expand(arrives)]).jacobian(parts), dtype=float)
    return a, b, c


def response(line, frequency):
    a, b, c = line
    return (c @ np.linalg.solve(1j * frequency * np.eye(ORDER) - a, b))[0, 0]


@pytest.mark.parametrize(("angle", "wrong"), [(0.0, 1e-12), (1.0, 1e-8), (2.0, 1e-5), (4.0, 2e-3)])
def test_it_is_late_by_the_delay_and_nothing_else(line, angle, wrong):
    exact = np.exp(-1j * angle)
    assert abs(response(line, angle / DELAY) - exact) < wrong


def test_a_jump_arrives_on_average_after_the_delay(line):
    a, b, c = line
    moment = (c @ np.linalg.solve(a @ a, b))[0, 0]  # of the impulse response
    assert moment == pytest.approx(DELAY, rel=1e-9)


def test_nothing_arrives_at_once_and_the_line_forgets(line):
    late = with_late_command(ball_screw(), PARAMETER)
    assert symbol("u") not in late.derivative("i").free_symbols
    assert np.linalg.eigvals(line[0]).real.max() < -1 / DELAY


def test_a_feedback_law_stays_at_the_command():
    assert with_late_command(ball_screw(), PARAMETER).inputs == ball_screw().inputs
