"""Runs that judge are played by compiled code, and say to the last bit what the FMUs say."""

import numpy as np
import pytest

from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.master import played


@pytest.mark.parametrize("controller", ["iol", "relay"])  # the latter has events
def test_the_verdict_is_that_of_the_fmus_to_the_last_bit(controller, monkeypatch):
    asked = Loop(controller, stop=0.1, step=1e-3)
    by_code = run_closed_loop(asked).run
    monkeypatch.setattr(played, "can_be_played", lambda _: False)
    through_fmus = run_closed_loop(asked).run
    assert repr(by_code.verdict) == repr(through_fmus.verdict)
    for name, values in through_fmus.outputs.items():
        np.testing.assert_array_equal(by_code.outputs[name], values)
