"""Exponents of delays against Lambert's W, and verdicts against what is known of the equations."""

import numpy as np
import pytest
import sympy as sp
from scipy.special import lambertw

from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, Delay, Output, Parameter, State, symbol
from ballscrew.solver.for_tangents import with_delay_states
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import follow_returns, follow_tangents

X, LATE = symbol("x"), symbol("late")


def scalar(rate, tau, start=1.0):
    return Component(
        "scalar",
        "one state with a delay",
        parameters=(Parameter("tau", tau, "s", "delay", "made up"),),
        states=(State("x", "1", "x", sp.sympify(rate), start=start),),
        outputs=(Output("x", "1", "x", X),),
        delays=(Delay("late", X, symbol("tau"), start=start),),
    )


def real_parts(a, b, tau, count):
    """The largest real parts of the roots of s = a + b exp(-s tau), by Lambert's W."""
    branches = range(-30, 31)
    roots = [lambertw(b * tau * np.exp(-a * tau), k) / tau + a for k in branches]
    return np.sort(np.real(roots))[::-1][:count]


CASES = [
    (-0.4, -7.0, 0.3),
    *(pytest.param(*c, marks=pytest.mark.ci) for c in [(0.0, -1.0, 1.0), (-1.0, 0.5, 2.0)]),
]


@pytest.mark.parametrize(("a", "b", "tau"), CASES)
def test_leading_eigenvalues_are_those_of_lamberts_w(a, b, tau):
    model = Model(generate(with_delay_states(scalar(a * X + b * LATE, tau))))
    found = np.sort(np.linalg.eigvals(model.jacobian(0.0, model.x)).real)[::-1]
    assert found[:3] * tau == pytest.approx(real_parts(a, b, tau, 3) * tau, abs=1e-7)


def test_what_has_delays_is_not_followed_as_if_it_had_none():
    model = Model(generate(scalar(-LATE, 1.0)))
    told = "scalar has the delayed signal late; expected it among the states, by with_delay_states"
    with pytest.raises(ValueError, match=told):
        follow_tangents(model, [0.0, 1.0])
    with pytest.raises(ValueError, match=told):
        follow_returns(model, 0.0, 1.0, 0, 0.0, 3)
