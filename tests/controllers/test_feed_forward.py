"""Feed-forward of any controller: exact on a rigid mass with friction, and as it is written out."""

import linear_axis as la
import numpy as np
import pytest
import sympy as sp

from ballscrew.controllers import CONTROLLERS, tunable
from ballscrew.controllers.feed_forward import with_feed_forward
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.solver.component import TIME, State, symbol
from ballscrew.solver.errors import ContractError

COULOMB, SLOW = 1.284, 0.01  # N, m/s
NO_FORWARD = {"relay"}
LINEARIZING = {"iol", "iol_true_acceleration", "iol_observed"}
ADDED = [n for n in CONTROLLERS if n not in NO_FORWARD | LINEARIZING]
EXACT = {"Kvff": 1 / la.B, "Kaff": la.LAG / la.B, "Kfff": COULOMB * la.R / la.MOTOR, "Vff": SLOW}
TIMES = np.linspace(0.0, 1.5, 301)
COURSE = sp.Rational(1, 100) * (1 - sp.cos(4 * TIME))


def rubbing(plant):
    """The axis with Coulomb friction whose sign is smooth, so that an inverse can be exact."""
    v = symbol("v")
    friction = COULOMB * v / sp.sqrt(v**2 + SLOW**2)
    x, speed, i = plant.states
    slowed = State(
        "v", "m/s", "velocity", speed.derivative - friction * la.B * la.R / la.MOTOR / la.LAG
    )
    return plant.substituted({}, states=(x, slowed, i))


def wanted(t):
    """Position, velocity and acceleration of the set-point, typed apart from `COURSE`."""
    return 0.01 * (1 - np.cos(4 * t)), 0.04 * np.sin(4 * t), 0.16 * np.cos(4 * t)


@pytest.mark.parametrize("name", ["pid", "nctf"])
def test_with_the_exact_values_nothing_is_left_of_the_error(name):
    law = la.following(component(f"{name}+feed_forward"), COURSE)
    run = la.loop(rubbing(la.rigid()), law, **EXACT).simulate(TIMES)
    np.testing.assert_allclose(run.outputs["x"], wanted(TIMES)[0], atol=1e-10)
    without = la.loop(rubbing(la.rigid()), la.following(component(name), COURSE)).simulate(TIMES)
    assert np.abs(without.outputs["x"] - wanted(TIMES)[0]).max() > 1e-4


@pytest.mark.ci
@pytest.mark.parametrize("name", ADDED)
def test_what_is_added_to_the_command_is_that_of_the_axis(name):
    """Where the axis moves as desired, beside its own command at rest; typed apart."""
    law, forward = component(name), component(f"{name}+feed_forward")
    values = {p.name: p.default for p in forward.all_parameters} | {"u_max": 1e6, "Vff": SLOW}
    values |= {"sample_time": 1e-3}
    v_d, a_d = 0.03, -0.4
    at = {s.name: 0.0 for s in (*law.all_states, *law.discrete)}
    rest = at | {i.name: 0.0 for i in forward.inputs}
    onward = rest | {"v": v_d, "v_d": v_d, "a_d": a_d}
    added = command(forward, values, onward) - command(law, values, onward)
    expected = values["Kvff"] * v_d + values["Kaff"] * a_d
    expected += values["Kfff"] * v_d / np.hypot(v_d, SLOW)
    known = values.get("Kd", values.get("Kv", 0.0))
    if name in ("pid_dob", "pid_lugre", "adaptive_friction"):  # the damping alone is of v - v_d
        expected += known * v_d
    elif name not in ("p_pi", "pid_sampled"):  # v - v_d is zero, as at rest
        expected += command(law, values, rest) - command(law, values, onward)
    assert added == pytest.approx(expected, rel=1e-9)


def command(law, values, signals):
    (output,) = law.outputs
    value = {symbol(d.name): d.update for d in law.discrete}.get(output.value, output.value)
    numbers = {symbol(n): v for n, v in (values | signals).items()}
    return float(sp.sympify(value).xreplace(numbers).evalf())


@pytest.mark.ci
@pytest.mark.parametrize("name", sorted(LINEARIZING))
def test_a_linearizing_law_gets_its_demand_s_own_terms(name):
    """Written out: u changes by (k1 v_d + k2 a_d)/gain, where k0 x_d changes it by k0 x_d/gain."""
    law, forward = component(name), component(f"{name}+feed_forward")
    assert forward.parameters == law.parameters
    assert tunable(f"{name}+feed_forward") == tunable(name)
    values = {p.name: p.default for p in forward.all_parameters}
    at = {s.name: 0.0 for s in (*law.all_states, *law.discrete)}
    at |= {i.name: 0.0 for i in forward.inputs}
    by_position = command(forward, values, at | {"x_d": 1e-6}) / 1e-6 / values["k0"]
    added = command(forward, values, at | {"v_d": 3e-6, "a_d": -7e-6})
    assert added == pytest.approx(by_position * (3e-6 * values["k1"] - 7e-6 * values["k2"]))


def test_a_law_that_gives_levels_or_has_no_set_point_is_refused():
    with pytest.raises(ContractError, match="relay cannot have feed-forward; expected"):
        component("relay+feed_forward")
    with pytest.raises(ContractError, match="plant cannot have feed-forward"):
        with_feed_forward(component("plant"))
