"""A DC motor under P, PD and PID: the band in which it rests, and other solvers."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew.gallery.dc_motor import findings as ours

FAR = 1e3  # s, until which a motor that sticks breaks away, if at all


@dataclass(frozen=True)
class Loop:
    """The motor and its laws, written anew: angle, speed, current, integral of the error."""

    goal: float = 1.0
    static: float = 1.5e-3
    ki: float = 0.0
    kd: float = 0.0

    def command(self, y):
        return 10.0 * (self.goal - y[0]) - self.kd * y[1] + self.ki * y[3]

    def level(self, speed):
        return 1e-3 + (self.static - 1e-3) * np.exp(-(speed**2))

    def rates(self, y, friction):
        current = (self.command(y) - 21.4 * y[2] - 0.0374482 * y[1]) / 0.953e-3
        return [y[1], (37.4e-3 * y[2] - friction) / 4.2e-7, current, self.goal - y[0]]

    def rests(self, stop):
        """When each stick begins, and its angle; Radau between events."""
        time, y, found = 0.0, np.array([0.0, 0.0, 0.0, 0.0]), []

        def event(function, direction):
            function.terminal, function.direction = True, direction
            return function

        def between(rates, until, *events):
            nonlocal time, y
            run = solve_ivp(rates, (time, until), y, "Radau", rtol=1e-9, atol=1e-11, events=events)
            time, y = float(run.t[-1]), run.y[:, -1].copy()
            return run.status == 1

        def stuck(_t, y):
            return self.rates(y, 37.4e-3 * y[2])

        def sliding(_t, y):
            return self.rates(y, direction * self.level(y[1]) + 2e-5 * y[1])

        up = event(lambda _t, y: 37.4e-3 * y[2] - self.static, 1.0)
        down = event(lambda _t, y: 37.4e-3 * y[2] + self.static, -1.0)
        while time < stop:
            if abs(37.4e-3 * y[2]) < self.static:
                found.append((time, y[0]))
                if not between(stuck, time + FAR, up, down):
                    break
            direction = np.sign(y[2])
            y[1] = 1e-9 * direction
            if not between(sliding, time + 10.0, event(lambda _t, y: y[1], -direction)):
                break
            y[1] = 0.0
        return np.array(found)


PID = {"ki": 1000.0, "kd": 0.05}


@pytest.mark.parametrize(("law", "kd"), [("P", 0.0), ("PD", 0.05)])
def test_the_error_left_is_that_of_another_solver(law, kd):
    _, angle = Loop(kd=kd).rests(0.3)[-1]
    assert ours.left(law, 1.0) == pytest.approx(1.0 - angle, abs=1e-6)


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


def test_hunting_is_that_of_another_solver():
    turns = Loop(static=1.5e-3, **PID).rests(2.0)[-4:]
    found = ours.hunting()
    assert found.period == pytest.approx(turns[3, 0] - turns[1, 0], rel=1e-5)
    assert found.amplitude["plant_x"] == pytest.approx(abs(1.0 - turns[3, 1]), rel=1e-5)


def test_with_no_fall_of_friction_the_sticks_are_those_of_another_solver():
    _, errors = ours.creeping()
    theirs = 1.0 - Loop(static=1e-3, **PID).rests(4.0)[:, 1]  # the first is the start
    assert len(errors) >= 4
    assert errors[:4] == pytest.approx(theirs[1:5], rel=1e-5)
    assert errors[1:] / errors[:-1] == pytest.approx(ours.ratio(), rel=1e-6)


def test_another_solver_hunts_beyond_the_border_and_not_before():
    border = ours.hunts_from(ours.MOTOR) * 1e-3
    assert len(Loop(static=1.02 * border, **PID).rests(4.0)) > 20
    assert len(Loop(static=0.98 * border, **PID).rests(4.0)) < 20


def test_with_bristles_another_solver_hunts_beyond_its_border_and_not_before():
    def rates(static):
        loop = Loop(static=static, **PID)

        def of(_t, y):
            bend = y[1] - abs(y[1]) / loop.level(y[1]) * y[4]
            return [*loop.rates(y[:4], y[4] + 2e-5 * bend + 2e-5 * y[1]), bend]

        return of

    border = ours.hunts_from(ours.LUGRE) * 1e-3
    swings = []
    for static in (0.98 * border, 1.02 * border):
        run = solve_ivp(
            rates(static), (0.0, 3.0), [0.0] * 5, "LSODA", rtol=1e-7, atol=1e-10, max_step=0.02
        )
        swings.append(np.ptp(run.y[0][run.t > 2.0]))
    assert swings[0] < 1e-3 < 0.02 < swings[1]


def test_with_bristles_and_no_fall_it_comes_to_rest_and_with_sticking_it_creeps():
    given = {"Fs": ours.FC}
    late = [
        abs(1.0 - ours.motion("PID", 1.0, 3.0, 0.1, motor, given).outputs["x"][-1])
        for motor in (ours.MOTOR, ours.LUGRE)
    ]
    assert late[1] < 1e-9 < 1e-4 < late[0]
    found = ballscrew.lyapunov(
        ours.LAWS["PID"], ours.LUGRE, stop=5.0, reference=1.0, plant_values=given
    ).motion
    assert found.kind.value == "stuck on a line of equilibria"


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
