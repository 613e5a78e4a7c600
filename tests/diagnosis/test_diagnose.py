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
from ballscrew.diagnosis.drive import read_drive
from ballscrew.diagnosis.scores import OUTSIDE
from ballscrew.records.bad_record import BadRecord
from ballscrew.records.reading import check_record, read_drive_records

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


def answer_of(found):
    """All that may be true by an answer."""
    return {c.name for c in (*found.causes, *found.suspects)}


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
def test_a_hidden_effect_is_built_in_alone_and_has_its_size(effect):
    _, name, size = TRUTH[effect]
    found = found_of(effect)
    (cause,) = found.causes
    assert cause.name == effect
    if name not in cause.parameters:  # a form with one number for the dry friction
        name = f"dry_{name}"
    assert cause.parameters[name] == pytest.approx(size, rel=0.08)
    low, high = cause.intervals[name]
    assert low < size < high
    assert cause.certain
    assert cause.gain_heldout > 0.5
    assert cause.gain_interval[0] > 0.0
    assert cause.force > 0.02 * found.curves.telling.mean()
    assert found.final_residual.force < 0.5 * found.adjusted_residual.force


def test_a_resistance_that_grows_is_told_from_friction_by_the_current():
    record = strong_record({at.R_DRIFT: 0.18}, with_current=True)
    found = diagnose_records([record], nominal())
    (cause,) = found.causes
    assert (found.verdict, cause.name, cause.certain) == ("explained", "resistance_drift", True)
    assert cause.parameters["R_drift"] == pytest.approx(0.18, rel=0.05)


def test_nothing_hidden_is_called_nothing():
    found = diagnose_records([strong_record({}, samples=6_000)], nominal())
    assert found.verdict == "none"
    assert found.causes == ()
    assert all(abs(change) <= 0.03 + 1e-9 for change in found.adjustments.values())
    (said,) = (n for n in found.notes if n.startswith("not excluded: a fault of up to "))
    assert float(said.split()[7]) >= 2.0 * found.floor.force * 0.99


def test_what_no_cause_has_is_not_given_a_name():
    found = diagnose_records([strong_record(NOTCH)], nominal())
    assert found.verdict == "unexplained"
    assert found.causes == ()
    assert found.suspects[0].name == OUTSIDE
    assert found.unnamed == ("with position",)
    assert np.any(found.curves.shape)


def test_two_effects_are_both_in_the_answer_and_built_in_where_one_is_taken(tmp_path):
    hidden = {at.LOAD: 0.5, at.PERIODIC: 0.5, at.PERIOD: 1e-3, at.PERIOD_PHASE: 1.0}
    record, both = strong_record(hidden), {"position_periodic_friction", "load_bias"}
    assert both <= answer_of(diagnose_records([record], nominal()))
    found = diagnose_records([record], nominal(), take="position_periodic_friction")
    assert both <= answer_of(found)
    found.save(tmp_path / "out")
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [c["name"] for c in said["causes"]] == [c.name for c in found.causes]
    assert said["floor"]["force_N"] > 0


def test_the_last_digits_of_a_record_do_not_change_the_answer():
    record = strong_record(LIMITED, samples=6_000)
    sizes = []
    for change in (-1e-13, 0.0, 1e-13):
        signals = {**record.signals, "u": record.signals["u"] * (1.0 + change)}
        cause = diagnose_records([check_record("made", signals)], nominal()).causes[0]
        assert cause.name == "voltage_saturation"
        sizes.append(cause.parameters["voltage_limit"])
    assert np.ptp(sizes) < 1e-6


def test_a_value_at_the_end_of_its_tolerance_is_said():
    record = strong_record({at.KT: 1.12 * NOMINAL["kt"] * TURN})  # kt and R are believed within 3 %
    found = diagnose_records([record], nominal())
    (note,) = (n for n in found.notes if n.startswith("at their limit: "))
    assert "kt" in note


@in_a_world
def test_each_record_may_have_an_offset_of_its_own(tmp_path):
    """The second half of a faultless record, as if another force pulled at it."""
    paths, parameters = write_world(draw_world("linear_drive", (), 82000), tmp_path)
    (record,) = read_drive_records(paths)
    prior_model = read_drive(parameters)
    half, more = len(record.x) // 2, 0.2 * prior_model.friction_scale
    pulled = record.signals["u"] + more / prior_model.values["gain"]
    parts = [
        check_record("first", {n: s[:half] for n, s in record.signals.items()}),
        check_record("second", {n: s[half:] for n, s in (record.signals | {"u": pulled}).items()}),
    ]
    found = diagnose_records(parts, prior_model)
    assert not found.causes
    (note,) = (n for n in found.notes if n.startswith("additional offsets to that of first: "))
    assert float(note.split()[6]) == pytest.approx(more, rel=0.1)  # friction noise lasts


def found_in_world(tmp_path, world, effects, seed):
    case = draw_world(world, effects, seed)
    records, prior_model = write_world(case, tmp_path)
    return case, diagnose(records, params=prior_model)


@in_a_world
@pytest.mark.parametrize(
    ("world", "seed", "verdict"),
    [
        ("simulated", 82001, "none"),
        ("industrial", 61017, "unexplained"),  # one of the three in a hundred
        ("fast_screw", 82002, "none"),
        ("linear_drive", 730013, "none"),
    ],
)
def test_nothing_is_named_where_nothing_is_hidden(tmp_path, world, seed, verdict):
    """On each of these an engine before this one had something to say."""
    _, found = found_in_world(tmp_path, world, (), seed)
    assert not [c for c in found.causes if c.certain]
    assert found.verdict == verdict


@in_a_world
@pytest.mark.parametrize(
    ("world", "effect", "seed"),
    [
        ("heavy_screw", "position_trend_friction", 90003),
        ("heavy_screw", "direction_asymmetry", 100003),
        pytest.param("industrial", "voltage_saturation", 61000, marks=pytest.mark.long),
        pytest.param("simulated", "input_delay", 61000, marks=pytest.mark.long),
        pytest.param("heavy_screw", "nonlinear_viscous", 61000, marks=pytest.mark.long),
    ],
)
def test_a_hidden_effect_of_a_world_is_built_in_with_its_size(tmp_path, world, effect, seed):
    case, found = found_in_world(tmp_path, world, (effect,), seed)
    assert found.verdict != "none"
    cause = found.causes[0]
    assert cause.name == effect
    truth = case.effects[0].truth
    for name in truth.keys() & cause.intervals.keys():
        low, high = cause.intervals[name]
        near = 0.1 * abs(truth[name])  # one in twenty is just beside its interval
        assert low - near < truth[name] < high + near, name


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
    cause = diagnose_records([check_record("made", signals)], nominal()).causes[0]
    assert cause.parameters[name] == pytest.approx(size, rel=0.08)


@in_a_world
def test_two_causes_that_a_record_cannot_tell_apart_are_both_in_the_answer(tmp_path):
    _, found = found_in_world(tmp_path, "linear_drive", ("load_bias",), 82000)
    assert {"load_bias", "direction_asymmetry"} <= answer_of(found)
    assert not [c for c in found.causes if c.certain]
    assert found.next_experiment.says.startswith("these records cannot distinguish ")


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
