"""Each law's command and rates, at random signals, against its formula written out here."""

import math

import numpy as np
import pytest

from ballscrew.orchestration.loop.catalogue import component, fmu_kernel
from ballscrew.solver.kernel import Model

TURN = 2 * math.pi * 1000.0
U_MAX = 36.0


def bounded(value, size=U_MAX):
    return min(max(value, -size), size)


def tracked(rate, asked, p):
    """Command and rate of the integral, whose anti-windup follows what the limit cuts off."""
    return bounded(asked), rate + (bounded(asked) - asked) / p["Tt"]


def pid_part(p, s):
    return p["Kp"] * (s["x_d"] - s["x"]) + s["w"] - p["Kd"] * s["v"]


def pid_dob(p, s):
    asked = pid_part(p, s) - s["q"] - p["lag"] / (p["b"] * p["Tq"]) * s["v"]
    u, w = tracked(p["Ki"] * (s["x_d"] - s["x"]), asked, p)
    return u, {"w": w, "q": ((1 - p["lag"] / p["Tq"]) * s["v"] / p["b"] - u - s["q"]) / p["Tq"]}


def adaptive_friction(p, s):
    """The estimated friction is added to the command in the direction of motion."""
    sign = s["v"] / math.hypot(s["v"], p["slow"])
    estimate = s["y"] - p["rate"] * p["m"] * s["v"] ** 2 / 2
    per_ampere = p["kt"] * TURN
    asked = pid_part(p, s) + estimate * sign * p["R"] / per_ampere
    u, w = tracked(p["Ki"] * (s["x_d"] - s["x"]), asked, p)
    total = per_ampere * s["i"] - p["sigma2"] * s["v"]
    return u, {"w": w, "y": p["rate"] * s["v"] * (total - estimate * sign)}


def pid_lugre(p, s):
    """The observed bristles' force is added; the correction fades near static friction."""
    error = s["x_d"] - s["x"]
    v, z, s0 = s["v"], s["z_hat"], p["sigma0_hat"]
    sign = 2 / math.pi * math.atan(p["Kv"] * v)
    level = p["Fc_hat"] + (p["Fs_hat"] - p["Fc_hat"]) * math.exp(-((v / p["Vs_hat"]) ** 2))
    room = 1 - math.copysign(1.0, error) * s0 * z / p["Fs_hat"]
    rate = sign**2 * v - s0 * sign * v / level * z + p["k"] * error * min(max(10 * room, 0.0), 1.0)
    asked = pid_part(p, s) + (s0 * z + p["sigma1_hat"] * rate) / p["force_per_volt"]
    u, w = tracked(p["Ki"] * error, asked, p)
    return u, {"w": w, "z_hat": rate}


def p_pi(p, s):
    off = p["Kx"] * (s["x_d"] - s["x"]) + s["v_d"] - s["v"]
    asked = p["Kp"] * off + s["w"] + p["Fv"] * s["v_d"] + p["Fa"] * s["a_d"]
    u, w = tracked(p["Ki"] * off, asked, p)
    return u, {"w": w}


def lqi(p, s):
    error = s["x_d"] - s["x"]
    asked = p["Kx"] * error - p["Kv"] * s["v"] - p["Kc"] * s["i"] + s["w"]
    u, w = tracked(p["Ki"] * error, asked, p)
    return u, {"w": w}


def on_the_surface(p, s):
    """The voltage that keeps s = v + slope (x - x_d), and s."""
    keeps = (1 - p["slope"] * p["lag"]) * s["v"] / p["b"]
    return keeps, s["v"] + p["slope"] * (s["x"] - s["x_d"])


def sliding_mode(p, s):
    keeps, off = on_the_surface(p, s)
    return bounded(keeps - p["level"] * bounded(off / p["layer"], 1.0)), {}


def super_twisting(p, s):
    keeps, off = on_the_surface(p, s)
    volts = p["lag"] / p["b"]
    root = off / math.sqrt(max(abs(off), p["layer"]))
    asked = keeps - volts * p["k1"] * math.sqrt(p["C"]) * root + s["w"]
    switched = p["k2"] * p["C"] * bounded(off / p["layer"], 1.0)
    u, w = tracked(-volts * switched, asked, p)
    return u, {"w": w}


def nctf(p, s):
    off = -p["h"] * math.tanh(p["c"] * (s["x"] - s["x_d"])) - s["v"]
    return p["Kp"] * off + p["Ki"] * s["w"], {"w": off}


def pid(p, s):
    error = s["x_d"] - s["x"]
    return p["Kp"] * error + p["Ki"] * s["w"] - p["Kd"] * s["v"], {"w": error}


LAWS = (pid, nctf, p_pi, lqi, sliding_mode, super_twisting, pid_dob, pid_lugre, adaptive_friction)
SIZES = {"x": 0.01, "x_d": 0.01, "v": 0.02, "v_d": 0.02, "a_d": 0.3, "i": 0.3, "z": 1e-5}
OF_STATES = {"w": 3.0, "q": 3.0, "y": 1.0, "z_hat": 2e-5}


@pytest.mark.parametrize("law", LAWS, ids=lambda f: f.__name__)
def test_command_and_rates_are_those_of_the_formula(law):
    values = {p.name: p.default for p in component(law.__name__).all_parameters}
    model, random = Model(fmu_kernel(law.__name__)), np.random.default_rng(1)
    for _ in range(60):
        size = 10 ** random.uniform(-1, 1)  # so that some are limited
        given = {i.name: size * SIZES[i.name] * random.normal() for i in model.kernel.inputs}
        inside = {s.name: OF_STATES[s.name] * random.normal() for s in model.kernel.states}
        for name, value in given.items():
            model.set_input(name, value)
        model.x[:] = list(inside.values())
        u, rates = law(values, given | inside)
        assert model.outputs(0.0, model.x)["u"] == pytest.approx(u, rel=1e-9, abs=1e-12)
        found = dict(zip(inside, model.derivatives(0.0, model.x), strict=True))
        assert found == pytest.approx(rates, rel=1e-9, abs=1e-12)
