"""Every effect does what its name says, seen in the simulator's own log."""

from __future__ import annotations

import math

import numpy as np
import pytest
from world_runs import PERIOD, drive, nominal_axis, run, swing
from worlds import layout as at
from worlds.axes import DRIVE, vector_of

VALUES = {
    "m": 2.0, "gain": 1.0, "sigma2": 20.0, "Fc": 1.0, "Fs": 1.5, "Vs": 0.01, "offset": 0.0,
}  # fmt: skip

# the simulators are compiled once
pytestmark = [pytest.mark.ci, pytest.mark.xdist_group("worlds")]


def slide():
    """A slide with Coulomb friction, and a command that drives it to and fro."""
    par = vector_of(DRIVE, VALUES)
    par[at.TRAVEL], par[at.DURATION] = 0.05, 1.5
    return par


def to_and_fro(count=1500):
    t = np.arange(count) * PERIOD
    return 6 * np.sin(2 * math.pi * 2 * t) * (1 + 0.3 * np.sin(2 * math.pi * 0.7 * t))


def need(changes, par=None, commands=None, column=at.NEED):
    """What the command gives and the motion does not need, with the motion's log."""
    par = slide() if par is None else par
    axis = par.copy()
    for place, value in changes.items():
        axis[place] = value
    log = run(axis, to_and_fro() if commands is None else commands, double=par, substeps=50)
    return log[:, column], log


def sliding(log):
    """Samples well away from rest."""
    return np.abs(log[:, at.V]) > 0.02


def test_nothing_changed_needs_nothing():
    missing, _ = need({})
    assert np.abs(missing).max() < 1e-6


def test_asymmetry_is_larger_one_way():
    missing, log = need({at.ASYMMETRY: 0.2})
    assert missing[sliding(log)] == pytest.approx(0.2, abs=0.01)  # of 1 N, the same sign both ways


def test_periodic_friction_swings_with_the_place_and_flips():
    missing, log = need({at.PERIODIC: 0.3, at.PERIOD: 0.004, at.PERIOD_PHASE: 0.4})
    moving = sliding(log)
    place = np.cos(2 * math.pi * log[:, at.X] / 0.004 + 0.4) * np.sign(log[:, at.V])
    assert np.corrcoef(missing[moving], place[moving])[0, 1] > 0.97


def test_trend_grows_along_the_travel():
    missing, log = need({at.TREND: 0.3})
    moving = sliding(log)
    expected = 0.3 * log[:, at.X] / 0.05 * np.sign(log[:, at.V])
    assert missing[moving] == pytest.approx(expected[moving], abs=0.01)


def test_ripple_does_not_flip():
    missing, log = need({at.RIPPLE: 0.4, at.RIPPLE_PERIOD: 0.01, at.RIPPLE_PHASE: 1.0})
    moving = sliding(log)
    place = np.cos(2 * math.pi * log[:, at.X] / 0.01 + 1.0)
    assert np.corrcoef(missing[moving], place[moving])[0, 1] > 0.97


def test_load_is_against_the_positive_way():
    missing, log = need({at.LOAD: 0.3})
    assert missing[sliding(log)] == pytest.approx(0.3, abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({at.QUADRATIC: 5.0}, lambda v: 5 * v * abs(v)),
        ({at.CUBIC: 30.0}, lambda v: 30 * v**3),
        ({at.ROOT: 1.0}, lambda v: np.sign(v) * np.sqrt(abs(v))),
        ({at.THINNING: 3.0}, lambda v: 20 * v / (1 + 3 * abs(v)) - 20 * v),
    ],
)
def test_viscous_friction_that_is_not_a_line(changes, expected):
    missing, log = need(changes)
    moving = sliding(log)
    assert missing[moving] == pytest.approx(expected(log[moving, at.V]), abs=0.01)


@pytest.mark.parametrize("law", [at.LUGRE, at.ELASTO_PLASTIC, at.MAXWELL])
def test_bristles_show_after_reversals(law):
    missing, log = need({at.LAW: law, at.SIGMA0: 1e4, at.SIGMA1: 40.0})
    assert np.abs(missing[sliding(log) & (np.abs(log[:, at.V]) > 0.1)]).max() < 0.05
    assert np.abs(missing).max() > 0.5


