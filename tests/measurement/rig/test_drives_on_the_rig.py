"""Drives of parameter files on the rig: trials of their size, records for the other commands."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from diagnosed import run
from scipy.integrate import solve_ivp
from scipy.signal import butter, lfilter

import ballscrew
from ballscrew.measurement.rig.bench import run_trial
from ballscrew.measurement.rig.machine import Machine
from ballscrew.measurement.rig.setup import Noise
from ballscrew.solver.errors import BadParameter

LINEAR = """
kind = "drive"
command = "force"
law = "lugre"

[plant]
m = 40.0
gain = 1.0
offset = 15.0
sigma0 = 1e7
sigma1 = 2e4
sigma2 = 200.0
Fc = 80.0
Fs = 90.0
Vs = 0.01
voltage_limit = 500.0

[rig.trial]
travel = 0.6
"""
JOINT = """
kind = "rotary_drive"
command = "torque"
law = "classical"

[plant]
J = 0.5
gain = 1.0
Fc = 2.0
Fs = 2.5
sigma2 = 1.5
Vs = 0.05
"""
STEP = 0.005  # s, of the rig's program


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The parameter file of each machine."""
    folder = tmp_path_factory.mktemp("machines")
    for name, text in (("linear", LINEAR), ("joint", JOINT)):
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return {f.stem: ballscrew.read_parameters(f) for f in folder.iterdir()}


# -- right -----------------------------------------------------------------------------------


def simc(gain, lag, second, delay, closed):
    """The series form's three numbers, as Skogestad prints them, in the parallel form."""
    kc, ti = lag / gain / (closed + delay), min(lag, 4 * (closed + delay))
    return kc * (1 + second / ti), kc / ti, kc * second


def by_scipy(reference, force_controlled):
    """The linear drive in its loop, typed by hand: 200 Hz, 20 Hz Butterworth filters, LuGre."""
    b, a = butter(2, 20.0, fs=200.0)
    low_pass_lag = math.sqrt(0.5) * STEP / math.tan(math.pi * 20.0 * STEP)
    if force_controlled:
        gains = simc(1.0, low_pass_lag / 2, 0.0, low_pass_lag / 2 + STEP / 2, 1.0)
    else:
        delay = low_pass_lag / 2 + STEP
        gains = simc(1 / 200.0, 40.0 / 200.0, low_pass_lag / 2, delay, 3 * delay)
    memory, before = np.zeros(2), 0.0
    total = last = held = 0.0
    y, rows = np.zeros(3), []  # position, velocity, bristles

    def rate(_, y, u):
        _, v, z = y
        dz = v - 1e7 * abs(v) * z / (80.0 + 10.0 * math.exp(-((v / 0.01) ** 2)))
        return [v, (u - 15.0 - 1e7 * z - 2e4 * dz - 200.0 * v) / 40.0, dz]

    for asked in reference:
        # what the load cell feels: all of the drive's force but the constant one
        seen = held - 15.0 if force_controlled else y[0]
        (filtered,), memory = lfilter(b, a, [seen], zi=memory)
        measured = filtered if force_controlled else (filtered - before) / STEP
        error = asked - measured
        grown = total + STEP * error
        slope, last, before = (measured - last) / STEP, measured, filtered
        demand = gains[0] * error + gains[1] * grown - gains[2] * slope
        total = grown if abs(demand) <= 500.0 else total
        held = min(500.0, max(-500.0, demand))
        rows.append((held, *y))
        solver = {"method": "Radau", "rtol": 1e-8, "atol": [1e-12, 1e-10, 1e-14]}
        y = solve_ivp(rate, (0.0, STEP), y, args=(held,), **solver).y[:, -1]
    return np.array(rows).T


SHARP = {"encoder.counts": 1e12, "encoder.phase": 0.5, "load_cell.resolution": 1e-9}


@pytest.mark.ci
@pytest.mark.parametrize("trial", ["2.4/1", "2.2/12"])
def test_a_record_without_noise_is_what_scipy_simulates(files, trial):
    found = run_trial(trial, "lugre", SHARP, noise=Noise(0.0), file=files["linear"])
    part = slice(0, 240)
    name = "force_ref" if trial == "2.2/12" else "v_ref"
    u, x, v, _ = by_scipy(found.record[name][part], trial == "2.2/12")
    assert np.abs(found.record["u"][part] - u).max() < 1e-4 * np.abs(u).max()
    assert np.abs(found.truth["x"][part] - x).max() < 1e-4 * np.abs(x).max()
    assert np.abs(found.truth["v"][part] - v).max() < 1e-3 * np.abs(v).max()


# -- of the machine's size -------------------------------------------------------------------


def test_trials_have_the_size_of_the_machine(files):
    """Forces are shares of its static friction; viscous friction grows to that of sliding."""
    linear = Machine("lugre", file=files["linear"])
    joint = Machine("classical", file=files["joint"])
    assert linear.sizes == pytest.approx({"speed": 80.0 / 200.0, "force": 90.0, "travel": 0.6})
    assert joint.sizes["speed"] == pytest.approx(2.0 / 1.5)
    assert joint.trials["2.4/1"].asked == "velocity 0.1667 rad/s sin(1 t)"
    assert linear.trials["2.8/1"].asked == f"step of the force to {90 * 0.5 / 2.35:.4g} N"
    for trial in linear.trials.values():
        if trial.control == "velocity":
            assert np.abs(np.cumsum(trial.reference()) * STEP).max() < 0.6 * 1.01
    for trial in joint.trials.values():
        assert not trial.fine
        assert "N*m" in trial.asked or "rad/s" in trial.asked


