"""The diagnosis on records in which an effect is hidden: a sample of ``make prove``."""

from __future__ import annotations

import json
import math
from functools import cache

import numpy as np
import pytest
from axis_records import (
    ASYMMETRY,
    NOMINAL,
    NOTCH,
    TURN,
    friction_noise,
    gap,
    moved,
    signals_of,
    strong_record,
    to_and_fro,
)
from diagnosed import nominal
from worlds import draw_case as draw_world
from worlds import layout as at
from worlds import write_case as write_world

from ballscrew.diagnosis.causes import CAUSES
from ballscrew.diagnosis.diagnose import diagnose, diagnose_records
from ballscrew.diagnosis.prior_model import read_prior_model
from ballscrew.records.bad_record import BadRecord
from ballscrew.records.drive_record import check_record, read_drive_records

in_a_world = pytest.mark.xdist_group("worlds")  # whose simulators are compiled once

LIMITED = {at.LIMIT: 3.2}
TRUTH = {
    "load_bias": ({at.LOAD: 0.4}, "load", 0.4),
    "torque_ripple": ({at.RIPPLE: 0.3, at.RIPPLE_PERIOD: 0.5e-3}, "ripple_cos", 0.3),
    "backlash": (gap(1e-4), "gap", 1e-4),
    "unmodelled_inertia": ({at.BLOCK_MASS: 9.0}, "m", 9.0),
    "direction_asymmetry": (ASYMMETRY, "asymmetry", 0.2),
    "friction_drift": ({at.DRIFT: 0.24, at.DRIFT_VISCOUS: 0.24}, "friction_drift", 0.24),
    "voltage_saturation": (LIMITED, "voltage_limit", 3.2),
}
OTHERS = ("torque_ripple", "direction_asymmetry", "friction_drift", "voltage_saturation")


@cache
def found_of(effect):
    """The diagnosis of a record with one effect of `TRUTH`."""
    return diagnose_records([strong_record(TRUTH[effect][0])], nominal())


@pytest.mark.xdist_group("one_effect")
def test_a_mass_that_is_found_is_in_the_model_once():
    found = found_of("unmodelled_inertia")
    assert found.corrected.values["m"] == pytest.approx(found.causes[0].parameters["m"])


@pytest.mark.parametrize(
    "effect",
    [
        "load_bias",
        "backlash",
        pytest.param("unmodelled_inertia", marks=pytest.mark.xdist_group("one_effect")),
        *(pytest.param(e, marks=pytest.mark.long) for e in OTHERS),
    ],
)
def test_a_hidden_effect_is_named_alone_and_has_its_size(effect):
    _, name, size = TRUTH[effect]
    found = found_of(effect)
    assert found.verdict in ("explained", "partly")
    (cause,) = found.causes
    assert cause.name == effect
    assert cause.parameters[name] == pytest.approx(size, rel=0.05)
    assert cause.gain_heldout > 0.5
    assert cause.gain_interval[0] > 0.0
    assert cause.p_value < 0.05
    assert found.final_residual.force < 0.5 * found.adjusted_residual.force


def test_a_resistance_that_grows_is_told_from_friction_by_the_current():
    found = diagnose_records([strong_record({at.R_DRIFT: 0.18}, with_current=True)], nominal())
    (cause,) = found.causes
    assert cause.name == "resistance_drift"
    assert cause.parameters["R_drift"] == pytest.approx(0.18, rel=0.05)


def test_nothing_hidden_is_called_nothing():
    found = diagnose_records([strong_record({}, samples=6_000)], nominal())
    assert found.verdict == "none"
    assert found.causes == ()
    assert found.baseline_residual.force > found.floor.force * 0.8
    assert all(abs(change) <= 0.03 + 1e-9 for change in found.adjustments.values())


def test_what_no_cause_has_is_not_given_a_name():
    found = diagnose_records([strong_record(NOTCH)], nominal())
    assert found.verdict == "unexplained"
    assert found.causes == ()
    assert found.unnamed == ("with position",)
    assert np.any(found.curves.shape)


def test_two_effects_are_both_found_and_written(tmp_path):
    hidden = {at.LOAD: 0.3, at.PERIODIC: 0.3, at.PERIOD: 1e-3, at.PERIOD_PHASE: 1.0}
    found = diagnose_records([strong_record(hidden)], nominal())
    assert {c.name for c in found.causes} == {"position_periodic_friction", "load_bias"}
    found.save(tmp_path / "out")
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [c["name"] for c in said["causes"]] == [c.name for c in found.causes]
    assert said["floor"]["force_N"] > 0


