"""A DC motor under P, PD and PID: the band in which it rests, and its largest integral gain."""

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from ballscrew.gallery.dc_motor import findings as ours


@settings(max_examples=25, deadline=None, derandomize=True, phases=[Phase.generate])
@given(
    law=st.sampled_from(["P", "PD"]),
    goal=st.floats(-3.0, 3.0),
    kp=st.floats(3.0, 30.0),
    kd=st.floats(0.0, 0.1),
    ratio=st.floats(1.0, 2.0),
)
def test_without_an_integral_it_stops_where_the_voltage_cannot_move_it(law, goal, kp, kd, ratio):
    gains = {"Kp": kp, **({"Kd": kd} if law == "PD" else {})}
    run = ours.motion(law, goal, 1.0, 0.1, given={"Fs": ratio * 1e-3}, gains=gains)
    error = goal - run.outputs["x"][-1]
    assert run.outputs["stuck"][-1] == 1.0
    assert abs(error) <= ratio * 1e-3 * 21.4 / (37.4e-3 * kp) * (1.0 + 1e-9)


def test_the_largest_integral_gain_is_where_a_pair_of_eigenvalues_crosses():
    ki = ours.largest_integral()
    pull = 37.4e-3
    rates = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [0.0, -2e-5 / 4.2e-7, pull / 4.2e-7, 0.0],
            [-10.0 / 0.953e-3, -(0.0374482 + 0.05) / 0.953e-3, -21.4 / 0.953e-3, ki / 0.953e-3],
            [-1.0, 0.0, 0.0, 0.0],
        ]
    )
    assert np.linalg.eigvals(rates).real.max() == pytest.approx(0.0, abs=1e-6)


def test_with_no_fall_of_friction_the_error_shrinks_from_stick_to_stick_by_the_ratio():
    _, errors = ours.creeping()
    assert len(errors) >= 4
    assert errors[1:] / errors[:-1] == pytest.approx(ours.ratio(), rel=1e-6)
