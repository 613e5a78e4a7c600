"""Work on both cores at once."""

from __future__ import annotations

import time

import pytest

from ballscrew.diagnosis.threads import in_threads


def test_results_come_in_the_order_of_what_was_given():
    def waits(n: int) -> int:
        time.sleep(0.01 * (5 - n))
        return n * n

    assert in_threads(waits, range(5)) == [0, 1, 4, 9, 16]


def test_what_is_raised_in_a_thread_reaches_the_caller():
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda n: 1 / n, [1, 0])
