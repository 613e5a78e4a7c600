"""A readable FMU whose equations were edited runs what they say now."""

import numpy as np
import pytest
import sympy as sp
from any_fmu import Host, repacked
from scipy.integrate import solve_ivp

from ballscrew import Component, Delay, DiscreteState, Event, Input, Mode, Output, Parameter, State
from ballscrew.solver.component import symbol

X, V, U, S, LATE = map(symbol, ("x", "v", "u", "s", "late"))
STEP, STEPS = 0.05, 40


@pytest.fixture(scope="module")
def swing(written):
    """A damped swing, pulled at."""
    component = Component(
        "swing",
        "A swing",
        inputs=(Input("u", "N", "pull"),),
        states=(State("x", "m", "place", V), State("v", "m/s", "speed", U - 9 * sp.sin(X) - V / 4)),
        outputs=(Output("x", "m", "place", X),),
    )
    return written(component, "readable")


def edited(path, folder, *changes):
    """As a user would: unzip, edit the equations, zip."""

    def edit(name, data):
        if not name.startswith("resources/equations_"):
            return data
        text = data.decode()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        return text.encode()

    return repacked(path, folder / "edited.fmu", edit)


def course(path):
    """Places at the ends of steps under a constant pull, and what the FMU logs."""
    host = Host(path, {"u": 1.0})
    found = []
    for k in range(STEPS):
        host.step(k * STEP, STEP)
        found += host.get("x")
    host.close()
    return np.array(found), " ".join(host.heard)


def by_scipy(spring):
    times = STEP * np.arange(1, STEPS + 1)
    solved = solve_ivp(
        lambda t, y: [y[1], 1.0 - spring(y[0]) - y[1] / 4],
        (0.0, times[-1]),
        [0.0, 0.0],
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
    )
    return solved.y[0]


def test_edited_equations_are_run_though_their_slopes_were_left(swing, tmp_path):
    exported, said = course(swing)
    assert "edited" not in said
    assert exported == pytest.approx(by_scipy(lambda x: 9 * np.sin(x)), abs=1e-6)
    path = edited(swing, tmp_path, ("math.sin(x_)", "math.sinh(50*x_)"))
    found, said = course(path)
    assert "was edited; it runs as it is now" in said
    assert found == pytest.approx(by_scipy(lambda x: 9 * np.sinh(50 * x)), abs=1e-6)
    # the one as exported is not taken for it, in the same process
    assert np.array_equal(course(swing)[0], exported)


def test_edited_events_delays_and_samples_are_run(written, tmp_path):
    """A ball that falls, bounces once, and counts a command; by hand."""
    ball = Component(
        "ball",
        "A ball",
        inputs=(Input("u", "1", "command"),),
        states=(
            State("x", "m", "height", V, start=1.0),
            State("v", "m/s", "speed", sp.Integer(-2)),
        ),
        outputs=(Output("x", "m", "height", X), Output("y", "1", "sum", S + LATE)),
        modes=(Mode("free", events=(Event("floor", -X, 1, {"v": -V / 2}),)),),
        delays=(Delay("late", U, sp.Float(0.1)),),
        discrete=(DiscreteState("s", "1", "sum", S + U),),
        sample_time=Parameter("period", 0.25, "s", "period", "made up"),
    )
    changes = [("dx[1] = -2.0", "dx[1] = -8.0 if t < 9 and not u[0] > 2 else 5.0")]
    changes += [("-0.5*v_", "-v_/4"), ("s_ + u_", "s_ + 3*u_"), ("e[1] = 0.1", "e[1] = 0.2")]
    path = edited(written(ball, "readable"), tmp_path, *changes)
    host, seen = Host(path, {"u": 1.0}), []
    for k in range(70):
        host.step(0.01 * k, 0.01)
        seen.append(host.get("x", "y"))
    host.close()
    assert seen[39] == pytest.approx([1 - 4 * 0.4**2, 6 + 1], abs=1e-6)
    assert seen[14][1] == 3.0  # the command is not there yet
    # on the floor after 0.5 s with 4 m/s, back with 1 m/s
    assert seen[69] == pytest.approx([0.2 - 4 * 0.2**2, 9 + 1], abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("math.sin(x_)", "math.sin(x_", "cannot be run: '(' was never closed"),
        ("math.sin(x_)", "sin(x_)", "line 11 has 'sin(x_)'; expected elements of the given"),
        ("math.sin(x_)", "math.sin(y_)", "line 11 has 'y_'"),
        ("math.sin(x_)", "x[2]", "line 11 has 'x[2]'"),
        ("math.sin(x_)", "(x_ or 1.0)", "line 11 has 'x_'"),
        ("dx[0] =", "for k in range(2): dx[k] =", "has 'for k in range(2):'"),
        ("dx[0] =", "dx[0] +=", "has 'dx[0] += v_'"),
        ("x_ = x[0]", "if t > 1:\n        x_ = x[0]", "line 12 has 'x_'"),
        ("def sample(", "def samples(", "the function 'sample' is missing"),
    ],
)
def test_what_cannot_be_run_is_one_line(swing, tmp_path, old, new, words):
    host = Host(edited(swing, tmp_path, (old, new)), {"u": 1.0})
    with pytest.raises(Exception, match="DoStep"):
        host.step(0.0, STEP)
    assert words in host.message()
    assert "\n" not in host.message()
    assert np.isnan(host.get("x"))
    host.fmu.setFMUState(host.fmu.getFMUState())
    host.close()
