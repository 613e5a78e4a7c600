"""The next experiment stays within what the machine was seen to do, and is what is said of it."""

import math
import re

import numpy as np
import pytest
from diagnosed import nominal

from ballscrew.diagnosis.causes import CAUSES
from ballscrew.diagnosis.diagnose import diagnose_records
from ballscrew.diagnosis.drive import Drive
from ballscrew.diagnosis.experiment_motions import COMMAND_FILE, survey
from ballscrew.diagnosis.machine_reach import Reach, reach_of
from ballscrew.diagnosis.modelled_record import lay_along
from ballscrew.diagnosis.next_experiment import UNNAMED, trial_for
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.records.reading import check_record

NAMES = [*CAUSES, UNNAMED]
EMPS = {"m": 95.1, "gain": 35.2, "offset": -3.2, "sigma2": 203.5, "Fc": 20.4, "Fs": 20.4, "Vs": 1.0}
MACHINES = {
    # the axis: light, held back by its motor; a heavy one that its mass holds back; a slow one
    "axis": (nominal(), Reach(-0.02, 0.06, 0.12, 2.0, 20.0, 1e-3, 2e-6, 20.0)),
    "heavy": (
        Drive("drive", "classical", EMPS, {}),
        Reach(0.0, 0.22, 0.18, 1.2, 6.0, 1e-3, 1e-6, 24.0),
    ),
    "slow": (nominal(), Reach(0.1, 0.13, 0.01, 0.05, 5.0, 5e-3, 0.0, 8.0)),
}


def needed(model, x, step):
    """The command that a model of friction and mass asks for along a motion, typed by hand."""
    v = np.gradient(x, step)
    a = np.gradient(v, step)
    friction = max(model.values["Fc"], model.values["Fs"]) + abs(model.values.get("offset", 0.0))
    force = model.inertia * a + friction * np.sign(v)
    return (force + model.damping * v) / model.per_command


LASTS = (20.0, 60.0)


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("lasts", LASTS)
def test_it_stays_within_the_recorded_travel_speed_and_command(lasts, machine):
    model, reach = MACHINES[machine]
    motion = survey(reach, model, lasts)
    step = motion.time[1]
    assert np.allclose(np.diff(motion.time), step)
    x = motion.values
    assert reach.low <= x.min()
    assert x.max() <= reach.high
    assert np.abs(np.gradient(x, step)).max() <= reach.speed
    if machine != "slow":  # whose record has less command than its own model asks for
        assert np.abs(needed(model, x, step)).max() <= reach.command


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("lasts", LASTS)
def test_it_goes_both_ways_and_lasts_as_long_as_said(lasts, machine):
    model, reach = MACHINES[machine]
    motion = survey(reach, model, lasts)
    change = np.diff(motion.values)
    forth, back = change[change > 0].sum(), -change[change < 0].sum()
    assert forth == pytest.approx(back, rel=1e-6)
    assert forth > 0.0
    said = float(re.search(r"([\d.e+]+) s; record", motion.says)[1])
    assert motion.duration == pytest.approx(said, rel=6e-3)
    assert motion.duration == pytest.approx(lasts, abs=0.2)
    assert motion.to_dict()["duration_s"] == motion.duration
    assert set(motion.record) >= {"time", "u", "x"}
    assert ("i" in motion.record) == model.has_motor


@pytest.mark.parametrize("machine", MACHINES)
def test_every_third_of_it_reverses_and_moves_at_many_speeds(machine):
    """As blocks are held out one at a time, each has to show what the others do."""
    model, reach = MACHINES[machine]
    motion = survey(reach, model, 20.0)
    v = np.diff(motion.values) / np.diff(motion.time)
    for part in np.array_split(v, 3):
        assert np.count_nonzero(np.diff(np.sign(part))) >= 3
        assert np.abs(part).max() > 0.2 * np.abs(v).max()


