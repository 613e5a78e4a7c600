"""Intervals of mean squares: how often they hold the truth, of noise that lasts."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ballscrew.measurement.diagnosis.compare import Blocks


def noise(random, seconds, correlation_time, rate=100):
    """Of unit variance."""
    kept = np.exp(-1.0 / (rate * correlation_time))
    n = seconds * rate
    drive = random.standard_normal(n + 20 * rate)
    return lfilter([np.sqrt(1 - kept**2)], [1, -kept], drive)[20 * rate :]


@pytest.mark.ci
@pytest.mark.parametrize(("seconds", "correlation_time"), [(10, 0.01), (20, 0.3)])
def test_intervals_hold_the_truth(seconds, correlation_time):
    random = np.random.default_rng(3)
    blocks = Blocks(range(0, seconds * 100 + 1, 100))
    held = []
    for _ in range(300):
        low, high = blocks.rms(noise(random, seconds, correlation_time)).interval
        held.append(low < 1.0 < high)
    assert np.mean(held) > 0.9


def test_a_gain_that_is_none_is_not_called_certain():
    """Two models that are equally wrong, each in its own way."""
    random = np.random.default_rng(4)
    blocks = Blocks(range(0, 2001, 100))
    called = []
    for _ in range(300):
        one, other = noise(random, 20, 0.1), noise(random, 20, 0.1)
        low, _ = blocks.gain(one, other).interval
        called.append(low > 0.0)
    assert np.mean(called) < 0.05


def test_figures_are_those_of_the_counted_samples():
    values = np.arange(10.0)
    counted = values >= 6.0
    blocks = Blocks([0, 5, 10])
    assert blocks.rms(values, counted).value == pytest.approx(np.sqrt(np.mean(values[6:] ** 2)))
    assert blocks.gain(values, 0.5 * values).value == pytest.approx(0.75)
    assert blocks.rms(values).interval is None  # two blocks tell nothing of their scatter
