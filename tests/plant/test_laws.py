"""One suite that every friction law passes; a new one is in it by being in the list.

What a law promises stands beside it, in its `Claims`; here it is held to that. A promise that is
not made must be one that would be broken: a law that says it depends on the path only is run at
other speeds, and so is one that does not say it.
"""

import math
from functools import cache

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from prescribed_motion import motion_kernel, pieces, prescribed_friction, ways

from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.plant import LAWS
from ballscrew.plant.law import claims
from ballscrew.solver.component import symbol
from ballscrew.solver.kernel import Model

SPEEDS = (1e-4, 1e-3, 5e-3, 2e-2)
NEWTONS_PER_VOLT = 2 * math.pi * 1000 * 37.4e-3 / 21.4


def nominal(name):
    return {p.name: p.default for p in motion_kernel(name).parameters}


@cache
def compiled(expression):
    names = sorted(s.name for s in sp.sympify(expression).free_symbols)
    return names, sp.lambdify([symbol(n) for n in names], expression)


def evaluated(expression, values, velocity=0.0):
    names, function = compiled(expression)
    return function(*[(values | {"v": velocity})[n] for n in names])


def plant_of(name, kind="plant"):
    return kind if name == "modified_lugre" else f"{kind}_{name}"


@pytest.mark.parametrize("name", [n for n in LAWS if claims(n).steady_state is not None])
def test_a_constant_velocity_ends_at_the_steady_state(name):
    for velocity in (*SPEEDS, *(-v for v in SPEEDS)):
        time, v = pieces((velocity, max(2.0, 3e-3 / abs(velocity))))
        friction = prescribed_friction(name, time, v, tolerance=1e-10).outputs["friction"][-1]
        expected = float(evaluated(claims(name).steady_state, nominal(name), velocity))
        assert friction == pytest.approx(expected, rel=1e-6), velocity


@pytest.mark.ci
@pytest.mark.parametrize("name", [n for n in LAWS if claims(n).stiffness is not None])
@pytest.mark.parametrize("direction", [1, -1])
def test_a_small_push_from_rest_meets_the_stiffness(name, direction):
    """Pushed by a nanometre and held, so that nothing that depends on the speed is left."""
    time, v = pieces((direction * 1e-3, 1e-6), (0.0, 1e-6))
    course = prescribed_friction(name, time, v, tolerance=1e-11)
    expected = float(evaluated(claims(name).stiffness, nominal(name), direction))
    friction, x = course.outputs["friction"][-1], course.outputs["x"][-1]
    assert friction / x == pytest.approx(expected, rel=2e-4)
    if "z" in course.outputs:  # a smooth law has no deflection
        assert friction / course.outputs["z"][-1] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
@given(data=st.data())
@settings(max_examples=20, deadline=None)
def test_no_motion_gives_out_more_work_than_was_put_in(name, data):
    """Any jumps between any speeds above the declared one, any parameters that are declared fit."""
    values = {}
    for p in motion_kernel(name).parameters:
        damping = p.name.startswith("sigma1")
        factor = 10 ** data.draw(st.floats(-2, -0.3) if damping else st.floats(-0.3, 0.3))
        values[p.name] = min(max(p.default * factor, p.minimum), p.maximum)
    assume(bool(evaluated(claims(name).passive_if, values)))
    slowest = float(evaluated(claims(name).passive_above, values))
    legs = data.draw(
        st.lists(
            st.tuples(st.sampled_from([1, -1]), st.floats(0, 3), st.floats(-8, -3.5)),
            min_size=1,
            max_size=12,
        )
    )
    course = prescribed_friction(
        name,
        *ways(*((s * max(slowest, 1e-5) * 10**faster, 10**way) for s, faster, way in legs)),
        values,
    )
    work = course.outputs["work"]
    assert work.min() >= -1e-6 * work.max()


def there_and_back(name, pace):
    """Friction along one and the same path with two reversals, run through at `pace`."""
    time = np.linspace(0, 2 * np.pi, 801) / pace
    velocity = 2e-4 * pace * (np.sin(pace * time) + 0.7 * np.sin(3 * pace * time))
    # linear in between: the path is the same at any pace
    return prescribed_friction(name, time, velocity, tolerance=1e-9).outputs["friction"]


@pytest.mark.ci
@pytest.mark.parametrize("name", LAWS)
def test_the_pace_of_a_path_matters_if_and_only_if_it_is_said_to(name):
    slow, fast = there_and_back(name, 0.1), there_and_back(name, 30.0)
    difference = np.max(np.abs(fast - slow))
    if claims(name).follows_path_only:
        assert difference < 1e-6
    else:
        assert difference > 0.1


def loop_area(name, frequency):
    """Integral of F dv [N*m/s] over a cycle of Table 2.11's velocity; positive: higher on the way
    up."""
    w, n = 2 * np.pi * frequency, 1000
    time = 3.0 + np.linspace(0, 3 / frequency, 3 * n + 1)
    v = 1.5e-3 + 1e-3 * np.sin(w * (time - 3.0))
    course = prescribed_friction(name, np.r_[0.0, time], np.r_[1.5e-3, v], tolerance=1e-9)
    return np.trapezoid(course.outputs["friction"][-n - 1 :], v[-n - 1 :])


@pytest.mark.ci
@pytest.mark.parametrize("name", LAWS)
def test_friction_lags_behind_the_velocity_if_and_only_if_it_is_said_to(name):
    areas = [loop_area(name, frequency) for frequency in (0.1, 0.48, 2.0)]
    if claims(name).lags:
        assert areas[0] > 1e-6
        assert areas[1] > 2 * areas[0]
        assert areas[2] > 2 * areas[1]
    else:
        assert np.max(np.abs(areas)) < 1e-12


RAMP, SAMPLES = 12.0, 4000


def breakaway(name, rate):
    """First peak of the friction [N] while the motor's force grows by `rate` [N/s]; None: none."""
    model = Model(fmu_kernel(plant_of(name)))
    model.set_input("u_rate", rate / NEWTONS_PER_VOLT)
    last = 0.0
    for k in range(SAMPLES):
        start, end = (RAMP / rate * j / SAMPLES for j in (k, k + 1))
        model.advance(start, end)
        friction = model.outputs(end, model.x)["friction"]
        if friction < last - 1e-6:
            return last
        last = friction
    return None


@pytest.mark.ci
@pytest.mark.parametrize("name", LAWS)
def test_breakaway_force_falls_with_the_loading_rate_if_and_only_if_it_is_said_to(name):
    """From the slowest loading of the thesis' series to the fastest."""
    peaks = [breakaway(name, rate) for rate in (0.08, 8.0, 20.3)]
    if claims(name).breaks_away_sooner_when_loaded_faster:
        assert peaks[1] < 0.99 * peaks[0]
        assert peaks[2] < 0.99 * peaks[1]
    elif peaks[0] is not None:
        assert peaks == pytest.approx([peaks[0]] * 3, abs=RAMP / SAMPLES)
    else:
        assert peaks == [None] * 3
