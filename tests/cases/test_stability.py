"""Loops at rest and on a cycle: limits of exponents within their bars, by other solvers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.kernel import Model
from ballscrew.stability.attractor import Kind
from ballscrew.stability.lyapunov import loop_lyapunov, loop_maker
from ballscrew.stability.map_plan import MapPlan, read_axis, run_cell

SLIP = {"m": 1.0592, "sigma2": 30.085, "Fc": 1.17, "Fs": 1.916, "Vs": 0.00039438}
SLIP |= {"ke": 0.0010629, "sigma0": 43344.0, "sigma1": 146.87}
SLOW_CYCLE = Loop(
    "pid",
    plant_values=SLIP,
    controller_values={"Kp": 53.115, "Ki": 1500.0, "Kd": 0.42823},
    reference=0.05,
    stop=30.0,
)
DRIVE = {"m": 30.0, "sigma0": 2e6, "sigma1": 3e3, "sigma2": 180.0, "Fc": 22.0, "Vs": 4e-3}
KP, KD, GOAL = 2e5, 3e3, 0.01


def shrinking(model: Model) -> tuple[float, float]:
    """Period, and rate at which returns to a plane come together [1/s]; by SciPy's Radau.

    They come from both sides in turn, so both are means over two periods.
    """
    scale = model.kernel.nominal

    def rates(t, y):
        return model.derivatives(t, y * scale) / scale

    def slopes(t, y):
        return model.jacobian(t, y * scale) * scale / scale[:, None]

    def passes(_, y):
        return y[1] * scale[1] - 2e-3  # m/s, once in each slip forwards

    passes.direction = 1
    how = {"jac": slopes, "rtol": 1e-7, "atol": 1e-9, "events": passes}
    run = solve_ivp(rates, (0.0, 20.0), model.x / scale, "Radau", **how)
    apart = np.linalg.norm(np.diff(run.y_events[0], axis=0), axis=1)
    two = run.t_events[0][-1] - run.t_events[0][-3]
    return two / 2, np.log(apart[-1] / apart[-3]) / two


@pytest.mark.ci
def test_a_cycle_that_is_nearly_reached_has_its_exponents_within_their_bars():
    motion = loop_lyapunov(SLOW_CYCLE).motion
    assert motion.kind is Kind.CYCLE, motion.evidence
    model = loop_maker(SLOW_CYCLE)(1e-9)
    model.advance(0.0, 30.0)
    period, rate = shrinking(model)
    assert motion.period == pytest.approx(period, rel=1e-3)
    assert motion.limit[1] == pytest.approx(rate, rel=0.02)
    off = np.abs(motion.limit[:2] - [0.0, -0.06147 * np.log(2.0)])  # after 300 s; half a digit
    assert np.all(off <= motion.limit_error[:2] + np.array([0.0, 4e-6]))
    assert np.all(motion.limit_error[:2] < 2e-3 * abs(rate))


def course(ki: float, fs: float) -> np.ndarray:
    """x, v, integral and bristles of a PID on a drive with LuGre friction over 5 s, by SciPy."""

    def rates(_, s):
        x, v, w, z = s
        level = DRIVE["Fc"] + (fs - DRIVE["Fc"]) * np.exp(-((v / DRIVE["Vs"]) ** 2))
        bent = v - DRIVE["sigma0"] * abs(v) * z / level
        friction = DRIVE["sigma0"] * z + DRIVE["sigma1"] * bent + DRIVE["sigma2"] * v
        command = KP * (GOAL - x) - KD * v + ki * w
        return [v, (command - friction) / DRIVE["m"], GOAL - x, bent]

    return solve_ivp(
        rates, (0.0, 5.0), np.zeros(4), "LSODA", rtol=1e-9, atol=1e-15, dense_output=True
    ).sol(np.linspace(0.0, 5.0, 5001))


def eigenvalues(ki: float, fs: float, z: float, side: float) -> np.ndarray:
    """Real parts at rest with these bristles, on one side of zero velocity."""
    bent = 1.0 - side * DRIVE["sigma0"] * z / fs
    damping = KD + DRIVE["sigma1"] * bent + DRIVE["sigma2"]
    rows = [
        [0.0, 1.0, 0.0, 0.0],
        np.array([-KP, -damping, ki, -DRIVE["sigma0"]]) / DRIVE["m"],
        [-1.0, 0.0, 0.0, 0.0],
        [0.0, bent, 0.0, 0.0],
    ]
    return np.sort(np.linalg.eigvals(np.array(rows)).real)[::-1]


@pytest.mark.parametrize(("ki", "fs"), [(2e5, 41.0), (4.4e6 / 3.0, 22.0), (4e6, 22.0)])
def test_what_rests_does_not_creep_and_its_limits_are_those_of_the_side_it_comes_from(ki, fs):
    _, v, _, z = course(ki, fs)
    own = {"Kp": KP, "Kd": KD}
    loop = Loop("pid", "drive_lugre", GOAL, 5.0, plant_values=DRIVE, controller_values=own)
    axes = read_axis("Ki=1e5:5e6:2", loop), read_axis("plant.Fs=22:60:2", loop)
    assert run_cell(MapPlan(loop, *axes), ki, fs, 1e-6).verdict is Kind.LINE
    given = {"plant_values": DRIVE | {"Fs": fs}, "controller_values": own | {"Ki": ki}}
    motion = loop_lyapunov(replace(loop, **given)).motion
    assert motion.kind is Kind.LINE, motion.evidence
    exact = eigenvalues(ki, fs, z[-1], np.sign(v[np.flatnonzero(np.abs(v) > 1e-10)[-1]]))
    np.testing.assert_allclose(motion.limit, exact, rtol=1e-4, atol=1e-9)
    assert np.all(motion.limit_error <= 1e-4 * np.abs(exact))
