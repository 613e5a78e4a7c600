"""Each law's command, rates and gains, at random signals, against its formula written out here."""

import math

import linear_axis as la
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from ballscrew.controllers.fuzzy_pd_i import PEAKS, RULES, fuzzy_pd_i
from ballscrew.controllers.lqi import lq_design, rest_sliding
from ballscrew.controllers.p_pi import VELOCITY_TIME, cascade
from ballscrew.controllers.pid import simc
from ballscrew.orchestration.loop.catalogue import component, fmu_kernel
from ballscrew.solver.codegen import generate
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


# -- gains by their rules ------------------------------------------------------------------------


def test_simc_gains_follow_the_rule_for_an_integrating_process_with_a_lag():
    assert pytest.approx(0.00398, rel=2e-3) == la.B  # m/s per volt, as 30 V give 0.119 m/s
    time, g = 0.6 + la.L / la.R, simc()
    assert g.proportional == pytest.approx(1 / (la.B * time) * (1 + la.LAG / (4 * time)))
    assert g.integral == pytest.approx(1 / (la.B * time) / (4 * time))
    assert g.derivative == pytest.approx(la.LAG / (la.B * time))


def test_sampled_pid_does_the_difference_equation_at_its_samples():
    model, gains = Model(generate(component("pid_sampled"))), simc()
    integral, last = 0.0, 0.0
    for k, position in enumerate([0.0, 0.001, 0.003, 0.002]):
        model.set_input("x", position)
        model.set_input("x_d", 0.08)
        model.sample(k * 1e-3)
        error, speed, last = 0.08 - position, (position - last) / 1e-3, position
        integral += 1e-3 * error
        expected = gains.proportional * error + gains.integral * integral - gains.derivative * speed
        assert model.outputs(k * 1e-3, model.x)["u"] == pytest.approx(expected, rel=1e-12)


def test_gains_of_the_cascade_place_the_poles_that_the_rule_says():
    """The PI cancels the lag, so the speed follows like 1/(T s + 1), and T s^2 + s + Kx = 0."""
    time, gains = VELOCITY_TIME + la.L / la.R, cascade()
    assert gains.proportional == pytest.approx(la.LAG / (la.B * time), rel=1e-12)
    assert gains.integral == pytest.approx(1 / (la.B * time), rel=1e-12)
    assert gains.position == pytest.approx(1 / (4 * VELOCITY_TIME), rel=1e-12)


def test_the_riccati_solution_has_the_stable_eigenvalues_of_the_hamiltonian():
    """Of the plant's equations in sliding, which are those of the linear axis."""
    for derived, by_hand in zip(rest_sliding(), la.matrices(), strict=True):
        np.testing.assert_allclose(derived, by_hand, rtol=1e-12, atol=1e-9)
    design, weight = lq_design(), 1 / 36.0**2  # of the voltage
    a, b = design.dynamics, design.effect
    wanted = np.linalg.eigvals(np.block([[a, -b @ b.T / weight], [-design.weights, -a.T]]))
    wanted = np.sort_complex(wanted[wanted.real < 0])
    found = np.sort_complex(np.linalg.eigvals(a - b @ design.gains[None]))
    np.testing.assert_allclose(found, wanted, rtol=1e-5)


def test_the_fuzzy_surface_is_bilinear_between_its_nodes_and_stays_beyond_them():
    """The rule table at its nodes, over a scaled error and a scaled speed reversed."""
    own = {p.name: p.default for p in fuzzy_pd_i().parameters}
    model, random = Model(fmu_kernel("fuzzy_pd_i")), np.random.default_rng(0)
    nodes = [float(p) for p in PEAKS]
    table = RegularGridInterpolator((nodes, nodes), np.array(RULES, dtype=float))
    for e, s in random.uniform(-1.5, 1.5, (300, 2)):
        model.set_input("x_d", e * own["range_e"])
        model.set_input("v", -s * own["range_v"])
        wanted = own["full"] * table(np.clip([e, s], -1, 1))[0]
        assert model.outputs(0.0, model.x)["u"] == pytest.approx(wanted, abs=1e-9)