@in_a_world
@pytest.mark.long
def test_two_drifts_that_cancel_each_other_are_not_both_named(tmp_path):
    """Nothing is hidden; without a current, resistance and friction that change fit anything."""
    records, prior_model = write_world(draw_world("fast_screw", (), 82002), tmp_path)
    names = {c.name for c in diagnose(records, params=prior_model).causes}
    assert not {"friction_drift", "resistance_drift"} <= names


def test_the_last_digits_of_a_record_do_not_change_the_answer():
    """Values at the end of their tolerance were held there or not as rounding would have it."""
    record = strong_record(LIMITED, samples=6_000)
    sizes = []
    for change in (-1e-13, 0.0, 1e-13):
        signals = {**record.signals, "u": record.signals["u"] * (1.0 + change)}
        (cause,) = diagnose_records([check_record("made", signals)], nominal()).causes
        assert cause.name == "voltage_saturation"
        sizes.append(cause.parameters["voltage_limit"])
    assert np.ptp(sizes) < 1e-6


@in_a_world
def test_a_command_that_is_late_by_less_than_a_recorder_may_be_is_not_named(tmp_path):
    """Nobody told when within a sampling interval the command acts."""
    case = draw_world("linear_drive", ("input_delay",), 82000)
    records, prior_model = write_world(case, tmp_path)
    found = diagnose(records, params=prior_model)
    assert not found.causes
    reasons = {n.name: n.because for n in found.not_named}
    assert reasons["input_delay"] == "a command may be recorded as early as that"


def test_a_value_at_the_end_of_its_tolerance_is_said():
    record = strong_record({at.KT: 1.12 * NOMINAL["kt"] * TURN})  # kt and R are believed within 3 %
    found = diagnose_records([record], nominal())
    assert not found.causes
    (note,) = (n for n in found.notes if n.startswith("at the end of what they can be: "))
    assert "kt" in note


@in_a_world
def test_each_record_may_have_an_offset_of_its_own(tmp_path):
    """The second half of a faultless record, as if another force pulled at it."""
    paths, parameters = write_world(draw_world("linear_drive", (), 82000), tmp_path)
    (record,) = read_drive_records(paths)
    prior_model = read_prior_model(parameters)
    half, more = len(record.x) // 2, 0.2 * prior_model.friction_scale
    pulled = record.signals["u"] + more / prior_model.values["gain"]
    parts = [
        check_record("first", {n: s[:half] for n, s in record.signals.items()}),
        check_record("second", {n: s[half:] for n, s in (record.signals | {"u": pulled}).items()}),
    ]
    found = diagnose_records(parts, prior_model)
    assert not found.causes
    (note,) = (n for n in found.notes if n.startswith("offsets beyond that of first: "))
    assert float(note.split()[5]) == pytest.approx(more, rel=0.1)  # friction noise lasts


@in_a_world
def test_values_that_cancel_each_other_are_not_called_wrong(tmp_path):
    """Nothing is hidden; without a current, a larger motor constant and resistance are alike."""
    records, prior_model = write_world(draw_world("simulated", (), 82001), tmp_path)
    assert not diagnose(records, params=prior_model).causes


def found_in_world(tmp_path, world, effects, seed):
    case = draw_world(world, effects, seed)
    records, prior_model = write_world(case, tmp_path)
    return case, diagnose(records, params=prior_model)


@in_a_world
@pytest.mark.long
def test_a_supply_that_sags_with_the_current_is_found_with_its_limit(tmp_path):
    _, found = found_in_world(tmp_path, "industrial", ("voltage_saturation",), 61000)
    (cause,) = found.causes
    assert cause.name == "voltage_saturation"
    assert cause.parameters["voltage_limit"] == pytest.approx(99.2, rel=0.02)
    assert cause.parameters["supply_resistance"] > 0.0


@in_a_world
@pytest.mark.long
def test_a_command_averaged_over_many_samples_is_found_with_its_window(tmp_path):
    """32 samples; a value that stood at the end of its range hid that."""
    _, found = found_in_world(tmp_path, "simulated", ("input_delay",), 61000)
    (cause,) = found.causes
    assert cause.parameters["command_window"] == pytest.approx(3.17e-3, rel=0.03)


@in_a_world
@pytest.mark.long
def test_bristles_of_a_law_that_has_none_are_told_from_a_gap_and_a_spring(tmp_path):
    case, found = found_in_world(tmp_path, "heavy_screw", ("presliding_hysteresis",), 61000)
    (cause,) = found.causes
    assert cause.name == "presliding_hysteresis"
    low, high = cause.intervals["sigma0"]
    assert low < case.effects[0].truth["sigma0"] < high


@in_a_world
def test_a_load_is_named_where_an_asymmetry_adds_nothing_beside_it(tmp_path):
    case, found = found_in_world(tmp_path, "simulated", ("load_bias",), 61001)
    (cause,) = found.causes
    assert cause.name == "load_bias"
    assert cause.parameters["load"] == pytest.approx(case.effects[0].truth["load"], rel=0.02)


