"""A DC motor under P and PD: the band in which it rests."""

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
    run = ours.motion(ours.MOTOR, 1.0, 0.1, {"Fs": ratio * 1e-3}, ours.LAWS[law], goal, gains)
    error = goal - run.outputs["x"][-1]
    assert run.outputs["stuck"][-1] == 1.0
    assert abs(error) <= ratio * 1e-3 * 21.4 / (37.4e-3 * kp) * (1.0 + 1e-9)