def test_the_reach_is_that_of_all_records():
    time = 1e-3 * np.arange(4000)
    courses = []
    for centre, size in ((0.0, 0.01), (0.05, 0.02)):
        x = centre + size * np.sin(2 * math.pi * time)
        u = 20.0 * size * np.cos(2 * math.pi * time)
        courses.append(lay_along(check_record("made", {"time": time, "u": u, "x": x}), nominal()))
    reach = reach_of(courses)
    assert (reach.low, reach.high) == pytest.approx((-0.01, 0.07), abs=1e-4)
    assert reach.speed == pytest.approx(2 * math.pi * 0.02, rel=0.01)
    assert reach.command == pytest.approx(0.4)
    assert reach.acceleration == pytest.approx((2 * math.pi) ** 2 * 0.02, rel=0.05)
    assert (reach.step, reach.lasts) == pytest.approx((1e-3, 4.0), rel=1e-3)


def test_the_command_file_is_a_reference_that_a_loop_can_follow(tmp_path):
    model, reach = MACHINES["axis"]
    motion = survey(reach, model, reach.lasts)
    motion.save(tmp_path)
    reference = Reference.read(tmp_path / COMMAND_FILE)
    assert reference.times[-1] == pytest.approx(motion.duration)
    assert np.allclose(reference.values, motion.values, atol=1e-9)


def test_every_cause_has_a_trial():
    assert all(trial_for(name) for name in NAMES)


def test_records_of_which_each_has_a_phase_of_its_own_are_asked_for_one_more():
    """A ripple over less than two periods, which could be much else; the machine was homed anew."""
    random, time = np.random.default_rng(1), np.arange(0.0, 8.0, 1e-3)
    x, v = 0.012 * np.sin(2.0 * time), 0.024 * np.cos(2.0 * time)
    values = {"m": 40.0, "gain": 1.0, "offset": 0.0, "Fc": 80.0, "Fs": 80.0, "sigma2": 200.0}
    records = []
    for phase in (0.0, 2.0):
        force = -160.0 * x + 80.0 * np.sign(v) + 200.0 * v
        force += 30.0 * np.cos(2.0 * np.pi * x / 0.02 + phase)
        force += 3.0 * random.standard_normal(len(time))
        records.append(check_record("made", {"time": time, "x": x, "u": force}, "force"))
    believed = Drive("drive", "classical", values | {"Vs": 0.01}, {"Fc": 0.1, "sigma2": 0.1})
    found = diagnose_records(records, believed)
    assert found.verdict == "unexplained"
    assert "torque_ripple" in {c.name for c in found.causes} | {s.name for s in found.suspects}
    asked = found.next_experiment
    assert "these records cannot distinguish" in asked.says
    assert np.abs(asked.motion.values).max() <= 0.012


def test_what_no_motion_of_this_kind_tells_apart_is_said_and_that_the_correction_is_the_same():
    """A load of 8 N, and friction that is 16 N more one way and 8 N less in all, as it may be."""
    random, time = np.random.default_rng(1), np.arange(0.0, 8.0, 1e-3)
    x = 0.1 * np.sin(2.0 * time) + 0.01 * np.sin(9.0 * time)
    v = 0.2 * np.cos(2.0 * time) + 0.09 * np.cos(9.0 * time)
    a = -0.4 * np.sin(2.0 * time) - 0.81 * np.sin(9.0 * time)
    u = 40.0 * a + 80.0 * np.sign(v) + 200.0 * v + 8.0 + random.standard_normal(len(time))
    values = {"m": 40.0, "gain": 1.0, "offset": 0.0, "Fc": 80.0, "Fs": 80.0, "sigma2": 200.0}
    believed = Drive("drive", "classical", values | {"Vs": 0.01}, {"Fc": 0.1, "sigma2": 0.1})
    record = check_record("made", {"time": time, "x": x, "u": u}, "force")
    found = diagnose_records([record], believed)
    members = {c.name for c in found.causes} | {s.name for s in found.suspects}
    assert {"load_bias", "direction_asymmetry"} <= members
    says = found.next_experiment.says
    pair = "load_bias from direction_asymmetry|direction_asymmetry from load_bias"
    assert re.search(
        f"this motion will not distinguish ({pair}), and each of them corrects the model", says
    )
