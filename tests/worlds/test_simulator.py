"""The worlds' simulator against scipy's stiff solvers and against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from world_runs import PERIOD, drive, nominal_axis, run, swing
from worlds.axis import ELASTO_PLASTIC, LUGRE, MAXWELL, MODIFIED_LUGRE

# the simulators are compiled once
pytestmark = [pytest.mark.ci, pytest.mark.xdist_group("worlds")]


def interpolated(commands):
    """The command on lines between its values, at any time."""
    times = np.arange(commands.size) * PERIOD
    return lambda t: np.interp(t, times, commands)


def test_lugre_axis_follows_scipys_stiff_solver():
    par, commands = nominal_axis(), swing()
    par.ramped = 1.0
    u = interpolated(commands)

    def slope(t, y):
        _, v, z, i = y
        g = 1.284 + (2.35 - 1.284) * math.exp(-((v / 1.13975e-3) ** 2))
        dz = v - 66967.231 * abs(v) * z / g
        force = 66967.231 * z + 344.56 * dz + 173.0 * v
        return [v, par.kt * i - force, dz, (u(t) - 21.4 * i - par.ke * v) / 0.953e-3]

    times = np.arange(commands.size) * PERIOD
    oracle = solve_ivp(
        slope, (0, times[-1]), np.zeros(4), "LSODA", times, rtol=1e-9, atol=1e-13, max_step=1e-3
    )
    log = run(par, commands)
    assert np.abs(log["x"] - oracle.y[0]).max() < 2e-4 * np.ptp(oracle.y[0])
    assert np.abs(log["current"] - oracle.y[3]).max() < 2e-3 * np.ptp(oracle.y[3])


def test_two_bodies_follow_scipys_solver():
    spring = {"motor_mass": 0.5, "block_mass": 1.5, "spring": 4e4, "spring_damping": 6.0}
    par, commands = drive(**spring, sigma2=10.0, lag=2e-3, ramped=1.0), swing(120)
    u = interpolated(commands)

    def slope(t, y):
        x1, v1, x2, v2, late = y
        link = 4e4 * (x1 - x2) + 6.0 * (v1 - v2)
        return [v1, (late - link) / 0.5, v2, (link - 10 * v2) / 1.5, (u(t) - late) / 2e-3]

    times = np.arange(commands.size) * PERIOD
    oracle = solve_ivp(slope, (0, times[-1]), np.zeros(5), "Radau", times, rtol=1e-8, atol=1e-12)
    log = run(par, commands)
    assert np.abs(log["x"] - oracle.y[0]).max() < 1e-3 * np.ptp(oracle.y[0])


def test_a_constant_force_gives_a_parabola():
    log = run(drive(), np.full(200, 3.0))
    times = np.arange(200) * PERIOD
    assert log["x"] == pytest.approx(0.75 * times**2, abs=1e-9)


def test_coulomb_friction_brakes_evenly_and_then_holds():
    par = drive(Fc=1.0, Fs=1.0)
    log = run(par, np.where(np.arange(400) < 100, 3.0, 0.5))
    times = np.arange(400) * PERIOD
    speed, way = 0.1, 0.005  # after 0.1 s at (3 - 1)/2 m/s^2; then -0.25 m/s^2 for 0.4 s
    braking = (times >= 0.1) & (times < 0.4)
    since = times[braking] - 0.1
    assert log["x"][braking] == pytest.approx(way + speed * since - 0.125 * since**2, abs=1e-6)
    assert np.all(run(par, np.full(50, 0.9))["x"] == 0.0)


@pytest.mark.parametrize("law", [LUGRE, MODIFIED_LUGRE, ELASTO_PLASTIC, MAXWELL])
def test_every_law_slides_at_the_level_of_the_stribeck_curve(law):
    bristles = {"law": law, "sigma0": 1e5, "sigma1": 100.0, "Kv": 1e8}
    par = drive(block_mass=1.0, sigma2=20.0, Fc=1.0, Fs=2.0, Vs=0.05, **bristles)
    v = run(par, np.full(1500, 4.0))["v"][-1]
    assert 20 * v + 1 + math.exp(-((v / 0.05) ** 2)) == pytest.approx(4.0, rel=1e-3)
