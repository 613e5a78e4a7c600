"""Scores of suspects: against least squares done by hand, and on noise alone."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from axis_records import friction_noise, gap, moved, signals_of, strong_record
from diagnosed import nominal
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.stats import multivariate_t
from scipy.stats import t as student
from slide_records import believed, slide_record

from ballscrew.measurement.diagnosis.bands import Bands
from ballscrew.measurement.diagnosis.causes import CAUSES
from ballscrew.measurement.diagnosis.fit import (
    COARSE,
    FREEDOM,
    Priors,
    fitted,
    study_of,
    within_most,
)
from ballscrew.measurement.diagnosis.scores import Catalogue, gain_of, scored
from ballscrew.measurement.records.reading import check_record

ROWS, COLUMNS, BLOCKS, BANDS = 100, 3, 5, 2
EXACT = 1e-3


def drawn(seed, amplitude, sizes):
    """Columns of blocks and bands, the signal first, and how the bands are cut."""
    random = np.random.default_rng(seed)
    columns = random.standard_normal((BLOCKS, BANDS, ROWS, COLUMNS))
    noise = random.standard_normal((BLOCKS, BANDS, ROWS)) * np.array(sizes)[None, :, None]
    signal = columns @ amplitude + noise
    data = np.concatenate([signal[..., None], columns], axis=3)
    counts = np.full((BLOCKS, BANDS), float(ROWS))
    return data, Bands([], np.ones(BANDS, dtype=bool), counts, np.inf)


def fit_of(data, bands, columns=COLUMNS, spread=1e6, most=np.inf):
    chosen = data[..., : 1 + columns]
    inner = np.einsum("qbri,qbrj->qbij", chosen, chosen)[:, :, None]
    one = np.ones((1, columns))
    return fitted(inner, bands, Priors(0.0 * one, spread**-2.0 * one, most * one), EXACT)


def test_amplitudes_are_those_of_weighted_least_squares():
    amplitude, sizes = np.array([1.0, -2.0, 0.5]), (0.1, 3.0)
    data, bands = drawn(1, amplitude, sizes)
    fit = fit_of(data, bands)
    rows = np.concatenate([data[:, b].reshape(-1, 1 + COLUMNS) / sizes[b] for b in range(BANDS)])
    expected = np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0]
    assert fit.amplitude[0] == pytest.approx(expected, abs=2e-3)
    covariance = np.linalg.inv(rows[:, 1:].T @ rows[:, 1:])
    # a jackknife of five blocks is a rough measure of the standard error
    assert np.all(fit.error[0] < 5 * np.sqrt(np.diag(covariance)))
    assert np.all(np.abs(fit.amplitude[0] - amplitude) < 5 * np.sqrt(np.diag(covariance)))


def test_scores_are_differences_of_students_densities():
    """Without values to fit, and the variance of the rest, the density is SciPy's."""
    data, bands = drawn(2, np.zeros(COLUMNS), (1.0, 3.0))
    fit = fit_of(data, bands, columns=1, spread=1e-9)
    # bands are right to a share only, and so many numbers tell as much as fewer do
    told = round(ROWS / (1.0 + ROWS / COARSE))
    signal = data[..., 0] * np.sqrt(told / ROWS)
    for q in range(BLOCKS):
        rest = np.delete(signal, q, axis=0)
        total = 0.0
        for b in range(BANDS):
            variance = scatter(rest[:, b], told)
            vector = np.zeros(told)
            vector[0] = np.linalg.norm(signal[q, b])
            density = multivariate_t(np.zeros(told), variance * np.eye(told), df=FREEDOM)
            total += density.logpdf(vector) - density.logpdf(np.zeros(told))
            total -= 0.5 * told * np.log(variance)
        assert fit.held[0, q] == pytest.approx(total, abs=0.3)


def scatter(blocks, told):
    """The variance of most likelihood of blocks of Student's distribution, by iteration."""
    squares = np.sum(blocks**2, axis=1)
    variance = float(squares.mean() / told)
    for _ in range(200):
        weight = (FREEDOM + told) / (FREEDOM + squares / variance)
        variance = float(np.sum(weight * squares) / (told * len(blocks)))
    return variance


