"""Van der Pol's oscillator: the table of the Reference-FMUs, another solver, and averaging."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballscrew.gallery.van_der_pol.findings import exponents, findings


def rates(_t, y, mu=1.0):
    return [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]]


def test_the_reference_fmus_table_is_what_explicit_euler_gives():
    y, course = np.array([2.0, 0.0]), []
    for _ in range(2000):
        y = y + 0.01 * np.array(rates(0.0, y))
        course.append(y[0])
    printed = {f.what: f.theirs for f in findings() if f.theirs is not None}
    assert course[-1] == pytest.approx(printed["x at 20 s, mu = 1"], abs=1e-5)
    peak = max(course[400:1000])  # of the turn whose peak the table has near 6.7 s
    assert peak == pytest.approx(printed["swing of x in the cycle, mu = 1"], abs=1e-5)


def test_weakly_damped_its_exponent_is_the_mean_damping_of_another_solver():
    """Twelve periods shrink a tangent to exp(-7.5): the first has to begin along the motion."""

    def damped(_t, y):
        return [*rates(_t, y[:2], 0.1), 0.1 * (1 - y[0] ** 2)]

    def top(_t, y):
        return y[1]

    top.direction = -1.0
    precise = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}
    settled = solve_ivp(rates, (0.0, 300.0), [2.0, 0.0], args=(0.1,), **precise).y[:, -1]
    run = solve_ivp(damped, (0.0, 60.0), [*settled, 0.0], events=top, **precise)
    times, (_, _, sums) = run.t_events[0], run.y_events[0].T
    mean = (sums[-1] - sums[0]) / (times[-1] - times[0])
    assert exponents(0.1).motion.limit[1] == pytest.approx(mean, rel=1e-7)


def test_weakly_damped_it_decays_as_averaging_says():
    assert exponents(0.1).motion.limit[1] == pytest.approx(-0.1, abs=0.1**3)
    assert exponents(0.1).motion.period == pytest.approx(2 * np.pi * (1 + 0.1**2 / 16), abs=1e-4)
