"""The report: its numbers are the result's, and names in others' files stay text."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pages import ALL, HOSTILE, Page, check_hostile
from slide_records import believed, slide_record

from ballscrew.measured_results import DiagnosisResult
from ballscrew.measurement.diagnosis.diagnose import diagnose_records
from ballscrew.measurement.diagnosis.diagnosis import Level, SuspectFound
from ballscrew.measurement.diagnosis.diagnosis_pictures import (
    binned,
    end_to_end,
    forces_figure,
    smoothed,
)
from ballscrew.measurement.diagnosis.report_words import length, of_friction, suspect_lines


@pytest.fixture(scope="module")
def found():
    """A diagnosis with one cause, which is certain."""
    return diagnose_records([slide_record("torque_ripple")], believed())


def text_of(diagnosis):
    """What a reader sees, as one line."""
    return Page(DiagnosisResult.of(diagnosis).report()).said


def test_the_numbers_of_the_report_are_those_of_the_result(found):
    said, (cause,) = text_of(found), found.causes
    for name, level in (
        ("prior model", found.baseline_residual),
        ("with all causes found *", found.final_residual),
        ("noise alone (floor)", found.floor),
    ):
        force, position = level.force / found.floor.force, level.position / found.floor.position
        row = f"{level.force:.4g} N {force:.3g} {length(level.position)} {position:.3g}"
        assert f"{name} {row}" in said
    low, high = cause.intervals["ripple_cos"]
    share, ends = 100 * cause.gain_heldout, [100 * g for g in cause.gain_interval]
    for words in (
        "torque_ripple explains the error of the model; the rest is noise.",
        f"ripple_cos {cause.parameters['ripple_cos']:.4g} N ({low:.4g} to {high:.4g})",
        f"{share:.3g} % of the mean square in force ({ends[0]:.3g} % to {ends[1]:.3g} %)",
        f"residual {cause.before:.4g} N to {cause.after:.4g} N; alone, ",
        f"{cause.force:.3g} N rms, {100 * cause.of_friction:.3g} % of the friction",
        f"probability {cause.probability:.2f}; for records like those of the calibration",
        f"would confirm it {cause.confirm}",
    ):
        assert words in said, words
    # 12 N of a cosine have a root mean square of 8.5 N
    assert cause.force == pytest.approx(12.0 / np.sqrt(2.0), rel=0.03)


def test_lengths_and_shares_have_the_unit_that_suits_them():
    assert [length(x) for x in (0.1, 0.0999, 1e-4, -9.99e-5)] == [
        *("0.1 m", "99.9 mm", "0.1 mm", "-99.9 µm")
    ]
    assert [of_friction(s) for s in (1.99, 2.0)] == [
        *("199 % of the friction", "2 times the friction")
    ]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"verdict": "none", "causes": ()}, "These records show no error of the model"),
        ({"verdict": "partly"}, "torque_ripple explains part of the error of the model: on held"),
        ({"verdict": "partly", "unnamed": ("with time",)}, "no cause in the catalogue: it varies"),
        ({"verdict": "unexplained", "causes": ()}, "and no cause is certain"),
        (
            {"verdict": "undecided", "causes": (), "unseen": 0.25},
            "a fault up to 25 % of the friction would not be seen",
        ),
        (
            {"alternatives": {"torque_ripple": ("load_bias",)}},
            "N) or load_bias explain the error of the model: the rest is noise, and these records",
        ),
        ({"verdict": "partly", "final_residual": Level(0.7, 1.0)}, "Do not rely on it"),
        ({"verdict": "partly", "gain_interval": (-0.1, 0.3)}, "but this is not confirmed"),
    ],
)
def test_each_verdict_is_a_sentence(found, changes, words):
    assert words in text_of(replace(found, **changes))
    assert words not in text_of(found)


def test_suspects_are_told_with_size_and_force(found):
    sizes = {"parameters": {"scale_of_u": 0.577}, "intervals": {"scale_of_u": (0.57, 0.59)}}
    rest = {"units": {"scale_of_u": "1"}, "force": 39.0, "of_friction": 7.5, "confirm": "a meter"}
    scale = SuspectFound(name="scale_of_u", says="a scale", probability=0.75, **sizes, **rest)
    other = replace(scale, name="outside the catalogue", parameters={}, intervals={}, units={})
    changes = {"verdict": "unexplained", "causes": (), "suspects": (scale, other)}
    said = text_of(replace(found, **changes))
    assert "It is one of scale of u or outside the catalogue." in said
    assert "The command fits with a factor of 0.577: check its unit." in said
    assert "scale_of_u = 0.577 1 (0.57 to 0.59) 39 N 7.5 times the friction 0.75 a meter" in said
    lines = "\n".join(suspect_lines((scale, other)))
    assert "scale_of_u = 0.577  0.57 .. 0.59" in lines
    assert "a scale; 39 N rms, 7.5 times the friction; probability 0.75" in lines


def test_names_that_are_meant_badly_stay_text(found):
    words = {"name": ALL, "says": ALL, "confirm": ALL, "parameters": {ALL: 1.0}}
    cause = replace(found.causes[0], **words, intervals={ALL: (0.9, 1.1)}, units={ALL: ALL})
    changes = {"causes": (cause,), "records": HOSTILE, "notes": HOSTILE, "where": ALL}
    check_hostile(DiagnosisResult.of(replace(found, **changes)).report())


def test_what_is_unnamed_is_drawn_and_what_was_not_found_is_not(found):
    curves, shaped = found.curves, np.ones(len(found.curves.x))

    def drawn(**changes):
        figure = forces_figure(replace(found, curves=replace(curves, **changes)))
        return [line.get_label() for axes in figure.axes for line in axes.lines]

    models = ["measured", "prior model", "corrected"]
    assert drawn() == [*models, "named causes"]
    assert drawn(cause=0 * shaped) == models
    assert drawn(shape=shaped) == [*models, "named causes", "no known cause"]


def test_records_follow_each_other_and_are_neither_joined_nor_mixed(found):
    record = np.repeat([0, 1], 4000)
    twice = np.tile(found.curves.time[:4000], 2)
    time = end_to_end(replace(found.curves, record=record, time=twice))
    assert np.flatnonzero(np.isnan(time)).tolist() == [3999]
    assert time[4000] == pytest.approx(4.0)
    assert np.array_equal(smoothed(record.astype(float), record, 1e-3), record)


def test_means_by_position_leave_out_what_hardly_was_there():
    x = np.concatenate([np.linspace(0, 1, 6000), [2.0]])
    place, mean = binned(x, 3.0 * np.ones(6001), np.ones(6001, dtype=bool))
    assert np.all(mean[place < 0.9] == 3.0)
    assert np.all(np.isnan(mean[place > 1.1]))
