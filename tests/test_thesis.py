"""What is stored of the thesis is what is computed."""

from __future__ import annotations

import pytest
import thesis
from runner import stored
from thesis.chapter_3 import swinging_neighbours
from thesis.loops import scipy_end
from thesis.printed import SYSTEM_2

pytestmark = pytest.mark.ci


@pytest.mark.parametrize("label", ["T24", "T25", "B1", "C4", "C7", "D5", "D8", "E11", "E24", "F1"])
def test_a_row_computed_again_is_the_stored_one(label):
    known = stored("thesis")["figures"][label]
    assert thesis.ROWS[label].here() == pytest.approx(known, rel=1e-3)


def test_loose_tolerances_make_the_second_loop_swing_and_tight_ones_do_not():
    """What a loose solver finds changes with the last bit, thus with the processor: nine loops."""
    assert swinging_neighbours(SYSTEM_2) > 9 / 2
    assert {scipy_end(SYSTEM_2, by, 1e-6, 1e-9).kind for by in ("BDF", "RK45")} == {"stands"}