@pytest.mark.ci
def test_a_column_that_is_not_there_gains_nothing_on_average():
    gains = []
    for seed in range(100):
        data, bands = drawn(seed, np.array([1.0, -2.0, 0.0]), (1.0, 1.0))
        gains.append(float(fit_of(data, bands).held.sum() - fit_of(data, bands, 2).held.sum()))
    assert np.mean(gains) < 0.0
    assert np.quantile(gains, 0.95) < 5.0


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 3.0), st.floats(0.0, 3.0))
def test_values_within_their_tolerances_are_those_of_scipys_bounded_least_squares(
    seed, most, alike
):
    """However alike columns are, and however many values are at their ends."""
    random = np.random.default_rng(seed)
    rows, count = 60, 12
    columns = random.standard_normal((rows, 1 + count))
    columns[:, 1:] += 10.0**alike * random.standard_normal((rows, 3)) @ random.random((3, count))
    columns[:, 0] += columns[:, 1:] @ random.standard_normal(count)
    ones = np.ones((1, count))
    prior = Priors(0.0 * ones, 1e-12 * ones, most * ones)
    found = within_most((columns.T @ columns)[None], prior).amplitude[0]
    assert np.all(np.abs(found) <= most + 1e-12)
    theirs = lsq_linear(columns[:, 1:], columns[:, 0], (-most, most), method="bvls").x
    left = [float(np.sum((columns[:, 0] - columns[:, 1:] @ a) ** 2)) for a in (found, theirs)]
    assert left[0] <= 1.0001 * left[1] + 1e-9 * float(np.sum(columns[:, 0] ** 2))


@pytest.fixture(scope="module")
def looked():
    """The catalogue of a slide with a ripple, and its suspects."""
    catalogue = Catalogue(study_of([slide_record("torque_ripple")], believed()))
    return catalogue, scored(catalogue)


def test_the_effect_that_is_there_leads_with_its_size(looked):
    catalogue, found = looked
    first, *others = found
    assert (first.name, first.form.amplitudes) == ("torque_ripple", ("ripple_cos", "ripple_sin"))
    assert first.amplitude == pytest.approx([12.0, 0.0], abs=0.05)
    assert first.form.values["ripples_per_metre"] == pytest.approx(50.0, rel=2e-3)
    assert catalogue.force_of(first) == pytest.approx(12.0 / math.sqrt(2.0), rel=0.03)
    assert first.gain.share == pytest.approx(0.9989, abs=2e-4)
    assert first.score == pytest.approx(1030.0, rel=0.01)
    assert not first.certain  # which is for others to say
    assert first.doubt == 0.0  # its period is found, not tried
    assert [s.score for s in others] == sorted((s.score for s in others), reverse=True)
    assert others[0].score < 10.0
    # nothing else is needed beside it
    assert scored(catalogue, [first])[0].score < 5.0


def test_values_and_a_size_that_is_nearly_sure_cost_what_normal_variables_do(looked):
    catalogue, _ = looked
    forms = [f for f in catalogue.forms if f.sure is not None]
    prior, off = catalogue.study.priors(), []
    for form, fit in zip(forms, catalogue.fit(forms), strict=True):
        *own, size = fit.amplitude[0]
        off.append((size - 1) / form.sure)
        values = np.sum(prior.precision * (own - prior.mean) ** 2)
        assert fit.cost[0] == pytest.approx(0.5 * (values + off[-1] ** 2))
    assert max(np.abs(off)) > 0.1


def test_a_gain_is_the_removed_share_with_its_jackknife():
    before, after = np.array([4.0, 5.0, 6.0, 5.0, 4.0]), np.array([1.0, 2.0, 1.0, 2.0, 2.0])
    bands = SimpleNamespace(of_force=np.array([True, False]))
    silent = np.ones(5)  # the other balance does not change
    squares = (np.column_stack([part, silent]) for part in (before, after))
    found = gain_of(SimpleNamespace(bands=bands), *squares)
    shares = [1.0 - np.delete(after, k).sum() / np.delete(before, k).sum() for k in range(5)]
    reach = student.ppf(0.95, 4) * np.std(shares) * 2.0
    assert found.share == pytest.approx(2 / 3)
    assert found.interval == pytest.approx((2 / 3 - reach, 2 / 3 + reach))


