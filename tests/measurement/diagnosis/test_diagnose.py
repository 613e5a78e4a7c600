"""The diagnosis on records in which an effect is hidden.

Of a slide on a prescribed motion first, then of simulated axes, then a sample of the worlds.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from axis_records import friction_noise, gap, moved, signals_of, strong_record, to_and_fro
from diagnosed import nominal
from slide_records import believed, slide_record
from worlds import draw_case, write_case

from ballscrew import (
    compare,
    diagnose,
    identify,
    read_drive_records,
    read_parameters,
    run_trial,
)
from ballscrew.measurement.diagnosis.causes.travel import periods
from ballscrew.measurement.diagnosis.compare import compare_records
from ballscrew.measurement.diagnosis.diagnosis import diagnose_records
from ballscrew.measurement.diagnosis.motion import courses_of
from ballscrew.measurement.diagnosis.report import verdict_sentence
from ballscrew.measurement.diagnosis.scores import OUTSIDE
from ballscrew.measurement.records.reading import FORCE_RECORD, check_record
from ballscrew.solver.errors import BadRecord

EMPS = Path(__file__).parents[3] / "docs" / "emps.toml"
in_a_world = pytest.mark.xdist_group("worlds")  # whose simulators are compiled once

TRUTH = {
    "load_bias": ({"load": 0.4}, "load", 0.4),
    "backlash": (gap(1e-4), "gap", 1e-4),
    "friction_drift": ({"drift": 0.24, "drift_viscous": 0.24}, "friction_drift", 0.24),
    "voltage_saturation": ({"limit": 3.2}, "voltage_limit", 3.2),
}
OTHERS = ("friction_drift", "voltage_saturation")


def answer_of(found):
    """All that may be true by an answer."""
    return {c.name for c in (*found.causes, *found.suspects)}


# -- a slide on a prescribed motion ------------------------------------------------------------


@pytest.mark.parametrize(
    ("effect", "sizes"),
    [
        ("unmodelled_inertia", {"m": 50.0}),
        ("torque_ripple", {"ripple_cos": 12.0, "ripple_sin": 0.0, "ripples_per_metre": 50}),
        ("direction_asymmetry", {"dry_asymmetry": 0.2}),
        ("position_periodic_friction", {"friction_cos": 0.2, "periods_per_metre": 50}),
    ],
)
def test_a_hidden_effect_is_named_with_its_size(effect, sizes):
    found = diagnose_records([slide_record(effect)], believed())
    (cause,) = found.causes
    assert (found.verdict, cause.name, cause.certain) == ("explained", effect, True)
    assert (found.suspects, found.next_experiment) == ((), None)
    for name, size in sizes.items():
        value = cause.parameters[name]
        assert value == pytest.approx(size, rel=0.02, abs=0.05 if size == 0.0 else None), name
        if name in cause.intervals:  # what a grid finds has none
            low, high = cause.intervals[name]
            assert low < size < high
            assert high - low < 0.1 * size or size == 0.0
    assert cause.gain_heldout > cause.gain_interval[0] > 0.99
    assert found.final_residual.force < 0.5 * found.adjusted_residual.force
    if effect == "unmodelled_inertia":  # it is in the model once
        assert found.corrected.values["m"] == pytest.approx(cause.parameters["m"])


@pytest.mark.parametrize(("noise", "count"), [(1.0, 1e-6), (8.0, 1e-5)])
def test_nothing_hidden_is_called_nothing(noise, count):
    found = diagnose_records([slide_record(seed=2, noise=noise, count=count)], believed())
    assert (found.verdict, found.causes, found.suspects) == ("none", (), ())
    within = {"m": 0.03, "Fc": 0.05, "sigma2": 0.05}
    assert found.adjustments.keys() == within.keys()
    assert all(abs(c) < 0.5 * within[n] for n, c in found.adjustments.items())
    # reversals within a sample make most of it
    assert found.final_residual.force == pytest.approx(found.floor.force, rel=0.1)
    assert found.floor.force == pytest.approx(3.25, rel=0.03)
    assert found.notes == ()
    friction = found.floor.force * 2.0 / found.unseen
    assert friction == pytest.approx(np.sqrt(np.mean(found.curves.predicted**2)), rel=0.1)
    assert found.next_experiment.says.startswith("these records show no fault; ")


@pytest.mark.ci
def test_where_more_than_a_fifth_of_the_friction_would_not_be_seen_nothing_is_decided():
    """The noise of the force is as large as the friction; a filter of the command takes it out."""
    found = diagnose_records([slide_record(seed=2, noise=100.0)], believed())
    assert (found.verdict, found.causes) == ("undecided", ())
    friction = np.sqrt(np.mean(found.curves.predicted[found.curves.telling] ** 2))
    unseen = max(2.0 * found.floor.force, found.final_residual.force) / friction
    assert found.unseen == pytest.approx(unseen, rel=0.02)
    assert found.unseen > 0.2
    sentence = f"A fault up to {100 * found.unseen:.3g} % of the friction would not be seen."
    assert sentence in verdict_sentence(found)


@pytest.mark.parametrize("command", [diagnose, compare])
def test_without_a_record_it_is_said_what_is_missing(command):
    with pytest.raises(BadRecord, match="expected one file of measured data"):
        command([], EMPS)


@pytest.mark.ci
@pytest.mark.parametrize("count", [20, 60, 300])
def test_short_records_have_results(count):
    time = 5e-3 * np.arange(count)
    for x in np.round(2e-2 * np.sin(20 * time), 5), 0.05 * time**2:
        v = np.gradient(x, 5e-3)
        force = 80.0 * np.sign(v) + 200.0 * v + np.random.default_rng(1).standard_normal(count)
        made = {"time": time, "x": x, "force": force, "u": np.full(count, 9.0)}
        assert identify([check_record("short", made, use=FORCE_RECORD)], "lugre").parameters
        if count == 300:
            record = check_record("short", made, "force")
            assert compare_records([record], read_parameters(EMPS)).models
            assert diagnose_records([record], believed()).verdict


def test_where_no_force_is_missing_no_swing_is_tried():
    assert periods(courses_of([slide_record()], believed()), believed(), "swings", [1]) == []


@pytest.mark.ci
def test_a_corrected_position_is_not_predicted_and_the_answer_says_so():
    record = slide_record()
    stretched = check_record("made", record.signals | {"x": 1.3 * record.x}, "force")
    found = diagnose_records([stretched], believed())
    (cause,) = found.causes
    assert (found.verdict, cause.name) == ("explained", "scale_of_x")
    assert cause.parameters["scale_of_x"] == pytest.approx(1.0 / 1.3, rel=0.03)
    assert found.adjusted_residual.position > 0.0
    assert (found.final_residual.position, found.floor.position) == (None, None)
    assert found.notes[0].startswith("no position is predicted: the recorded position itself")


def test_what_has_no_cause_is_given_no_name():
    found = diagnose_records([slide_record("a bump")], believed())
    assert (found.verdict, found.causes) == ("unexplained", ())
    assert [s.name for s in found.suspects] == [OUTSIDE]
    assert found.unnamed == ("with position",)
    assert found.next_experiment.says == "part of the residual has no known cause"
    # the free curve has the bump's height at its place
    curves = found.curves
    top = np.abs(curves.x - 0.03) < 2e-3
    assert np.median(np.abs(curves.shape[top])) == pytest.approx(25.0, rel=0.2)


def test_two_effects_are_both_built_in_with_their_sizes_and_one_is_named():
    both = ("unmodelled_inertia", "position_periodic_friction")
    found = diagnose_records([slide_record(*both)], believed())
    mass, periodic = sorted(found.causes, key=lambda c: both.index(c.name))
    assert found.verdict == "explained"  # only noise is left
    assert [c.certain for c in (periodic, mass)] == [True, False]
    assert mass.parameters["m"] == pytest.approx(50.0, rel=0.01)
    assert periodic.parameters["friction_cos"] == pytest.approx(0.2, rel=0.02)


@pytest.mark.ci
def test_each_record_may_have_an_offset_of_its_own():
    first, second = slide_record(), slide_record("load_bias", seed=2)
    found = diagnose_records([replace(first, name="first"), second], believed())
    assert not found.causes
    (note,) = (n for n in found.notes if n.startswith("additional offsets to that of first: "))
    assert float(note.split()[6]) == pytest.approx(8.0, rel=0.02)


# -- simulated axes ----------------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize(
    "effect", ["load_bias", "backlash", *(pytest.param(e, marks=pytest.mark.prove) for e in OTHERS)]
)
def test_a_hidden_effect_of_the_axis_is_built_in_alone_and_has_its_size(effect):
    _, name, size = TRUTH[effect]
    found = diagnose_records([strong_record(TRUTH[effect][0])], nominal())
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


def test_a_wrong_friction_is_named_from_a_trial_of_the_rig_and_noise_is_below_the_error(tmp_path):
    """The noise of speeds times the damping of the motor is averaged out by longer windows."""
    run_trial("2.6/6", values={"plant.Fc": 1.8}).save(tmp_path)
    found = diagnose_records(read_drive_records([tmp_path / "record.csv"]), nominal())
    (cause,) = found.causes
    assert (found.verdict, cause.name, cause.certain) == ("explained", "parameter_error", True)
    assert cause.parameters["Fc"] == pytest.approx(1.8, rel=0.03)
    assert found.floor.force < 0.2 * found.baseline_residual.force
    assert found.final_residual.force < 1.2 * found.floor.force


@pytest.mark.ci
def test_a_resistance_that_grows_is_told_from_friction_by_the_current():
    record = strong_record({"r_drift": 0.18}, with_current=True)
    found = diagnose_records([record], nominal())
    (cause,) = found.causes
    assert (found.verdict, cause.name, cause.certain) == ("explained", "resistance_drift", True)
    assert cause.parameters["R_drift"] == pytest.approx(0.18, rel=0.05)


@pytest.mark.ci
def test_what_is_more_than_noise_and_not_found_is_a_suspect_with_its_size():
    found = diagnose_records([strong_record({"load": 0.06})], nominal())
    assert (found.verdict, found.causes) == ("undecided", ())
    sizes = {s.name: s.parameters for s in found.suspects}
    assert sizes["load_bias"]["load"] == pytest.approx(0.06, rel=0.1)
    assert f"It may be {found.suspects[0].name}" in verdict_sentence(found)
    assert found.suspects[0].name in found.next_experiment.says
    assert "too low to be found" in found.notes[-1]


@pytest.mark.ci
def test_two_effects_are_both_in_the_answer_and_built_in_where_one_is_taken(tmp_path):
    hidden = {"load": 0.5, "periodic": 0.5, "period": 1e-3, "period_phase": 1.0}
    record, both = strong_record(hidden), {"position_periodic_friction", "load_bias"}
    assert both <= answer_of(diagnose_records([record], nominal()))
    found = diagnose_records([record], nominal(), take="position_periodic_friction")
    assert both <= answer_of(found)
    found.save(tmp_path / "out")
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [c["name"] for c in said["causes"]] == [c.name for c in found.causes]
    assert said["floor"]["force_N"] > 0


def found_in_world(tmp_path, world, effects, seed):
    case = draw_case(world, effects, seed)
    records, prior_model = write_case(case, tmp_path)
    return case, diagnose(records, params=prior_model)


@in_a_world
@pytest.mark.ci
@pytest.mark.parametrize(
    ("world", "seed", "verdict"),
    [
        ("simulated", 82001, "undecided"),
        ("fast_screw", 82002, "undecided"),
        ("linear_drive", 730013, "none"),
    ],
)
def test_nothing_is_named_where_nothing_is_hidden(tmp_path, world, seed, verdict):
    """On each of these an engine before this one had something to say."""
    _, found = found_in_world(tmp_path, world, (), seed)
    assert not [c for c in found.causes if c.certain]
    assert found.verdict == verdict


@in_a_world
@pytest.mark.ci
def test_what_gains_nothing_beside_a_later_cause_is_not_built_in(tmp_path):
    """A wrong sign of the position was built in first, and let the error grow by 150 %."""
    _, found = found_in_world(tmp_path, "slow_noise", ("sign_of_u",), 2_500_000)
    assert found.causes
    assert min(c.gain_interval[0] for c in found.causes) > 0.0


@in_a_world
@pytest.mark.ci
@pytest.mark.parametrize(("effects", "seed"), [((), 61017), (("load_bias",), 2_000_000)])
def test_an_axis_that_vibrates_is_refused(tmp_path, effects, seed):
    with pytest.raises(BadRecord, match="the axis vibrates"):
        found_in_world(tmp_path, "industrial", effects, seed)


@pytest.mark.prove
def test_friction_that_follows_a_thermometer_is_told_per_degree():
    """A screw that cools down and warms up again: no growth in time would do."""
    u, noise = to_and_fro(20_000), friction_noise(11, 20_000)
    temperature = 22.0 + 12.0 * np.cos(2 * math.pi * np.linspace(0.0, 1.0, len(u)))
    friction = moved({}, u, noise)["friction"]
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
