"""Models beside records whose truth is known, most of all the three models of a diagnosis."""

import dataclasses
import math

import numpy as np
import pytest
from axis_records import NOMINAL, friction_noise, gap, moved, signals_of

from ballscrew.measurement.diagnosis.compare import compare_records
from ballscrew.measurement.records.reading import check_record
from ballscrew.orchestration.loop.parameter_file import Diagnosed, ParameterFile, Value

pytestmark = pytest.mark.ci


LOAD = 0.5
TRUTH = dict(NOMINAL)


def a_record(effects, seed, name="other.csv", **more):
    time = np.arange(12_000) * 1e-3
    u = 3.0 * np.sin(2 * math.pi * 0.6 * time) + 1.5 * np.sin(2 * math.pi * 1.7 * time + seed)
    signals = signals_of(moved(effects, u, friction_noise(seed, len(u))), u)
    del signals["i"]
    return check_record(name, signals | more)


def a_file(prior_model=None, adjusted=None, corrected=None, causes=None, **more):
    """What a diagnosis leaves that started at `prior` and named `causes`."""
    prior_model = {**TRUTH, **(prior_model or {})}
    adjusted = {**prior_model, **(adjusted or {})}
    told = Diagnosed(
        ("one.csv",), "voltage", 0.0, "modified_lugre", prior_model, adjusted, causes or {}
    )
    values = {n: Value(v) for n, v in {**adjusted, **(corrected or {})}.items()}
    return ParameterFile(plant=values, diagnosis=dataclasses.replace(told, **more))


@pytest.fixture(scope="module")
def loaded():
    return a_record({"load": LOAD}, 3)


def test_a_cause_that_is_there_gains_and_its_model_comes_down_to_the_noise(loaded):
    found = compare_records([loaded], a_file(causes={"load_bias": {"load": LOAD}}))
    parts = found.models["prior"]
    prior_model, corrected = parts["all"], found.models["corrected"]["all"]
    # the load alone is the gap: what is left beside it is the noise of the friction
    assert prior_model.force.value == pytest.approx(
        math.hypot(LOAD, corrected.force.value), rel=0.05
    )
    assert corrected.force.value < 1.5 * found.floor.force.value < 0.2 * LOAD
    low, high = prior_model.force.interval
    assert low < prior_model.force.value < high
    gain = next(g for g in found.gains if (g.model, g.over) == ("corrected", "adjusted"))
    assert gain.force.value > 0.95
    assert 0.9 < gain.force.interval[0] < gain.force.value < gain.force.interval[1] <= 1.0
    assert gain.position.interval[0] > 0.5
    assert corrected.position.value < 5e-6 < 0.1 * prior_model.position.value
    # a load is the same wherever one looks
    for part in set(parts) - {"rest"}:
        assert parts[part].force.value == pytest.approx(LOAD, rel=0.15), part
    assert found.shares["forwards"] + found.shares["backwards"] == pytest.approx(1.0)


def test_a_cause_that_is_not_there_loses(loaded):
    found = compare_records([loaded], a_file(causes={"load_bias": {"load": -LOAD}}))
    gain = next(g for g in found.gains if (g.model, g.over) == ("corrected", "adjusted"))
    assert gain.force.interval[1] < 0.0
    assert gain.position.interval[1] < 0.0


def test_an_error_of_the_diagnosed_signals_is_left_aside(loaded):
    causes = {"scale_of_u": {"scale_of_u": 0.5}, "load_bias": {"load": LOAD}}
    found = compare_records([loaded], a_file(causes=causes))
    assert found.causes == ("load_bias",)
    assert found.models["corrected"]["all"].force.value < 0.2 * LOAD
    assert any(note.startswith("left aside: scale_of_u, wrong in the") for note in found.notes)


def test_values_adjusted_are_compared_with_the_prior_ones():
    record = a_record({}, 4)
    wrong = {"sigma2": 1.2 * TRUTH["sigma2"]}
    found = compare_records(
        [record], a_file(prior_model=wrong, adjusted={"sigma2": TRUTH["sigma2"]})
    )
    gain = next(g for g in found.gains if (g.model, g.over) == ("adjusted", "prior"))
    assert gain.force.interval[0] > 0.5
    nothing = next(g for g in found.gains if (g.model, g.over) == ("corrected", "adjusted"))
    assert (nothing.force.value, nothing.position.value) == (0.0, 0.0)
    # too much viscous friction shows where it is fast
    parts = found.models["prior"]
    assert parts["fast"].force.value > 2 * parts["slow"].force.value


@pytest.mark.parametrize(
    ("effects", "corrected", "causes"),
    [
        ({"block_mass": 9.0}, {"m": 9.0}, {"unmodelled_inertia": {"m": 9.0}}),
        ({"delay": 4e-3}, {}, {"input_delay": {"delay": 4e-3}}),
        (gap(5e-5), {}, {"backlash": {"gap": 5e-5}}),
    ],
    ids=["value", "command", "gap"],
)
def test_causes_of_every_kind_are_along_the_other_record_what_they_were(effects, corrected, causes):
    record = a_record(effects, 5)
    found = compare_records([record], a_file(corrected=corrected, causes=causes))
    gain = next(g for g in found.gains if (g.model, g.over) == ("corrected", "adjusted"))
    assert gain.force.interval[0] > 0.0
    # its plant, or the command that it makes, moves as the record does
    assert gain.position.interval[0] > 0.5
    assert found.models["corrected"]["all"].position.value < 5e-6


def test_a_short_record_has_figures_and_no_intervals():
    record = a_record({"load": LOAD}, 6)
    short = check_record("short", {n: s[:2500] for n, s in record.signals.items()})
    found = compare_records([short], a_file(causes={"load_bias": {"load": LOAD}}))
    assert found.models["prior"]["all"].force.interval is None
    assert found.to_dict()["models"]["prior"]["all"]["force"]["interval_N"] is None
