"""The disturbance observer: its error by its pole, and the load that it takes away."""

import linear_axis as la
import numpy as np

from ballscrew.controllers.pid import pid
from ballscrew.controllers.pid_dob import pid_dob

LOAD = 20.0  # N
TIME = 5e-3  # of the filter, s


def test_the_error_of_the_estimated_load_decays_with_the_filter_s_pole():
    times = np.linspace(0.0, 0.03, 31)
    model = la.loop(la.rigid(), pid_dob(), 0.01, Tq=TIME, plant_load=LOAD)
    run = model.simulate(times)
    estimated = run.states["controller_q"] + la.LAG / (la.B * TIME) * run.outputs["v"]
    true = -LOAD * la.R / la.MOTOR  # volts that act beside the command
    np.testing.assert_allclose(estimated - true, -true * np.exp(-times / TIME), atol=1e-8)


def test_a_load_is_taken_away_without_an_integral():
    times = np.array([0.0, 20.0])
    ends = {}
    for law in (pid(), pid_dob()):
        run = la.loop(la.sliding(), law, 0.08, 1e-9, Ki=0.0, plant_load=LOAD).simulate(times)
        ends[law.name] = run.outputs["x"][-1] - 0.08
    gain = {p.name: p.default for p in pid().parameters}["Kp"]
    np.testing.assert_allclose(ends["pid"], -LOAD * la.R / la.MOTOR / gain, rtol=1e-6)
    assert abs(ends["pid_dob"]) < 1e-9
