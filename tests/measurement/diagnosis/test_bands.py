"""Blocks and bands: white noise is white in them, and rests are not."""

from __future__ import annotations

import numpy as np
import pytest
from axis_records import strong_record
from diagnosed import nominal

from ballscrew.measurement.diagnosis.bands import cut, products
from ballscrew.measurement.diagnosis.motion import lay_along
from ballscrew.measurement.diagnosis.windows import windows

pytestmark = pytest.mark.ci


def test_white_noise_has_its_variance_in_every_number_of_every_band():
    course = lay_along(strong_record({}), nominal())
    bands = cut([course], nominal())
    size, many = 3.0, 200
    shape = windows(len(course.x), course.width), 1 + course.has_current, many
    lines = bands.lines([size * np.random.default_rng(1).standard_normal(shape)])
    found = np.einsum("qbii->qb", products(lines, lines)) / many
    # the doubt in the law's force makes noise less where the law is doubtful
    expected = size**2 * bands.counts
    of_used = found[:, bands.used] / expected[:, bands.used]
    assert of_used == pytest.approx(np.ones_like(of_used), rel=0.35)
    assert np.mean(of_used) == pytest.approx(1.0, rel=0.05)
