"""Scores of suspects: against least squares done by hand, and on noise alone."""

from __future__ import annotations

import numpy as np
import pytest
from axis_records import friction_noise, gap, moved, signals_of, strong_record
from diagnosed import nominal
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.stats import multivariate_t
from worlds import layout as at

from ballscrew.diagnosis.bands import Bands
from ballscrew.diagnosis.scores import Catalogue, scored
from ballscrew.diagnosis.study import FREEDOM, Priors, fitted, study_of
from ballscrew.records.reading import check_record

ROWS, COLUMNS, BLOCKS, BANDS = 40, 3, 5, 2
EXACT = 1e-3


def drawn(seed, amplitude, sizes):
    """Columns of blocks and bands, the signal first, and how the bands are cut."""
    random = np.random.default_rng(seed)
    columns = random.standard_normal((BLOCKS, BANDS, ROWS, COLUMNS))
    noise = random.standard_normal((BLOCKS, BANDS, ROWS)) * np.array(sizes)[None, :, None]
    signal = columns @ amplitude + noise
    data = np.concatenate([signal[..., None], columns], axis=3)
    bands = Bands(
        parts=[(0, 0, 0)] * BLOCKS,
        weights=[np.ones((1, 1))] * BLOCKS,
        used=np.ones(BANDS, dtype=bool),
        counts=np.full((BLOCKS, BANDS), float(ROWS)),
        steps=[1.0] * BLOCKS,
        top=np.inf,
    )
    return data, bands


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
    signal = data[..., 0]
    for q in range(BLOCKS):
        rest = np.delete(signal, q, axis=0)
        total = 0.0
        for b in range(BANDS):
            variance = scatter(rest[:, b])
            shape = variance * np.eye(ROWS)
            density = multivariate_t(np.zeros(ROWS), shape, df=FREEDOM)
            total += density.logpdf(signal[q, b]) - density.logpdf(np.zeros(ROWS))
            total -= 0.5 * ROWS * np.log(variance)
        assert fit.held[0, q] == pytest.approx(total, abs=0.3)


def scatter(blocks):
    """The variance of most likelihood of blocks of Student's distribution, by iteration."""
    squares = np.sum(blocks**2, axis=1)
    variance = float(squares.mean() / ROWS)
    for _ in range(200):
        weight = (FREEDOM + ROWS) / (FREEDOM + squares / variance)
        variance = float(np.sum(weight * squares) / (ROWS * len(blocks)))
    return variance


def test_a_column_that_is_not_there_gains_nothing_on_average():
    gains = []
    for seed in range(100):
        data, bands = drawn(seed, np.array([1.0, -2.0, 0.0]), (1.0, 1.0))
        gains.append(float(fit_of(data, bands).held.sum() - fit_of(data, bands, 2).held.sum()))
    assert np.mean(gains) < 0.0
    assert np.quantile(gains, 0.95) < 5.0


def test_a_prior_that_is_narrow_holds_a_value():
    data, bands = drawn(3, np.array([1.0, -2.0, 0.5]), (1.0, 1.0))
    held = fit_of(data, bands, spread=1e-4)
    assert np.abs(held.amplitude[0]).max() < 0.01


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 3.0))
def test_values_within_their_tolerances_are_those_of_scipys_bounded_least_squares(seed, most):
    amplitude = np.random.default_rng(seed).standard_normal(COLUMNS)
    data, bands = drawn(seed, amplitude, (1.0, 1.0))
    # columns that are nearly the same make it hard to say which value stays at its end
    data[..., 3] = data[..., 1] + 0.3 * data[..., 3]
    fit = fit_of(data, bands, most=most)
    weights = 1.0 / np.sqrt(fit.squares[0].sum(axis=0) / (BLOCKS * ROWS))
    rows = np.concatenate([weights[b] * data[:, b].reshape(-1, 1 + COLUMNS) for b in range(BANDS)])
    found = lsq_linear(rows[:, 1:], rows[:, 0], (-most, most)).x
    ours, theirs = (np.sum((rows[:, 0] - rows[:, 1:] @ a) ** 2) for a in (fit.amplitude[0], found))
    assert np.all(np.abs(fit.amplitude[0]) <= most + 1e-12)
    # blocks have weights of their own, so that the two differ a little
    assert ours < 1.02 * theirs


def test_a_strong_effect_leads_with_its_size():
    study = study_of([strong_record({at.LOAD: 0.4})], nominal())
    first = scored(study, Catalogue(study)).suspects[0]
    assert first.name == "load_bias"
    assert first.score > 100.0
    assert first.amplitude[0] == pytest.approx(0.4, rel=0.1)
    assert abs(first.amplitude[0] - 0.4) < 3.0 * first.error[0] + 0.02


def test_a_gap_is_found_between_the_points_of_the_grid():
    study = study_of([strong_record(gap(1e-4))], nominal())
    first = scored(study, Catalogue(study)).suspects[0]
    assert first.name == "backlash"
    assert first.form.shape.values["gap"] == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.8])
def test_a_limit_far_below_the_largest_command_is_found(share):
    """A limit of 5 V for a command of 97 V was not in the grid."""
    largest = float(np.abs(strong_record({}).u).max())
    study = study_of([strong_record({at.LIMIT: share * largest})], nominal())
    found = {s.name: s for s in scored(study, Catalogue(study)).suspects}
    limit = found["voltage_saturation"].form.shape.values["voltage_limit"]
    assert limit == pytest.approx(share * largest, rel=0.05)


def test_a_swing_is_found_where_the_record_rests_most_of_the_time():
    """Sums over time had most of their power in the rests."""
    time = np.arange(20_000) * 1e-3
    u = 3.0 * np.sign(np.sin(2 * np.pi * 0.25 * time)) * (np.mod(time, 4.0) < 1.0)
    u += 3.0 * np.sign(np.sin(2 * np.pi * 0.25 * time)) * (np.mod(time, 4.0) > 3.0)
    log = moved({at.RIPPLE: 0.3, at.RIPPLE_PERIOD: 2e-3}, u, friction_noise(3, len(u)))
    signals = signals_of(log, u)
    del signals["i"]
    study = study_of([check_record("made", signals)], nominal())
    swings = [
        value
        for form in Catalogue(study).forms
        if form.name == "torque_ripple"
        for name, value in form.shape.values.items()
        if name == "ripples_per_metre"
    ]
    assert min(abs(s - 500.0) for s in swings) < 2.0
