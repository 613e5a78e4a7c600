"""Wait for what another process does, at most for a given time."""

from __future__ import annotations

import time


def wait_for(condition, seconds: float = 10.0, process=None):
    """What the condition returns once it is true. ``process`` (a Popen) must live until then."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert process is None or process.poll() is None, "the process ended before that"
        assert time.monotonic() < end, f"not true after {seconds:g} s"
        time.sleep(0.005)
    return found
