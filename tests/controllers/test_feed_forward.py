"""Feed-forward of any controller: exact on a rigid mass with friction, and as by SciPy's hand."""

import linear_axis as la
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from ballscrew.controllers import CONTROLLERS, tunable
from ballscrew.controllers.feed_forward import with_feed_forward
from ballscrew.fmus.catalogue import component
from ballscrew.instruments.sample_and_hold import sampled
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_motions import move, sine
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.orchestration.whole_loop import run_monolithic
from ballscrew.solver.component import TIME, State, symbol
from ballscrew.solver.contract_error import ContractError

COULOMB, SLOW = 1.284, 0.01  # N, m/s
NO_FORWARD = {"relay"}
LINEARIZING = {"iol", "iol_true_acceleration", "iol_observed", "iol_sampled"}
ADDED = [n for n in CONTROLLERS if n not in NO_FORWARD | LINEARIZING]
EXACT = {
    "Kvff": 1 / la.B,
    "Kaff": la.LAG / la.B,
    "Kfff": COULOMB * la.R / la.MOTOR,
    "Vff": SLOW,
}
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


def own_rate(v, u):
    return (la.B * (u - COULOMB * v / np.hypot(v, SLOW) * la.R / la.MOTOR) - v) / la.LAG


def own_command(t, x, v, w, values):
    x_d, v_d, a_d = wanted(t)
    forward = values["Kvff"] * v_d + values["Kaff"] * a_d
    forward += values["Kfff"] * v_d / np.hypot(v_d, values["Vff"])
    pid = values["Kp"] * (x_d - x) + values["Ki"] * w - values["Kd"] * (v - v_d)
    return pid + forward


WRONG = {
    **{n: share * EXACT[n] for n, share in (("Kvff", 0.8), ("Kaff", 1.5), ("Kfff", 0.7))},
    "Vff": 0.004,
    "Kp": 2000.0,
    "Ki": 3000.0,
    "Kd": 90.0,
}


@pytest.mark.parametrize("name", ["pid", "nctf", "super_twisting", "fuzzy_pd_i"])
def test_with_the_exact_values_nothing_is_left_of_the_error(name):
    law = la.following(component(f"{name}+feed_forward"), COURSE)
    run = la.loop(rubbing(la.rigid()), law, **EXACT).simulate(TIMES)
    np.testing.assert_allclose(run.outputs["x"], wanted(TIMES)[0], atol=1e-10)
    without = la.loop(rubbing(la.rigid()), la.following(component(name), COURSE)).simulate(TIMES)
    assert np.abs(without.outputs["x"] - wanted(TIMES)[0]).max() > 1e-4


def test_p_pi_is_exact_without_its_own():
    law = la.following(component("p_pi+feed_forward"), COURSE)
    run = la.loop(rubbing(la.rigid()), law, Fv=0.0, Fa=0.0, **EXACT).simulate(TIMES)
    np.testing.assert_allclose(run.outputs["x"], wanted(TIMES)[0], atol=1e-10)


