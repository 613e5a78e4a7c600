"""Commands that arrive late in several forms, against sums over pure delays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.measurement.diagnosis.causes.command import late, smeared

STEP = 1e-3


@pytest.mark.parametrize("window", [3e-4, 7.123e-3])
def test_a_mean_over_a_window_is_the_mean_of_all_delays_in_it(window):
    u = np.random.default_rng(1).normal(size=50)
    delays = (np.arange(4000) + 0.5) / 4000 * window
    told = np.mean([late(u, d, STEP) for d in delays], axis=0)
    assert smeared(u, window, STEP) == pytest.approx(told, abs=1e-6)


@given(st.floats(1e-5, 0.08), st.integers(2, 60))
def test_a_constant_command_is_the_same_late_or_averaged(time, count):
    u = np.full(count, 2.5)
    assert late(u, time, STEP) == pytest.approx(u)
    assert smeared(u, time, STEP) == pytest.approx(u)
