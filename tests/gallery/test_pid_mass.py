"""A mass under PID control: another solver, the closed form of a slip, and a theorem."""

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballscrew.gallery.pid_mass import findings as ours


def test_the_time_until_friction_falls_is_that_of_the_riccati_equation():
    width, error, fall = 1e-3, 0.07, 0.5

    def rates(t, v):
        return 4.0 * error * t + fall * (v / width) ** 2

    def far(_t, v):
        return v[0] - 1e3

    far.terminal = True
    end = solve_ivp(rates, (0.0, 1.0), [0.0], "DOP853", rtol=1e-11, atol=1e-14, events=far)
    assert end.t[-1] == pytest.approx(ours.late(error, fall), rel=1e-5)


@settings(max_examples=15, deadline=None, derandomize=True, phases=[Phase.generate])
@given(
    mass=st.floats(0.3, 3.0),
    coulomb=st.floats(0.2, 3.0),
    kd=st.floats(0.5, 8.0),
    kp=st.floats(0.5, 20.0),
    share=st.floats(0.05, 0.9),
    start=st.tuples(st.floats(-1.0, 1.0), st.floats(-2.0, 2.0), st.floats(-1.0, 1.0)),
)
def test_theorem_with_stable_gains_and_no_fall_the_error_falls_from_stick_to_stick(
    mass, coulomb, kd, kp, share, start
):
    """Bisoffi et al. (2018), with the function that falls, whose rate is derived on the page."""
    ki = share * kd * kp / mass
    error, v, w = start
    values = {"m": mass, "Fc": coulomb, "Fs": coulomb, "sigma2": 0.0}
    values |= {"x_start": 1.0 - error, "v_start": v}
    gains = {"Kp": kp, "Ki": ki, "Kd": kd, "w_start": w}
    run = ours.motion(ours.MASS, 40.0, 0.01, values, ours.PID, 1.0, gains)
    # at time 0 the mode is the one in which every motion begins
    x, v, stuck = (run.outputs[name][1:] for name in ("x", "v", "stuck"))
    force = run.commands["u"][1:] + kd * v  # of the proportional and the integral action
    beyond = np.where(
        stuck > 0.5, np.maximum(np.abs(force) - coulomb, 0.0), force - coulomb * np.sign(v)
    )
    error = 1.0 - x
    w = kd * ki * error**2 - 2.0 * mass * ki * error * v + mass * kp * v**2 + beyond**2
    moving = stuck[1:] + stuck[:-1] == 0.0
    same = moving & (v[1:] * v[:-1] > 0.0)
    rate = 2.0 * (kd * kp - mass * ki) * v**2
    loss = 0.5 * (rate[1:] + rate[:-1]) * np.diff(run.time[1:])
    assert np.diff(w)[same] == pytest.approx(-loss[same], rel=0.05, abs=2e-4 * w[0])
    assert np.diff(w).max() <= 1e-6 * w[0]
    _, errors = ours.sticks(run)
    assert np.all(np.diff(np.abs(errors)) < 0.0)
    assert w[-1] < 0.5 * w[0] + 1e-9
