"""The report: its numbers are the result's, and names in others' files stay text."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pages import ALL, HOSTILE, Page, check_hostile
from slide_records import believed, slide_record

from ballscrew.measured_results import DiagnosisResult
from ballscrew.measurement.diagnosis.diagnosis import diagnose_records
from ballscrew.measurement.diagnosis.held_out import Level
from ballscrew.measurement.diagnosis.report import binned, diagnosis_figure
from ballscrew.orchestration.loop.shown import length


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
        ("your model", found.baseline_residual),
        ("with the causes found *", found.final_residual),
        ("noise alone", found.floor),
    ):
        share = f"{100 * level.force / found.friction:.3g} %"
        assert f"{name} {level.force:.4g} N {share} {length(level.position)}" in said
    low, high = cause.intervals["ripple_cos"]
    share, ends = 100 * cause.gain_heldout, [100 * g for g in cause.gain_interval]
    for words in (
        f"ripple_cos = {cause.parameters['ripple_cos']:.4g} N ({low:.4g} to {high:.4g})",
        f"{share:.3g} % ({ends[0]:.3g} % to {ends[1]:.3g} %)",
        f"named ripple_cos = {cause.parameters['ripple_cos']:.4g} N",
        f"{cause.force:.3g} N {100 * cause.of_friction:.3g} %",
        cause.confirm,
    ):
        assert words in said, words
    # 12 N of a cosine have a root mean square of 8.5 N, beside 80 N and 200 N*s/m of friction
    assert cause.force == pytest.approx(12.0 / np.sqrt(2.0), rel=0.03)
    v = found.curves.v
    friction = np.sqrt(np.mean((80.0 * np.sign(v) + 200.0 * v) ** 2))
    assert found.friction == pytest.approx(friction, rel=0.03)


def test_the_size_of_a_wave_is_its_largest_amplitude(found):
    sizes = {"ripple_cos_1": 0.15, "ripple_sin_1": -0.2, "ripple_cos_2": 0.6, "ripple_sin_2": 0.8}
    cause = replace(found.causes[0], parameters=sizes, units=dict.fromkeys(sizes, "N"))
    assert "torque_ripple (amplitude = 1 N). The" in text_of(replace(found, causes=(cause,)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"verdict": "none", "causes": ()}, "no fault seen: The model's force is wrong by"),
        ({"verdict": "partly", "unseen": 0.07}, "A fault up to 7 % of the friction would not be"),
        ({"unnamed": ("with time",)}, "What is left varies with time; no known cause does this."),
        ({"verdict": "undecided", "causes": (), "unseen": 2.5}, "up to 2.5 times the friction"),
        ({"alternatives": {"torque_ripple": ("load_bias",)}}, "N) or load_bias. The model's force"),
        ({"verdict": "partly", "final_residual": Level(0.7, 1.0)}, "do not rely on it"),
        ({"verdict": "partly", "gain_interval": (-0.1, 0.3)}, "not confirmed on held-out data"),
    ],
)
def test_each_verdict_is_a_sentence(found, changes, words):
    assert words in text_of(replace(found, **changes))
    assert words not in text_of(found)


def test_suspects_are_told_with_size_and_force(found):
    sizes = {"parameters": {"scale_of_u": 0.577}, "intervals": {"scale_of_u": (0.57, 0.59)}}
    rest = {"units": {"scale_of_u": "1"}, "force": 39.0, "of_friction": 7.5, "confirm": "a meter"}
    told = {"name": "scale_of_u", "says": "a scale", "score": 175.4, "lead": 60.0}
    scale = replace(found.causes[0], **told, **sizes, **rest)
    other = replace(scale, name="outside the catalogue", parameters={}, intervals={}, units={})
    changes = {"verdict": "unexplained", "causes": (), "suspects": (scale, other)}
    said = text_of(replace(found, **changes))
    assert "It may be scale_of_u. " in said
    assert "The command fits with a factor of 0.577: check its unit." in said
    assert "scale_of_u = 0.577 (0.57 to 0.59) 39 N 750 % 175, 60" in said


def test_names_that_are_meant_badly_stay_text(found):
    words = {"name": ALL, "says": ALL, "confirm": ALL, "parameters": {ALL: 1.0}}
    cause = replace(found.causes[0], **words, intervals={ALL: (0.9, 1.1)}, units={ALL: ALL})
    changes = {"causes": (cause,), "records": HOSTILE, "notes": HOSTILE}
    check_hostile(DiagnosisResult.of(replace(found, **changes)).report())


def test_the_picture_says_what_the_error_goes_with(found):
    """An error that is a step at a place; two records, whose times follow each other."""
    c = found.curves
    half = len(c.x) // 2
    twice = {"time": np.tile(c.time[:half], 2), "record": np.repeat([0, 1], half)}
    rest = {n: getattr(c, n)[: 2 * half] for n in ("x", "v", "telling", "after")}
    before = 5.0 * np.sign(rest["x"] - np.median(rest["x"]))
    changed = replace(c, **twice, **rest, before=before)
    place, speed, since, time = diagnosis_figure(replace(found, curves=changed)).axes
    shares = [int(axes.get_title(loc="left").partition(" %")[0]) for axes in (place, speed, time)]
    assert shares[0] > 95 > 60 > shares[1]
    drawn = np.concatenate([line.get_ydata() for line in place.lines[:2]])
    assert np.nanmax(np.abs(drawn)) == pytest.approx(5.0)
    assert [line.get_linestyle() for line in place.lines[:2]] == ["-", "--"]
    ends = max(line.get_xdata().max() for line in time.lines[:2])
    assert ends == pytest.approx(2 * c.time[half], rel=0.03)
    turns = np.flatnonzero(np.diff(np.sign(rest["v"])) + 3 * np.diff(twice["record"]))
    longest = max(line.get_xdata().max() for line in since.lines[:2])
    assert longest / 1e3 == pytest.approx(np.diff(turns).max() * c.time[1], rel=0.05)


def test_means_by_position_leave_out_what_hardly_was_there():
    x = np.concatenate([np.linspace(0, 1, 6000), [2.0]])
    place, mean = binned(x, 3.0 * np.ones(6001), np.ones(6001, dtype=bool))
    assert np.all(mean[place < 0.9] == 3.0)
    assert np.all(np.isnan(mean[place > 1.1]))