@pytest.mark.ci
@pytest.mark.parametrize(
    ("limit", "travel", "speed"),
    [
        (500.0, 0.05, 0.05),  # over the travel in a second
        (200.0, 5.0, (0.8 * 200.0 - 15.0 - 80.0) / 200.0),  # force to spare
        (1e6, 5.0, 0.4),
    ],
)
def test_the_largest_velocity_is_one_that_the_machine_can_do(files, limit, travel, speed):
    given = {"plant.voltage_limit": limit, "trial.travel": travel}
    assert Machine("lugre", given, files["linear"]).sizes["speed"] == pytest.approx(speed)
    found = run_trial("viscous/51", "lugre", given, file=files["linear"])
    assert np.mean(found.truth["v"][-20:]) == pytest.approx(speed, rel=0.02)
    assert np.abs(found.record["u"][-100:]).max() < limit


@pytest.mark.ci
@pytest.mark.parametrize(
    ("name", "trial", "given", "said"),
    [
        ("linear", "2.4/1", {"plant.voltage_limit": 90.0}, "gives 90 N .* too small for sliding"),
        ("linear", "2.2/13", {"plant.voltage_limit": 100.0}, "takes 107 N, but .* gives 100 N"),
        ("joint", "2.4/1", {"plant.sigma2": 0.0}, "give trial.speed, in rad/s"),
        ("linear", "viscous/51", {"trial.speed": 1.0}, "after 0.6 s on the travel of 0.6 m"),
        ("linear", "2.8/1", {}, "1.9 counts of the encoder.*use encoder.counts of 2089 or more"),
        ("joint", "presliding", {}, "the law classical does not have; use another law"),
        ("joint", "2.4/1", {"trial.sped": 1.0}, "it has trial.speed, trial.force, trial.travel"),
    ],
)
def test_a_trial_that_means_nothing_for_a_machine_is_refused(files, name, trial, given, said):
    with pytest.raises(BadParameter, match=said):
        run_trial(trial, files[name].law, given, file=files[name])


# -- its parts -------------------------------------------------------------------------------


@pytest.mark.ci
def test_the_parameters_written_give_the_same_record_again(files, tmp_path):
    first = ballscrew.run_trial("2.6/6", params=files["joint"].path, seed=1)
    first.save(tmp_path)
    again = ballscrew.run_trial("2.6/6", params=tmp_path / "parameters.toml", seed=1)
    for name, values in first.record.items():
        np.testing.assert_array_equal(again.record[name], values)
    about = json.loads((tmp_path / "trial.json").read_text())
    schema = Path(__file__).parents[3] / "docs" / "reference" / "schemas" / "trial.json"
    import jsonschema

    jsonschema.validate(about, json.loads(schema.read_text()))
    text = (tmp_path / "record.csv").read_text().splitlines()[0]
    assert text.startswith("time [s],x [rad],force [N*m],u [N*m],v_ref [rad/s]")
    written = ballscrew.read_parameters(tmp_path / "parameters.toml")
    assert (written.kind, written.command) == ("rotary_drive", "torque")
    assert written.rig["velocity_pid"]["Kp"].unit == "N*m/(rad/s)"
    picture = first.plot()
    labels = [axes.get_ylabel() for axes in picture.axes]
    assert labels == ["angle [rad]", "torque [N*m]", "velocity [rad/s]"]


# -- for the other commands ------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize(
    ("name", "law", "truth", "not_told"),
    [
        ("linear", "lugre", {"sigma0": 1e7, "sigma2": 200, "Fc": 80, "Fs": 90, "Vs": 0.01}, 1),
        ("joint", "classical", {"sigma2": 1.5, "Fc": 2.0, "Fs": 2.5, "Vs": 0.05}, 0),
    ],
)
def test_what_was_put_in_is_identified(files, tmp_path, name, law, truth, not_told):
    """Of the linear drive all but the bristles' damping, which no record at 200 Hz shows."""
    given = ("--params", files[name].path)
    trials = [f"2.4/{k}" for k in range(1, 17, 2)]
    assert run("rig", *trials, *given, "--seed", "1", "--out", tmp_path / "rig")[0] == 0
    fit = ("--law", law, *given, "--json", "--out", tmp_path / "identified")
    code, printed, _ = run("identify", tmp_path / "rig", *fit)
    found = json.loads(printed)["parameters"]
    assert code == (1 if not_told else 0)
    assert sum(not i["identified"] for i in found.values()) == not_told
    for parameter, true in truth.items():
        assert found[parameter]["identified"], parameter
        assert found[parameter]["low"] <= true <= found[parameter]["high"], parameter
    written = ballscrew.read_parameters(tmp_path / "identified" / "parameters.toml")
    assert written.kind == files[name].kind
    again = ("--params", written.path, "--out", tmp_path / "again")
    assert run("rig", "2.6/6", *again)[0] == 0
