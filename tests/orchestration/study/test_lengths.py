"""Lengths are shown in millimetres or micrometres, by their size."""

import math

import pytest

from ballscrew.orchestration.study.lengths import length, scale


@pytest.mark.parametrize(
    ("metres", "said"),
    [(2.74e-6, "2.74 um"), (9.99e-4, "999 um"), (1.234e-3, "1.23 mm"), (-0.3, "-300 mm")],
)
def test_a_length_is_said_in_the_unit_of_its_size(metres, said):
    assert length(metres) == said


def test_a_column_has_one_unit_by_its_median_and_one_that_is_lost_does_not_decide():
    assert scale([2e-6, 5e-5, 0.3]) == (1e6, "um")
    assert scale([2e-6, 5e-3, 0.3]) == (1e3, "mm")
    assert scale([math.nan, math.inf]) == (1e6, "um")
