"""The plant against its printed equations, its two friction laws against each other."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.plant.ball_screw import ball_screw
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model

NOMINAL = {
    "kt": 37.4e-3,
    "ke": 0.0374482,
    "L": 0.953e-3,
    "R": 21.4,
    "p": 1000.0,
    "m": 1.0,
    "Jm": 0.0,
    "sigma0": 66967.231,
    "sigma1": 344.56,
    "sigma2": 173.0,
    "Fc": 1.284,
    "Fs": 2.35,
    "Vs": 1.13975e-3,
    "Kv": 1e8,
}


@pytest.fixture(scope="module")
def smooth():
    return generate(ball_screw())


def printed(x, v, i, z, u, q=NOMINAL):
    """Eqs. 3.11-3.16, typed from the thesis."""
    s = 2 / math.pi * math.atan(q["Kv"] * v)
    g = q["Fc"] + (q["Fs"] - q["Fc"]) * math.exp(-((v / q["Vs"]) ** 2))
    angle = 2 * math.pi * q["p"]
    dz = s**2 * v - q["sigma0"] * s * v / g * z
    force = q["sigma0"] * z + q["sigma1"] * dz + q["sigma2"] * v
    mass = q["m"] + q["Jm"] * angle**2
    dv = (q["kt"] * angle * i - force) / mass
    di = (u - q["R"] * i - q["ke"] * angle * v) / q["L"]
    return {"x": v, "v": dv, "i": di, "z": dz}, force


def test_defaults_are_the_printed_values(smooth):
    for p in smooth.parameters:
        assert p.default == pytest.approx(NOMINAL[p.name], rel=1e-5), p.name


@given(
    v=st.one_of(st.floats(-0.2, 0.2), st.floats(-1e-7, 1e-7)),
    z=st.floats(-4e-5, 4e-5),
    i=st.floats(-2, 2),
    u=st.floats(-40, 40),
    rotor=st.sampled_from([0.0, 4.2e-7]),
)
@settings(max_examples=100, deadline=None)
def test_right_hand_side_is_the_printed_one(smooth, v, z, i, u, rotor):
    ke = next(p.default for p in smooth.parameters if p.name == "ke")
    model = Model(smooth, {"Jm": rotor})
    model.set_input("u", u)
    values = {"x": 0.01, "v": v, "i": i, "z": z}
    state = np.array([values[s.name] for s in smooth.states])
    expected, force = printed(**values, u=u, q=NOMINAL | {"Jm": rotor, "ke": ke})
    computed = model.derivatives(0.0, state)
    for s, value in zip(smooth.states, computed, strict=True):
        assert value == pytest.approx(expected[s.name], rel=1e-9, abs=1e-9), s.name
    assert model.outputs(0.0, state)["friction"] == pytest.approx(force, rel=1e-9, abs=1e-12)
