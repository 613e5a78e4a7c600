"""The filter and the smoother, against what conditional normal distributions say directly."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.diagnosis.innovations import gains, innovations, sampled, smooth

STEP, MASS, LINEAR = 0.01, 2.0, 5.0
N = 60


def drive(channels=1):
    """A mass with viscous friction and an unmodelled force; states x, v, d."""
    equations = np.array([[0.0, 1.0, 0.0], [0.0, -LINEAR / MASS, -1.0 / MASS], [0.0, 0.0, 0.0]])
    command, force = np.array([0.0, 1.0 / MASS, 0.0]), np.array([0.0, -1.0 / MASS, 0.0])
    sees = np.eye(3)[:channels]
    noise = np.array([1e-3, 2e-2])[:channels] ** 2
    doubt = np.array([0.1, 0.2, 0.3])
    return sampled(equations, command, force, sees, noise, doubt, STEP, 0.5, 0.05)


def joint(system):
    """Covariance of all states end to end, and the map from commands to their means."""
    s = len(system.move)
    covariance = np.zeros((N * s, N * s))
    means = np.zeros((N * s, N))
    p, carry = np.diag(system.doubt**2), np.zeros((s, N))
    powers = [np.eye(s)]
    for _ in range(N):
        powers.append(system.move @ powers[-1])
    for k in range(N):
        means[k * s : (k + 1) * s] = carry
        for j in range(k, N):
            block = powers[j - k] @ p
            covariance[j * s : (j + 1) * s, k * s : (k + 1) * s] = block
            covariance[k * s : (k + 1) * s, j * s : (j + 1) * s] = block.T
        carry = system.move @ carry
        carry[:, k] += system.by_command
        p = system.move @ p @ system.move.T + system.restless
    return covariance, means


@pytest.mark.parametrize("channels", [1, 2])
def test_innovations_whiten_and_the_smoother_is_the_conditional_mean(channels):
    system = drive(channels)
    random = np.random.default_rng(channels)
    covariance, means = joint(system)
    s = 3
    rows = np.concatenate([np.arange(channels) + k * s for k in range(N)])
    coarse = random.uniform(0.5, 4.0, (N, channels))
    u = random.standard_normal(N)
    of_noise = np.diag((system.noise * coarse).ravel())
    seen = covariance[np.ix_(rows, rows)] + of_noise
    y = np.linalg.cholesky(seen) @ random.standard_normal(len(rows)) + (means @ u)[rows]
    signals = y.reshape(N, channels)
    nothing = np.zeros(N)

    weights = gains(system, np.ones((N, channels), dtype=bool), coarse, nothing)
    found = innovations(
        system, weights, signals[:, :, None], u[:, None], nothing[:, None], np.zeros((s, 1))
    )
    # the factor of the covariance whitens too, and only one lower factor does
    expected = np.linalg.solve(np.linalg.cholesky(seen), y - (means @ u)[rows])
    assert found.ravel() == pytest.approx(expected, abs=1e-8)

    out = smooth(system, signals, coarse, u, nothing, nothing, np.zeros(s))
    gain = np.linalg.solve(seen, covariance[rows]).T
    mean = means @ u + gain @ (y - (means @ u)[rows])
    spread = np.sqrt(np.diag(covariance - gain @ covariance[rows]))
    assert out.state.ravel() == pytest.approx(mean, abs=1e-9)
    assert out.spread.ravel() == pytest.approx(spread, rel=1e-6)


def test_what_is_not_measured_says_nothing():
    system = drive(2)
    random = np.random.default_rng(0)
    signals = random.standard_normal((N, 2, 1))
    measured = np.ones((N, 2), dtype=bool)
    measured[::2, 1] = False
    nothing = np.zeros(N)
    weights = gains(system, measured, np.ones((N, 2)), nothing)
    one = innovations(system, weights, signals, nothing[:, None], nothing[:, None])
    signals[::2, 1] = 1e9
    other = innovations(system, weights, signals, nothing[:, None], nothing[:, None])
    assert np.array_equal(one, other)
    assert not np.any(one[::2, 1])
