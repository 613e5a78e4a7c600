"""The next experiment: its motion by hand, within what the machine did, and what is said of it."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosed import nominal
from slide_records import COULOMB, MASS, VISCOUS, believed, slide_record

from ballscrew.measurement.diagnosis import experiment as module
from ballscrew.measurement.diagnosis.causes import CAUSES
from ballscrew.measurement.diagnosis.diagnose import diagnose_records
from ballscrew.measurement.diagnosis.drive import Drive
from ballscrew.measurement.diagnosis.experiment import (
    COMMAND_FILE,
    Reach,
    next_experiment,
    reach_of,
    survey,
)
from ballscrew.measurement.diagnosis.modelled_record import lay_along
from ballscrew.measurement.diagnosis.rule import Explained
from ballscrew.measurement.diagnosis.scores import OUTSIDE, Catalogue
from ballscrew.measurement.diagnosis.study import study_of
from ballscrew.measurement.records.reading import check_record
from ballscrew.orchestration.master.reference_signal import Reference

VALUES = {"m": 10.0, "gain": 2.0, "offset": 0.0, "sigma2": 20.0, "Fc": 5.0, "Fs": 6.0, "Vs": 1.0}
# 0.4 m, half a metre a second, and 40 N of which 6 N is friction
REACH = Reach(-0.1, 0.3, 0.5, 2.0, 20.0, 2e-3, 20.0)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("machine", "model", "going", "swinging", "rate"),
    [
        # 0.8 of half of (0.9 40 - 6 - 20 v)/10 at 0.9 of the speed, over 0.15 of 0.9 travels
        ({}, {}, 0.0395841, math.sqrt(0.84 * 0.054), math.sqrt(0.84 / 0.054)),
        ({}, {"offset": -4.0}, 0.0395841, math.sqrt(0.68 * 0.054), math.sqrt(0.68 / 0.054)),
        ({"acceleration": 0.2}, {}, 0.0395841, math.sqrt(0.16 * 0.054), math.sqrt(0.16 / 0.054)),
        # too little force by the model: half of what was recorded
        ({"command": 3.0}, {}, 0.0395841, math.sqrt(0.8 * 0.054), math.sqrt(0.8 / 0.054)),
        # 0.4 of 0.9 of the speed over the travel, the rest to and fro
        ({"speed": 0.1}, {}, 0.036, 0.054, 1.128 / 0.054),
        # at 0.12 m/s viscous friction takes 0.8 of the force to spare
        ({}, {"sigma2": 200.0}, 0.0395841, 0.12 - 0.0395841, 0.24 / (0.12 - 0.0395841)),
        # forty samples in a period
        ({"step": 0.05}, {}, 0.0395841, 0.054 * math.pi, math.pi),
    ],
)
def test_the_motion_is_as_fast_and_hard_as_the_machine_can_be(
    machine, model, going, swinging, rate
):
    reach = replace(REACH, **machine)
    motion = survey(reach, Drive("drive", "classical", VALUES | model, {}), 20.0)
    assert motion.speeds == pytest.approx((going, swinging), rel=1e-4)
    over, swing = going * 20.0 / (2 * math.pi), swinging / rate
    # from the middle less the slow motion's amplitude, after a rest; quick lobes, then slow ones
    rest = int(np.searchsorted(motion.time, 0.099999))
    assert motion.values[: rest + 1] == pytest.approx(0.1 - over, rel=1e-4)
    for at, lobe_rate in ((1 / 12, rate), (3 / 12, rate / 3)):
        k = int(np.argmin(np.abs(motion.time - 0.1 - 20.0 * at)))
        t = motion.time[k] - 0.1
        swung = math.sin(lobe_rate * (t - math.floor(6 * at) * 20.0 / 6))
        swung *= swing * math.sin(6 * math.pi * t / 20.0) ** 2
        x = 0.1 - over * math.cos(2 * math.pi * t / 20.0) + swung
        assert motion.values[k] == pytest.approx(x, abs=1e-4 * over)
    assert motion.duration == pytest.approx(20.1)
    said = f"over {2e3 * over:.3g} mm and in addition forwards and backwards by up to "
    assert f"{said}{2e3 * swing:.3g} mm, at {rate / (2 * math.pi):.3g} Hz" in motion.says
    assert REACH.low < motion.values.min() < motion.values.max() < REACH.high
    assert np.abs(np.gradient(motion.values, motion.time)).max() <= reach.speed


def test_it_lasts_twelve_seconds_at_least_and_a_loop_can_follow_its_file(tmp_path):
    motion = survey(REACH, nominal(), 5.0)
    assert motion.duration == pytest.approx(12.1)
    assert motion.record == ("time", "u", "x", "i")
    assert motion.to_dict()["amplitude"] == 0.5 * np.ptp(motion.values)
    motion.save(tmp_path)
    reference = Reference.read(tmp_path / COMMAND_FILE)
    assert reference.times[-1] == pytest.approx(motion.duration)
    assert np.allclose(reference.values, motion.values, atol=1e-9)


def found_with(*names, built=()):
    """What a search leaves that ended with these suspects, the best score first."""
    members = [
        SimpleNamespace(name=n, score=90.0 - k, certain=False, alike=())
        for k, n in enumerate(names)
    ]
    course = lay_along(slide_record(), believed())
    study = SimpleNamespace(courses=[course], model=believed())
    return SimpleNamespace(study=study, built=list(built), suspects=members[::-1])


def test_what_is_asked_for_names_three_suspects_and_waits_for_slow_ones(monkeypatch):
    monkeypatch.setattr(module, "_alike", lambda found, told, motion: [(told[0].name, "load_bias")])
    names = ("backlash", OUTSIDE, "load_bias", "friction_drift", "compliance")
    asked = next_experiment(found_with(*names), quiet=False)
    assert asked.says == (
        "these records cannot distinguish backlash from load_bias or friction_drift; this motion "
        "will not distinguish backlash from load_bias, and each of them corrects the model equally "
        f"well: {CAUSES['backlash'].confirm}"
    )
    assert asked.motion.duration == pytest.approx(3 * 7.999 + 0.1, abs=2e-3)
    certain = SimpleNamespace(name="load_bias", score=90.0, certain=True, alike=())
    one = next_experiment(found_with("backlash", built=[certain]), quiet=False)
    assert one.says == f"what would confirm backlash: {CAUSES['backlash'].confirm}"
    assert one.motion.duration == pytest.approx(12.1)


@pytest.fixture(scope="module")
def loaded():
    """A study of a slide with a load, and the next motion as it is foreseen."""
    study = study_of([slide_record("load_bias")], believed())
    found = Explained(study, Catalogue(study), [], [])
    motion = survey(reach_of(study.courses), study.model, 12.0)
    return found, motion, module._foreseen(found, motion)


def test_the_foreseen_record_is_newtons_law_along_the_motion(loaded):
    found, motion, study = loaded
    (course,), step = study.courses, motion.time[1]
    v = np.gradient(motion.values, step)
    values = found.study.model.values
    by_hand = values["m"] * np.gradient(v, step) + values["sigma2"] * v
    by_hand += values["Fc"] * np.sign(v)
    # midway between samples, friction is that of another instant
    even = np.abs(v[: len(course.u)]) > 0.02
    assert np.abs(course.u - by_hand[: len(course.u)])[even].max() < 0.02 * COULOMB
    assert values["m"] == pytest.approx(MASS, rel=0.03)
    assert values["sigma2"] == pytest.approx(VISCOUS, rel=0.05)


def test_what_sets_suspects_apart_is_the_loss_of_log_likelihood(loaded):
    """By least squares of all lines, each weighted, with the priors as rows of their own."""
    _, _, study = loaded
    n, used = len(study.courses[0].resting), np.flatnonzero(study.bands.used)
    columns = np.random.default_rng(0).standard_normal((n, len(study.courses[0].channels), 3))
    weights, spread = 0.5 + np.arange(len(used)) / len(used), np.array([0.01])
    lines = study.bands.lines([columns])
    rows = np.concatenate(
        [math.sqrt(w) * block[k] for block in lines for k, w in zip(used, weights, strict=True)]
    )
    rows = np.vstack([rows, [0.0, 1.0 / spread[0], 0.0]])
    _, left, *_ = np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)
    assert module._apart(study, columns, weights, spread) == pytest.approx(0.5 * left[0], rel=1e-3)


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


@pytest.mark.ci
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
    assert diagnose_records(records, believed).verdict == "undecided"
    found = diagnose_records(records, believed, take="torque_ripple")
    ripple = found.causes[0]
    assert {n.partition(".")[2] for n in ripple.intervals} == {"1", "2"}
    asked = found.next_experiment
    assert "these records cannot distinguish" in asked.says
    assert np.abs(asked.motion.values).max() <= 0.012


@pytest.mark.ci
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