@pytest.mark.parametrize(
    ("share", "excess", "cuts"), [(0.25, 1.2, True), (0.25, 1.3, False), (0.15, 1.2, False)]
)
def test_a_limit_that_cuts_many_samples_by_little_only_cuts_noise(share, excess, cuts):
    """More than a fifth of the samples, by less than a quarter of the limit."""
    u = np.where(np.arange(1000) < 1000 * share, -excess * 5.0, 4.0)
    courses, limit = [SimpleNamespace(u=u)], {"voltage_limit": 5.0}
    assert CAUSES["voltage_saturation"].mechanisms[0].cuts_noise(courses, limit) == cuts


@pytest.mark.ci
def test_a_noisy_current_is_not_told_smaller_to_make_its_noise_smaller():
    record = strong_record({}, with_current=True)
    random = np.random.default_rng(0)
    noise = 0.5 * float(np.std(record.signals["i"])) * random.standard_normal(len(record.x))
    record = replace(record, signals={**record.signals, "i": record.signals["i"] + noise})
    study = study_of([record], nominal())
    catalogue = Catalogue(study)
    fit = catalogue.without([])
    at_gain = study.values.index("current_gain")
    gain = study.courses[0].calibration["current_gain"] + fit.amplitude[0, at_gain]
    assert abs(gain) < 0.02
    assert {s.name: s.score for s in scored(catalogue)}.get("scale_of_i", 0.0) < 5.0


@pytest.mark.ci
def test_a_speed_that_follows_within_an_interval_is_no_delay():
    """A held command of rising frequency; the axis answers three times faster than its record."""
    time = np.arange(8_000) * 1e-3
    u = 12.0 * np.sin(2 * np.pi * (1.0 + 2.0 * time) * time)
    light = {"motor_mass": 0.0}
    signals = signals_of(moved(light, u, np.zeros(len(u))), u)
    record = check_record("chirp", {n: c for n, c in signals.items() if n != "i"})
    study = study_of([record], nominal().changed({"Jm": 0.0}))
    assert study.courses[0].calibration["fast_speed"] == pytest.approx(1.0, abs=0.3)
    found = {s.name: s.score for s in scored(Catalogue(study))}
    assert found.get("input_delay", 0.0) < 30.0


@pytest.mark.ci
def test_a_gap_is_found_between_the_points_of_the_grid():
    first = scored(Catalogue(study_of([strong_record(gap(1e-4))], nominal())))[0]
    assert first.name == "backlash"
    assert first.form.values["gap"] == pytest.approx(1e-4, rel=0.1)


@pytest.mark.ci
def test_a_limit_far_below_the_largest_command_is_found():
    """A limit of 5 V for a command of 97 V was not in the grid."""
    share = 0.05
    largest = float(np.abs(strong_record({}).u).max())
    study = study_of([strong_record({"limit": share * largest})], nominal())
    found = {s.name: s for s in scored(Catalogue(study))}
    limit = found["voltage_saturation"].form.values["voltage_limit"]
    assert limit == pytest.approx(share * largest, rel=0.05)


@pytest.mark.ci
def test_a_swing_is_found_where_the_record_rests_most_of_the_time():
    """Sums over time had most of their power in the rests."""
    time = np.arange(20_000) * 1e-3
    u = 3.0 * np.sign(np.sin(2 * np.pi * 0.25 * time)) * (np.mod(time, 4.0) < 1.0)
    u += 3.0 * np.sign(np.sin(2 * np.pi * 0.25 * time)) * (np.mod(time, 4.0) > 3.0)
    log = moved({"ripple": 0.3, "ripple_period": 2e-3}, u, friction_noise(3, len(u)))
    signals = signals_of(log, u)
    del signals["i"]
    study = study_of([check_record("made", signals)], nominal())
    forms = [f.values for f in Catalogue(study).forms if f.name == "torque_ripple"]
    swings = [v["ripples_per_metre"] for v in forms if "ripples_per_metre" in v]
    assert min(abs(s - 500.0) for s in swings) < 2.0