def test_more_mass_needs_force_with_the_acceleration():
    missing, log = need({at.MOTOR_MASS: 0.5})
    moving = sliding(log)
    assert missing[moving] == pytest.approx(0.5 * log[moving, at.A], abs=0.02)


@pytest.mark.parametrize(
    "changes",
    [{at.DELAY: 0.004}, {at.LAG: 0.004}, {at.LAG: 0.002, at.LAG_TWICE: 1.0}, {at.WINDOW: 0.008}],
)
def test_every_delay_is_late_by_its_mean(changes):
    commands = to_and_fro()
    missing, _ = need(changes, commands=commands)
    slope = np.gradient(commands, PERIOD)
    late = np.polyfit(slope[50:], missing[50:], 1)[0]
    assert late == pytest.approx(0.004, rel=0.05)


@pytest.mark.parametrize(("form", "early", "late"), [(0, 0.1, 0.9), (1, 0.3, 0.97), (2, 0.0, 1.0)])
def test_drift_of_friction_in_time(form, early, late):
    missing, log = need({at.DRIFT: 0.6, at.DRIFT_FORM: form, at.DRIFT_TIME: 0.4})
    moving, t = sliding(log), np.arange(len(log)) * PERIOD
    share = missing * np.sign(log[:, at.V])
    assert np.median(share[moving & (t < 0.3)]) == pytest.approx(0.6 * early, abs=0.1)
    assert np.median(share[moving & (t > 1.2)]) == pytest.approx(0.6 * late, abs=0.1)


@pytest.mark.parametrize("form", [0, 1, 2, 3])
def test_a_warm_winding_needs_voltage_with_the_current(form):
    par, commands = nominal_axis(), swing(900)
    changes = {at.R_DRIFT: 0.3, at.R_FORM: form, at.R_TIME: 0.3, at.R_CURRENT: 0.03}
    missing, log = need(changes, par, commands, at.NEED_VOLTAGE)
    late = np.arange(900) > 700
    share = np.polyfit(21.4 * log[late, at.CURRENT_MEAN], missing[late], 1)[0]
    assert 0.05 < share < 0.35
    assert np.abs(need(changes, par, commands, at.NEED_FORCE)[0]).max() < 1e-3


def test_a_clipped_command_needs_what_is_clipped_off():
    commands = to_and_fro()
    missing, log = need({at.LIMIT: 4.0}, commands=commands)
    moving = sliding(log)
    cut = commands - np.clip(commands, -4, 4)
    assert missing[moving] == pytest.approx(cut[moving], abs=1e-6)
    assert np.ptp(cut[moving]) > 2


def test_mains_and_bursts_are_seen_as_they_are():
    missing, _ = need({at.MAINS: 0.3, at.MAINS_FREQUENCY: 50.0})
    assert np.std(missing) == pytest.approx(0.3 / math.sqrt(2), rel=0.05)
    par, bursts = drive(), np.zeros(200)
    bursts[100:110] = 2.0
    log = run(par, np.full(200, 1.0), bursts=bursts)
    assert log[105, at.NEED] == pytest.approx(2.0, abs=1e-6)
    assert np.abs(log[:100, at.NEED]).max() < 1e-6


def test_a_notch_is_at_its_place():
    notch = {at.DETENT: 1.0, at.DETENT_PLACE: 0.01, at.DETENT_WIDTH: 0.002}
    missing, log = need(notch)
    near = np.abs(log[:, at.X] - 0.01) < 0.006
    assert near.any()
    assert np.abs(missing[near]).max() > 0.8
    assert np.abs(missing[sliding(log) & ~near]).max() < 0.1


def test_a_second_resonance_rings_at_its_frequency():
    changes = {at.RESONATOR: 0.4, at.RESONATOR_SPRING: 0.4 * (2 * math.pi * 20) ** 2}
    missing, _ = need(changes | {at.RESONATOR_DAMPING: 0.5, at.BLOCK_MASS: 1.6})
    power = np.abs(np.fft.rfft(missing * np.hanning(missing.size)))
    frequencies = np.fft.rfftfreq(missing.size, PERIOD)
    high = frequencies > 10
    assert 17 < frequencies[high][power[high].argmax()] < 26
