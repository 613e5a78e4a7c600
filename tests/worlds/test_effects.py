"""Every effect does what its name says, seen in the simulator's own log."""

from __future__ import annotations

import math

import numpy as np
import pytest
from world_runs import PERIOD, drive, nominal_axis, run, swing
from worlds.axis import ELASTO_PLASTIC, LUGRE, MAXWELL, changed

# the simulators are compiled once
pytestmark = [pytest.mark.ci, pytest.mark.xdist_group("worlds")]


def to_and_fro(count=1500):
    t = np.arange(count) * PERIOD
    return 6 * np.sin(2 * math.pi * 2 * t) * (1 + 0.3 * np.sin(2 * math.pi * 0.7 * t))


def need(changes, par=None, commands=None, column="need"):
    """What the command gives and the motion does not need, with the motion's log."""
    if par is None:  # a slide with Coulomb friction
        par = drive(sigma2=20.0, Fc=1.0, Fs=1.5, Vs=0.01, travel=0.05, duration=1.5)
    commands = to_and_fro() if commands is None else commands
    log = run(changed(par, changes), commands, double=par, substeps=50)
    return log[column], log


def sliding(log):
    """Samples well away from rest."""
    return np.abs(log["v"]) > 0.02


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, lambda x, v, a: 0 * x),
        ({"asymmetry": 0.2}, lambda x, v, a: 0.2 + 0 * x),  # of 1 N, the same sign both ways
        ({"motor_mass": 0.5}, lambda x, v, a: 0.5 * a),
        ({"load": 0.3}, lambda x, v, a: 0.3 + 0 * x),  # against the positive way
        ({"trend": 0.3}, lambda x, v, a: 0.3 * x / 0.05 * np.sign(v)),
        ({"quadratic": 5.0}, lambda x, v, a: 5 * v * abs(v)),
        ({"cubic": 30.0}, lambda x, v, a: 30 * v**3),
        ({"root": 1.0}, lambda x, v, a: np.sign(v) * np.sqrt(abs(v))),
        ({"thinning": 3.0}, lambda x, v, a: 20 * v / (1 + 3 * abs(v)) - 20 * v),
        (  # flips with the direction
            {"periodic": 0.3, "period": 0.004, "period_phase": 0.4},
            lambda x, v, a: 0.3 * np.cos(2 * math.pi * x / 0.004 + 0.4) * np.sign(v),
        ),
        (  # does not flip
            {"ripple": 0.4, "ripple_period": 0.01, "ripple_phase": 1.0},
            lambda x, v, a: 0.4 * np.cos(2 * math.pi * x / 0.01 + 1.0),
        ),
        (  # a notch
            {"detent": 1.0, "detent_place": 0.01, "detent_width": 0.002},
            lambda x, v, a: (x - 0.01) / 0.002 * np.exp(0.5 - 0.5 * ((x - 0.01) / 0.002) ** 2),
        ),
    ],
    ids=lambda value: "+".join(value) if isinstance(value, dict) else "",
)
def test_force_by_place_and_speed(changes, expected):
    missing, log = need(changes)
    moving = sliding(log)
    v = log["v"][moving]
    x = log["x"][moving] + 0.5 * PERIOD * v  # in the middle of the period
    assert missing[moving] == pytest.approx(expected(x, v, log["a"][moving]), abs=0.015)


@pytest.mark.parametrize("law", [LUGRE, ELASTO_PLASTIC, MAXWELL])
def test_bristles_show_after_reversals(law):
    missing, log = need({"law": law, "sigma0": 1e4, "sigma1": 40.0})
    assert np.abs(missing[np.abs(log["v"]) > 0.1]).max() < 0.05
    assert np.abs(missing).max() > 0.5


@pytest.mark.parametrize(
    "changes",
    [{"delay": 0.004}, {"lag": 0.004}, {"lag": 0.002, "lag_twice": 1.0}, {"window": 0.008}],
)
def test_every_delay_is_late_by_its_mean(changes):
    slope = np.gradient(to_and_fro(), PERIOD)
    late = np.polyfit(slope[50:], need(changes)[0][50:], 1)[0]
    assert late == pytest.approx(0.004, rel=0.05)


@pytest.mark.parametrize(("form", "early", "late"), [(0, 0.1, 0.9), (1, 0.3, 0.97), (2, 0.0, 1.0)])
def test_drift_of_friction_in_time(form, early, late):
    missing, log = need({"drift": 0.6, "drift_form": form, "drift_time": 0.4})
    moving, t = sliding(log), np.arange(len(log)) * PERIOD
    share = missing * np.sign(log["v"])
    assert np.median(share[moving & (t < 0.3)]) == pytest.approx(0.6 * early, abs=0.1)
    assert np.median(share[moving & (t > 1.2)]) == pytest.approx(0.6 * late, abs=0.1)


@pytest.mark.parametrize("form", [0, 1, 2, 3])
def test_a_warm_winding_needs_voltage_with_the_current(form):
    par, commands = nominal_axis(), swing(900)
    changes = {"r_drift": 0.3, "r_form": form, "r_time": 0.3, "r_current": 0.03}
    missing, log = need(changes, par, commands, "need_voltage")
    late = np.arange(900) > 700
    assert 0.05 < np.polyfit(21.4 * log["current_mean"][late], missing[late], 1)[0] < 0.35
    assert np.abs(log["need_force"]).max() < 1e-3


def test_a_clipped_command_needs_what_is_clipped_off():
    missing, log = need({"limit": 4.0})
    moving, commands = sliding(log), to_and_fro()
    cut = commands - np.clip(commands, -4, 4)
    assert missing[moving] == pytest.approx(cut[moving], abs=1e-6)
    assert np.ptp(cut[moving]) > 2


def test_mains_and_bursts_are_seen_as_they_are():
    missing, _ = need({"mains": 0.3, "mains_frequency": 50.0})
    assert np.std(missing) == pytest.approx(0.3 / math.sqrt(2), rel=0.05)
    bursts = 2.0 * (np.arange(200) // 10 == 10)
    log = run(drive(), np.full(200, 1.0), bursts=bursts)
    assert log["need"] == pytest.approx(bursts, abs=1e-6)


def test_a_second_resonance_rings_at_its_frequency():
    changes = {"resonator": 0.4, "resonator_spring": 0.4 * (2 * math.pi * 20) ** 2}
    missing, _ = need(changes | {"resonator_damping": 0.5, "block_mass": 1.6})
    power = np.abs(np.fft.rfft(missing * np.hanning(missing.size)))
    frequencies = np.fft.rfftfreq(missing.size, PERIOD)
    high = frequencies > 10
    assert 17 < frequencies[high][power[high].argmax()] < 26
