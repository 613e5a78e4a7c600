"""The diagnosis on records in which an effect is hidden: a sample of ``make prove``."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from diagnosed import nominal
from hidden_cases import draw_case, write_case

from ballscrew.diagnosis import search
from ballscrew.diagnosis.causes import CAUSES
from ballscrew.diagnosis.course import instrument_noise, lay_along
from ballscrew.diagnosis.diagnose import diagnose, diagnose_records
from ballscrew.records.bad_record import BadRecord
from ballscrew.records.drive_record import checked


def told(effects, seed, folder):
    case = draw_case(effects, seed)
    files = write_case(case, folder)
    return case, diagnose([files.record], params=files.parameters)


@pytest.mark.parametrize(
    ("effect", "seed"),
    [("torque_ripple", 0), ("backlash", 0)],
)
def test_a_hidden_effect_is_named_first_with_its_size_within_the_interval(effect, seed, tmp_path):
    case, found = told((effect,), seed, tmp_path)
    assert found.verdict in ("explained", "partly")
    cause = found.causes[0]
    assert cause.name == effect
    assert cause.p_value < 0.05
    truth = case.sizes[effect]
    name, value = {
        "torque_ripple": ("ripples_per_metre", 1000 * float(truth.get("ripple_n", 0))),
        "backlash": ("gap", truth.get("gap")),
    }[effect]
    if name in cause.intervals:
        low, high = cause.intervals[name]
        assert low < float(value) < high
    else:
        assert cause.parameters[name] == pytest.approx(float(value))
    # on data that were held out, whatever their noise hides
    assert cause.gain_heldout > 0 or cause.after.position < cause.before.position


def test_nothing_hidden_is_called_nothing(tmp_path):
    _, found = told(("none",), 21, tmp_path)
    assert found.verdict == "none"
    assert found.causes == ()
    assert found.baseline_residual.force > found.floor.force * 0.8


def test_what_no_cause_has_is_not_given_a_name(tmp_path):
    _, found = told(("bursts",), 0, tmp_path)
    assert found.verdict == "unexplained"
    assert found.causes == ()
    assert found.unnamed == ("in time",)
    assert np.any(found.curves.shape)


def test_two_effects_are_both_found_and_written(tmp_path):
    _, found = told(("position_periodic_friction", "load_bias"), 3, tmp_path)
    assert {c.name for c in found.causes} == {"position_periodic_friction", "load_bias"}
    found.save(tmp_path / "out")
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [c["name"] for c in said["causes"]] == [c.name for c in found.causes]
    assert said["floor"]["force_N"] > 0


def test_a_limit_that_cuts_off_a_thousandth_is_found_beside_a_spring(tmp_path):
    """Between the last level tried and the largest command, where a search can overlook it."""
    case, found = told(("voltage_saturation", "compliance"), 6014, tmp_path)
    causes = {c.name: c for c in found.causes}
    assert set(causes) == {"voltage_saturation", "compliance"}
    limit, peak = (float(case.sizes["voltage_saturation"][n]) for n in ("limit", "peak"))
    told_limit = causes["voltage_saturation"].parameters["voltage_limit"]
    assert abs(told_limit - limit) < 0.2 * (peak - limit)


def test_two_effects_are_not_lost_to_one_whose_motion_was_smoothed_otherwise(tmp_path):
    _, found = told(("nonlinear_viscous", "stribeck_mismatch"), 6005, tmp_path)
    assert {c.name for c in found.causes} == {"nonlinear_viscous", "stribeck_mismatch"}


def test_a_search_cut_short_tells_a_change_once(tmp_path, monkeypatch):
    """It adjusts the mass and ends: the change is in the model then, and is not made again."""
    monkeypatch.setattr(search, "_TURNS", 1)
    case, found = told(("unmodelled_inertia",), 6100, tmp_path)
    (cause,) = found.causes
    (name,) = cause.parameters
    assert name == "m"
    truth = float(case.sizes["unmodelled_inertia"]["m"])
    assert cause.parameters["m"] == pytest.approx(truth, rel=0.3)
    assert found.mended.values["m"] == pytest.approx(cause.parameters["m"])


def test_an_edge_of_the_encoder_tells_more_than_a_count():
    """The motion is rebuilt to a tenth of the encoder's count."""
    import hidden_effects

    random = np.random.default_rng(5)
    time = np.arange(8001) * 1e-3
    u = 3.0 * np.sin(2 * math.pi * 0.7 * time) + 1.5 * np.sin(2 * math.pi * 1.9 * time + 1)
    motion = hidden_effects.simulate({}, u, hidden_effects.friction_noise(random, 8001))
    record = checked("made", {"time": time[:-1], "u": u[:-1], "x": motion.encoder[:-1]})
    course = lay_along(record, nominal())
    error = course.x - motion.motor_position[:-1]
    assert np.std(error) < 0.15 * hidden_effects.COUNT
    assert np.sqrt(instrument_noise(record)[2][0]) == pytest.approx(
        hidden_effects.COUNT / math.sqrt(12), rel=1e-3
    )


def test_a_drive_that_stands_still_is_no_record():
    time = np.arange(3000) * 1e-3
    record = checked("still", {"time": time, "u": np.ones(3000), "x": np.zeros(3000)})
    with pytest.raises(BadRecord, match="never changes"):
        diagnose_records([record], nominal())


def test_every_cause_says_what_would_confirm_it_and_what_it_is_mistaken_for():
    known = {*CAUSES, "unexplained"}
    for cause in CAUSES.values():
        assert cause.says
        assert cause.confirm
        assert set(cause.mistaken_for) <= known


def test_friction_that_follows_a_thermometer_is_told_per_degree():
    """A screw that cools down and warms up again: no growth in time would do."""
    import hidden_effects

    random = np.random.default_rng(11)
    time = np.arange(hidden_effects.SAMPLES + 1) * hidden_effects.SAMPLE
    u = 3.0 * np.sin(2 * math.pi * 0.7 * time) + 1.5 * np.sin(2 * math.pi * 1.9 * time + 1)
    noise = hidden_effects.friction_noise(random)
    temperature = 22.0 + 12.0 * np.cos(2 * math.pi * time / time[-1])
    cold = hidden_effects.simulate({}, u, noise)
    friction = hidden_effects.force_along({}, cold.position, cold.speed, cold.way)
    warm = noise + 0.01 * (temperature - 22.0) * np.append(friction, friction[-1])
    motion = hidden_effects.simulate({}, u, warm)
    thermometer = np.where(np.arange(len(time)) % 500 == 0, np.round(temperature, 1), np.nan)
    signals = {"time": time, "u": u, "x": motion.encoder, "temperature": thermometer}
    found = diagnose_records([checked("made", {n: s[:-1] for n, s in signals.items()})], nominal())
    first = found.causes[0]
    assert first.name == "friction_drift"
    low, high = first.intervals["friction_per_kelvin"]
    assert low < 0.01 < high
    assert high - low < 0.005
