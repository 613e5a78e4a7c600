"""The next experiment: its motion by hand, within what the machine did, and what is said of it."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosed import nominal
from slide_records import believed, slide_record

from ballscrew.measurement.diagnosis.causes import CAUSES
from ballscrew.measurement.diagnosis.diagnosis import diagnose_records
from ballscrew.measurement.diagnosis.experiment import (
    COMMAND_FILE,
    Reach,
    next_experiment,
    reach_of,
    survey,
)
from ballscrew.measurement.diagnosis.model import Drive
from ballscrew.measurement.diagnosis.motion import lay_along
from ballscrew.measurement.diagnosis.scores import OUTSIDE
from ballscrew.measurement.records.reading import check_record
from ballscrew.orchestration.master.reference_signal import Reference

VALUES = {"m": 10.0, "gain": 2.0, "offset": 0.0, "sigma2": 20.0, "Fc": 5.0, "Fs": 6.0, "Vs": 1.0}
# 0.4 m, half a metre a second, and 40 N of which 6 N is friction
REACH = Reach(-0.1, 0.3, 0.5, 2.0, 20.0, 2e-3, 20.0)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("machine", "model", "going", "swinging", "rate"),
    [
        # 0.9 of half of (0.9 40 - 6 - 20 v)/10 at 0.9 of the speed, over 0.15 of 0.9 travels
        ({}, {}, 0.0395841, math.sqrt(0.945 * 0.054), math.sqrt(0.945 / 0.054)),
        ({}, {"offset": -4.0}, 0.0395841, math.sqrt(0.765 * 0.054), math.sqrt(0.765 / 0.054)),
        ({"acceleration": 0.2}, {}, 0.0395841, math.sqrt(0.18 * 0.054), math.sqrt(0.18 / 0.054)),
        # too little force by the model: what was recorded
        ({"command": 3.0}, {}, 0.0395841, math.sqrt(1.8 * 0.054), math.sqrt(1.8 / 0.054)),
        # half of 0.9 of the speed over the travel, the rest to and fro
        ({"speed": 0.08}, {}, 0.036, 0.036, 1.2852 / 0.036),
        # at 0.0675 m/s viscous friction takes 0.9 of the force to spare
        ({}, {"sigma2": 400.0}, 0.03375, 0.03375, 4.0),
        # forty samples in a period
        ({"step": 0.05}, {}, 0.0395841, 0.054 * math.pi, math.pi),
    ],
)
def test_the_motion_is_as_fast_and_hard_as_the_machine_can_be(
    machine, model, going, swinging, rate
):
    reach = REACH._replace(**machine)
    motion = survey("why", reach, Drive("drive", "classical", VALUES | model, {}), 20.0)
    assert motion.motion["speeds_m_per_s"] == pytest.approx([going, swinging], rel=1e-4)
    over, swing = going * 20.0 / (2 * math.pi), swinging / rate
    # from the middle less the slow motion's amplitude; quick lobes, then slow ones
    assert motion.values[0] == pytest.approx(0.1 - over, rel=1e-4)
    for at, lobe_rate in ((1 / 12, rate), (3 / 12, rate / 3)):
        k = int(np.argmin(np.abs(motion.time - 20.0 * at)))
        t = motion.time[k]
        swung = math.sin(lobe_rate * (t - math.floor(6 * at) * 20.0 / 6))
        swung *= swing * math.sin(6 * math.pi * t / 20.0) ** 2
        x = 0.1 - over * math.cos(2 * math.pi * t / 20.0) + swung
        assert motion.values[k] == pytest.approx(x, abs=1e-4 * over)
    assert motion.motion["duration_s"] == pytest.approx(20.0)
    said = f"over {2e3 * over:.3g} mm and in addition forwards and backwards by up to "
    assert f"{said}{2e3 * swing:.3g} mm, at {rate / (2 * math.pi):.3g} Hz" in motion.motion["says"]
    assert REACH.low < motion.values.min() < motion.values.max() < REACH.high
    assert np.abs(np.gradient(motion.values, motion.time)).max() <= reach.speed


def test_it_lasts_twelve_seconds_at_least_and_a_loop_can_follow_its_file(tmp_path):
    motion = survey("why", REACH, nominal(), 5.0)
    assert motion.motion["duration_s"] == pytest.approx(12.0)
    assert motion.motion["record"] == ["time", "u", "x", "i"]
    assert motion.motion["amplitude"] == 0.5 * np.ptp(motion.values)
    # 0.9 of the force beyond break-away, at 10.98 N/V, over friction's and the back EMF's damping
    fastest = 0.9 * (0.9 * 20.0 * 10.98089 - 2.35) / (173.0 + 10.98089 * 235.2941)
    assert sum(motion.motion["speeds_m_per_s"]) == pytest.approx(fastest, rel=1e-5)
    motion.save(tmp_path)
    reference = Reference.read(tmp_path / COMMAND_FILE)
    assert reference.times[-1] == pytest.approx(motion.motion["duration_s"])
    assert np.allclose(reference.values, motion.values, atol=1e-9)


def found_with(*names, built=(), alternatives=()):
    """What a search leaves that ended with these suspects, the best score first."""
    members = [SimpleNamespace(name=n, score=90.0 - k) for k, n in enumerate(names)]
    course = lay_along(slide_record(), believed())
    study = SimpleNamespace(courses=[course], model=believed())
    more = {"built": list(built), "alternatives": dict.fromkeys(alternatives, ("...",))}
    return SimpleNamespace(study=study, suspects=members[::-1], **more)


def test_what_is_asked_for_is_about_what_is_undecided_and_waits_for_slow_ones():
    certain = SimpleNamespace(name="load_bias", score=95.0, certain=True)
    built = [certain, SimpleNamespace(name="torque_ripple", score=99.0, certain=False)]
    names = "backlash", OUTSIDE, "compliance", "friction_drift", "time_shift"
    asked = next_experiment(found_with(*names, built=built), quiet=False)
    assert asked.says == (
        "these records cannot distinguish backlash from compliance or friction_drift; what would "
        f"confirm backlash: {CAUSES['backlash'].confirm}"
    )
    assert asked.motion["duration_s"] == pytest.approx(3 * 7.999, abs=2e-3)
    of_two = found_with("backlash", built=built, alternatives=["load_bias"])
    assert "cannot distinguish load_bias from backlash;" in next_experiment(of_two, False).says
    for given, name in (
        (found_with("backlash", built=built), "backlash"),
        (found_with(built=built), "torque_ripple"),
    ):
        one = next_experiment(given, quiet=False)
        assert one.says == f"what would confirm {name}: {CAUSES[name].confirm}"
        assert one.motion["duration_s"] == pytest.approx(12.0)
    assert "these records show no fault" in next_experiment(found_with(*names), quiet=True).says


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
    assert asked.says.startswith("what would confirm torque_ripple: ")
    assert np.abs(asked.values).max() <= 0.012
