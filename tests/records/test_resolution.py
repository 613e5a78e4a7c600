"""The resolution of an instrument, from what it recorded."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic.records import COUNT, RESOLUTION

from ballscrew.records.resolution import resolution_of


def test_resolution_is_found_in_samples_that_jump_over_levels_and_not_in_smooth_ones():
    random = np.random.default_rng(0)
    levels = np.cumsum(random.choice([14, 15], 400))
    assert resolution_of(levels * COUNT) == pytest.approx(COUNT, rel=1e-9)
    read = np.round(random.normal(1.5, 0.05, 2000) / RESOLUTION) * RESOLUTION
    assert resolution_of(read) == pytest.approx(RESOLUTION, rel=1e-9)
    assert resolution_of(random.normal(size=500)) == 0.0