@in_a_world
def test_a_small_lead_names_nothing_where_the_drive_follows_within_a_sample(tmp_path):
    """Friction that drifts was called a winding that warms up; without a current they are alike."""
    _, found = found_in_world(tmp_path, "fast_screw", ("friction_drift",), 110000)
    assert found.causes == ()
    assert {n.name: n.like for n in found.not_named} == {"resistance_drift": "friction_drift"}


@in_a_world
def test_the_first_cause_is_named_where_those_found_beside_it_do_not_hold(tmp_path):
    """Two values called wrong beside it took away so much that nothing was named."""
    _, found = found_in_world(tmp_path, "heavy_screw", ("position_trend_friction",), 90003)
    assert [c.name for c in found.causes] == ["position_trend_friction"]


@in_a_world
def test_an_interval_holds_what_forms_that_explain_as_much_say(tmp_path):
    """Told dry and viscous apart, the dry part alone was called 7 %, give or take 2."""
    case, found = found_in_world(tmp_path, "heavy_screw", ("direction_asymmetry",), 100003)
    (cause,) = found.causes
    low, high = cause.intervals["dry_asymmetry"]
    assert low < case.effects[0].truth["dry_asymmetry"] < high


@in_a_world
def test_friction_is_not_said_to_vanish_where_nothing_is_hidden(tmp_path):
    """The engine before found a friction that falls by 90 % after the start."""
    _, found = found_in_world(tmp_path, "industrial", (), 61017)
    assert found.causes == ()


@in_a_world
def test_a_fault_that_grows_with_the_speed_is_not_taken_for_noise_that_does(tmp_path):
    """Viscous friction that differs by direction was `none` at seven times the white noise."""
    _, found = found_in_world(tmp_path, "simulated", ("direction_asymmetry",), 740024)
    assert found.verdict != "none"
    assert found.final_residual.force > 2.0 * found.floor.force


@in_a_world
def test_values_that_only_one_fast_part_of_a_faultless_record_tells_are_no_fault(tmp_path):
    """The rest of it does not know the mass; held out as a whole, that part was 11 N off."""
    _, found = found_in_world(tmp_path, "linear_drive", (), 730013)
    assert found.verdict == "none"
    (said,) = (n for n in found.notes if n.startswith("not ruled out: a fault of up to "))
    assert float(said.split()[8]) == pytest.approx(2.0 * found.floor.force, rel=0.01)


@pytest.mark.parametrize(
    ("hidden", "name", "size"),
    [(ASYMMETRY, "asymmetry", 0.2), ({at.LOAD: 0.26}, "load", 0.26)],
    ids=["asymmetry", "load"],
)
def test_a_load_and_an_asymmetry_are_told_apart_at_one_speed(hidden, name, size):
    """Both ways they are nearly one force; viscous friction and reversals differ."""
    time = np.arange(12_000) * 1e-3
    u = 3.0 * np.sign(np.sin(2 * math.pi * 0.1 * time + 0.1))
    signals = signals_of(moved(hidden, u, friction_noise(5, len(u))), u)
    del signals["i"]
    (cause,) = diagnose_records([check_record("made", signals)], nominal()).causes
    assert cause.parameters[name] == pytest.approx(size, rel=0.05)


@in_a_world
def test_of_two_causes_that_a_record_cannot_tell_apart_neither_is_named_alone(tmp_path):
    case = draw_world("linear_drive", ("load_bias",), 82000)
    records, prior_model = write_world(case, tmp_path)
    found = diagnose(records, params=prior_model)
    assert found.causes == ()
    assert [n.name for n in found.not_named if n.like] == ["direction_asymmetry"]
    assert "direction_asymmetry cannot be told from load_bias here" in found.next_experiment.says


def test_a_drive_that_stands_still_is_no_record():
    time = np.arange(3000) * 1e-3
    record = check_record("still", {"time": time, "u": np.ones(3000), "x": np.zeros(3000)})
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
    u, noise = to_and_fro(20_000), friction_noise(11, 20_000)
    temperature = 22.0 + 12.0 * np.cos(2 * math.pi * np.linspace(0.0, 1.0, len(u)))
    friction = moved({}, u, noise)[:, at.FRICTION]
    signals = signals_of(moved({}, u, noise + 0.01 * (temperature - 22.0) * friction), u)
    del signals["i"]
    thermometer = np.where(np.arange(len(u)) % 500 == 0, np.round(temperature, 1), np.nan)
    found = diagnose_records(
        [check_record("made", signals | {"temperature": thermometer})], nominal()
    )
    first = found.causes[0]
    assert first.name == "friction_drift"
    low, high = first.intervals["friction_per_kelvin"]
    assert low < 0.01 < high
    assert high - low < 0.005
