"""Balances averaged under bells: exact for exact readings, quiet for noisy ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ballscrew.measurement.diagnosis.windows import (
    acceleration,
    averaged,
    between_samples,
    centres,
    lagged,
    windows,
)

STEP = 1e-3


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), width=st.integers(1, 20))
def test_newtons_law_holds_to_rounding_for_any_force_that_is_held(seed, width):
    """The acceleration from positions alone is the average of the one that made them."""
    random = np.random.default_rng(seed)
    n = 400
    given_ = random.standard_normal(n)
    v = np.concatenate([[0.3], 0.3 + np.cumsum(given_[:-1]) * STEP])
    x = np.concatenate([[0.0], np.cumsum(v[:-1] * STEP + 0.5 * given_[:-1] * STEP**2)])
    found = acceleration(x, STEP, width)
    assert len(found) == windows(n, width) == len(centres(n, width))
    assert found == pytest.approx(averaged(given_, width), abs=1e-7)


@pytest.mark.ci
@pytest.mark.parametrize("width", [1, 10])
def test_the_noise_of_the_readings_is_averaged(width):
    noise = np.random.default_rng(1).standard_normal(400_000)
    # of the second difference, three bare readings would make sqrt(6)
    quieter = np.std(acceleration(noise, 1.0, width)) * width**2 / np.sqrt(6.0)
    assert quieter < 1.01 * (1.0 if width == 1 else 0.85 / np.sqrt(width))


@pytest.mark.ci
@pytest.mark.parametrize("time_constant", [3e-4, 2e-2])
def test_a_lag_is_what_an_independent_solver_makes_of_it(time_constant):
    command = np.random.default_rng(2).standard_normal(30)
    state, means, ends = command[0], [], []
    for u in command:
        solved = solve_ivp(
            lambda t, y, u=u: [(u - y[0]) / time_constant, y[0]],
            (0.0, STEP),
            [state, 0.0],
            "Radau",
            rtol=1e-10,
            atol=1e-13,
        )
        ends.append(state)
        state = solved.y[0, -1]
        means.append(solved.y[1, -1] / STEP)
    assert lagged(command, time_constant, STEP) == pytest.approx(means, abs=1e-7)


@pytest.mark.ci
@pytest.mark.parametrize(("inductance", "mass"), [(1e-5, 20.0), (0.2, 0.5)])
def test_the_mean_current_is_what_an_independent_solver_makes_of_a_motor(inductance, mass):
    """Windings faster and slower than the sampling, drives faster and slower than it."""
    random = np.random.default_rng(2)
    volts, r, emf = random.standard_normal(60), 20.0, 230.0
    # current, speed, the current's integral and the voltage, which is held: linear, solved exactly
    rates = np.array(
        [
            [-r / inductance, -emf / inductance, 0.0, 1.0 / inductance],
            [emf / mass, -100.0 / mass, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0],
        ]
    )
    over_a_step = expm(rates * STEP)
    state, means, ends = np.zeros(4), [], []
    for u in volts:
        ends.append(state[0])
        state = over_a_step @ [*state[:2], 0.0, u]
        means.append(state[2] / STEP)
    jumps = np.diff(volts, prepend=0.0) / r
    mechanical = mass / (100.0 + emf**2 / r)
    found = between_samples(np.array(ends), jumps, STEP, inductance / r, mechanical)
    assert np.std((found - means)[1:-1]) < 0.05 * np.std(means)
