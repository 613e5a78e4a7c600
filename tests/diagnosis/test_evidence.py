"""Evidence of linear models, against the normal density of the whole signal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from ballscrew.diagnosis.evidence import (
    Columns,
    Prior,
    conditioned,
    evidence_of,
    fit_within,
    gain,
    weigh,
)


def density(y, columns, priors):
    """Logarithm of the density of y, less what white noise alone would give."""
    mean = np.zeros(len(y))
    covariance = np.eye(len(y))
    for p in priors:
        x = columns[:, p.columns]
        mean += x @ p.mean
        covariance += (x * p.spread**2) @ x.T
    return multivariate_normal(mean, covariance).logpdf(y) + 0.5 * len(y) * np.log(2 * np.pi)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_evidence_is_the_density_of_the_signal(seed):
    random = np.random.default_rng(seed)
    columns = random.standard_normal((40, 6))
    y = columns[:, 0]
    products = Columns((columns,), (0, 15, 40)).products()
    first = Prior(np.array([1, 2]), random.standard_normal(2), random.uniform(0.1, 3, 2))
    second = Prior(np.array([3, 4, 5]), random.standard_normal(3), random.uniform(0.1, 3, 3))
    one, both = density(y, columns, [first]), density(y, columns, [first, second])
    left = conditioned(products, [first])
    assert left.evidence == pytest.approx(one, abs=1e-8)
    assert gain(*left.of(second.columns), second.mean, second.spread) == pytest.approx(
        both - one, abs=1e-8
    )
    assert evidence_of(products, [first, second]) == pytest.approx(both, abs=1e-8)


def test_columns_that_foretell_nothing_lose_and_true_ones_win():
    random = np.random.default_rng(1)
    noise = random.standard_normal(2000)
    column = random.standard_normal((2000, 3))
    for amplitude, wins in ((0.0, False), (0.3, True)):
        y = noise + amplitude * column[:, 0]
        products = Columns((y[:, None], column), (0, 2000)).products()
        assert (weigh(products[1:2, 1:2], products[1:2, 0]).gain > 3) == wins


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_fit_within_bounds_is_the_best_there(seed):
    """No step along any axis, towards the inside, lowers the sum of squares."""
    random = np.random.default_rng(seed)
    columns = random.standard_normal((60, 6))
    priors = [
        Prior(np.array([1, 2, 3]), random.standard_normal(3), random.uniform(0.1, 3, 3)),
        Prior(np.array([4, 5]), np.zeros(2), random.uniform(0.1, 3, 2)),
    ]
    low, high = -random.uniform(0, 0.3, 3), random.uniform(0, 0.3, 3)
    products = columns.T @ columns
    found = fit_within(products, priors, low, high)
    assert np.all((found >= low) & (found <= high))

    def cost(values):
        held = Prior(priors[0].columns, values, np.full(3, 1e-7))
        rest = -2.0 * evidence_of(products, [held, priors[1]])
        return rest + float(np.sum(((values - priors[0].mean) / priors[0].spread) ** 2))

    best = cost(found)
    for j in range(3):
        for step in (-1e-3, 1e-3):
            other = found.copy()
            other[j] = np.clip(other[j] + step, low[j], high[j])
            assert cost(other) >= best - 1e-5


def test_a_block_exchanged_is_as_if_it_had_been_there_from_the_start():
    random = np.random.default_rng(3)
    blocks = [random.standard_normal((30, m)) for m in (1, 2, 3)]
    other = random.standard_normal((30, 2))
    edges = (0, 12, 30)
    made = Columns(tuple(blocks), edges).exchanged(1, other)
    whole = np.column_stack([blocks[0], other, blocks[2]])
    some = np.array([0, 2, 5])
    assert np.allclose(made.products(), whole.T @ whole, rtol=1e-12)
    assert np.array_equal(made.of(some), whole[:, some])
    first = whole[:12, some]
    assert np.allclose(made.by_stretch(some)[0], first.T @ first, rtol=1e-12)