def test_with_other_values_it_runs_as_in_scipy():
    law = la.following(component("pid+feed_forward"), COURSE)
    run = la.loop(rubbing(la.rigid()), law, **WRONG).simulate(TIMES)

    def rates(t, y):
        x, v, w = y
        return [v, own_rate(v, own_command(t, x, v, w, WRONG)), wanted(t)[0] - x]

    own = solve_ivp(rates, (0, TIMES[-1]), [0, 0, 0], "LSODA", TIMES, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(run.outputs["x"], own.y[0], atol=1e-9)
    assert np.abs(own.y[0] - wanted(TIMES)[0]).max() > 1e-5


def test_sampled_it_runs_as_in_scipy():
    """The command is computed at the instants, of the set-point and its derivatives there."""
    law = sampled(with_feed_forward(component("pid")))
    period, stop = 1e-3, 0.3
    times = np.arange(round(stop / period) + 1) * period
    loop = Loop(law, rubbing(la.rigid()), sine(0.02, 2 / np.pi), stop, controller_values=WRONG)
    run = run_monolithic(loop, period)
    y, positions = np.zeros(3), [0.0]
    for t in times[:-1]:
        u, error = own_command(t, *y, WRONG), wanted(t)[0] - y[0]

        def rates(s, y, u=u, error=error):
            return [y[1], own_rate(y[1], u), error]

        y = solve_ivp(rates, (t, t + period), y, "LSODA", rtol=1e-11, atol=1e-13).y[:, -1]
        positions.append(y[0])
    np.testing.assert_allclose(run.outputs["x"], positions, atol=1e-9)


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
    elif name not in ("p_pi", "pid_sampled", "pid_encoder"):  # v - v_d is zero, as at rest
        expected += command(law, values, rest) - command(law, values, onward)
    assert added == pytest.approx(expected, rel=1e-9)


def command(law, values, signals):
    (output,) = law.outputs
    value = {symbol(d.name): d.update for d in law.discrete}.get(output.value, output.value)
    numbers = {symbol(n): v for n, v in (values | signals).items()}
    return float(sp.sympify(value).xreplace(numbers).evalf())


def test_an_integral_and_an_observer_are_told_the_whole_command_at_the_limit():
    """dw/dt and dq/dt of the DOB beside the formulas of its page with the limited command."""
    law = component("pid_dob+feed_forward")
    values = {p.name: p.default for p in law.all_parameters} | {"u_max": 24.0}
    random = np.random.default_rng(3)
    for _ in range(50):
        v, w, q, x, x_d, v_d, a_d = random.normal(size=7) * (0.1, 9, 9, 0.02, 0.02, 0.1, 5)
        signals = {"v": v, "w": w, "q": q, "x": x, "x_d": x_d, "v_d": v_d, "a_d": a_d}
        numbers = {symbol(n): value for n, value in (values | signals).items()}
        rates = {
            s.name: float(sp.sympify(s.derivative).xreplace(numbers).evalf()) for s in law.states
        }
        b, lag, tq = (values[n] for n in ("b", "lag", "Tq"))
        asked = values["Kp"] * (x_d - x) + w - values["Kd"] * (v - v_d) - q - lag / (b * tq) * v
        asked += values["Kvff"] * v_d + values["Kaff"] * a_d
        asked += values["Kfff"] * v_d / np.hypot(v_d, values["Vff"])
        given = min(max(asked, -24.0), 24.0)
        assert command(law, values, signals) == pytest.approx(given, rel=1e-9, abs=1e-9)
        tracked = values["Ki"] * (x_d - x) + (given - asked) / values["Tt"]
        assert rates["w"] == pytest.approx(tracked, rel=1e-9, abs=1e-6)
        disturbance = ((1 - lag / tq) * v / b - given - q) / tq
        assert rates["q"] == pytest.approx(disturbance, rel=1e-9, abs=1e-6)


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


def test_ranges_are_those_of_the_law_and_hold_the_defaults():
    for name in ADDED:
        known = {p.name: p for p in component(f"{name}+feed_forward").all_parameters}
        ranges = tunable(f"{name}+feed_forward")
        assert set(ranges) == {*tunable(name), "Kvff", "Kaff", "Kfff"}
        for parameter, (low, high) in ranges.items():
            assert low <= known[parameter].default <= high


def test_a_law_that_gives_levels_or_has_no_set_point_is_refused():
    with pytest.raises(ContractError, match="relay cannot have feed-forward; expected"):
        component("relay+feed_forward")
    with pytest.raises(ContractError, match="plant cannot have feed-forward"):
        with_feed_forward(component("plant"))


def test_over_fmus_it_runs_as_in_one_solver():
    """As exported FMUs, joined by the master, on the axis with its friction."""
    motion = move(0.01, start=0.05, dwell=0.05, back=0.0)
    loop = Loop("pid+feed_forward", reference=motion, stop=0.3, step=1e-4)
    alone = run_monolithic(loop, 1e-4)
    over = run_closed_loop(loop).run
    position = np.interp(alone.time, over.time, over.outputs["x"])
    np.testing.assert_allclose(position, alone.outputs["x"], atol=1e-7)
    assert np.abs(alone.outputs["x"] - motion.on(alone.time, 0)).max() < 2e-5
