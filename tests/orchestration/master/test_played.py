"""Runs that judge are played by compiled code, and say to the last bit what the FMUs say."""

import numpy as np
import pytest

from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.master import master


@pytest.mark.parametrize("controller", ["iol", "relay"])  # the latter has events
def test_the_verdict_is_that_of_the_fmus_to_the_last_bit(controller, monkeypatch):
    asked = Loop(controller, stop=0.1, step=1e-3)
    played = run_closed_loop(asked).run
    monkeypatch.setattr(master, "reopened_to_judge", FmuInstance.reopened)
    through_fmus = run_closed_loop(asked).run
    assert repr(played.verdict) == repr(through_fmus.verdict)
    for name, values in through_fmus.outputs.items():
        np.testing.assert_array_equal(played.outputs[name], values)
