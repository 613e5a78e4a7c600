"""Wait for what another process does, at most for a given time."""

from __future__ import annotations

import time


def wait_for(condition, seconds: float = 10.0, process=None):
    """What the condition returns once it is true. ``process`` (a Popen) must live until then."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        if process is not None and process.poll() is not None:
            said = process.stderr.read() if process.stderr else ""
            raise AssertionError(f"the process ended before that: {said}")
        assert time.monotonic() < end, f"not true after {seconds:g} s"
        time.sleep(0.005)
    return found
