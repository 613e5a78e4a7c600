"""A mass under PID control: another solver, the closed form of a slip, and a theorem."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew.gallery.pid_mass import findings as ours


@dataclass(frozen=True)
class Loop:
    """The example, written anew: error e, velocity v and force q of P and I."""

    static: float = 1.5
    stribeck: float = 1e-3
    viscous: float = 0.4
    kd: float = 6.0

    def rates(self, direction):
        def of(_t, y):
            e, v, q = y
            fall = (self.static - 1.0) * np.exp(-((v / self.stribeck) ** 2))
            friction = direction * (1.0 + fall) + self.viscous * v
            return [-v, q - self.kd * v - friction, 4.0 * e - 3.0 * v]

        return of

    def sticks(self, error, stop):
        """Begin and error of each stick after a step from rest, by DOP853 between events."""
        time, y, found = 0.0, np.array([error, 0.0, 3.0 * error]), []

        def stops(_t, y):
            return y[1]

        while time < stop:
            if abs(y[2]) < self.static:
                found.append((time, y[0]))
                held = (np.sign(y[0]) * self.static - y[2]) / (4.0 * y[0])
                time, y[2] = time + held, np.sign(y[0]) * self.static
            direction = np.sign(y[2])
            stops.terminal, stops.direction = True, -direction
            end = solve_ivp(
                self.rates(direction),
                (time, max(stop, time) + 100.0),
                y,
                "DOP853",
                rtol=1e-10,
                atol=1e-13,
                events=stops,
                first_step=1e-6,
            )
            if end.status != 1:
                break
            time, y = end.t[-1], end.y[:, -1].copy()
            y[1] = 0.0
        return np.array(found)

    def hunts(self, error=1.0):
        return len(self.sticks(error, 2000.0)) > 50


@pytest.mark.parametrize("static", [1.0, 1.5])
def test_the_sticks_of_both_motions_are_those_of_another_solver(static):
    run = ballscrew.run(
        ours.PID,
        ours.MASS,
        reference=1.0,
        stop=200.0,
        step=0.1,
        coupling=ballscrew.Coupling("monolithic"),
        plant_values={"Fs": static},
    ).run
    _, errors = ours.sticks(run)
    _, theirs = Loop(static).sticks(1.0, 200.0).T
    assert len(errors) >= 6
    assert errors == pytest.approx(theirs[: len(errors)], rel=1e-5)


def test_without_a_fall_each_stick_takes_as_long_as_its_error_says():
    times, errors = ours.sticks(ours.motion(4000.0, 0.5, 1.0))
    begins = Loop(1.0).sticks(1.0, 3000.0)[:, 0]
    late = slice(4, len(errors))
    lasts = times[late] - begins[late]
    assert lasts == pytest.approx(2.0 / (4.0 * np.abs(errors[late])), rel=0.02)


def test_the_closed_form_of_the_cycle_leaves_out_terms_in_the_width_of_the_fall():
    misses = []
    for width in (4e-3, 1e-3, 2.5e-4):
        found = ballscrew.lyapunov(
            ours.PID, ours.MASS, stop=200.0, reference=1.0, plant_values={"Vs": width}
        ).motion
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ours, "VS", width)
            ours.cycle.cache_clear()
            closed = np.array(ours.cycle(0.5))
        here = np.array([found.amplitude["plant_x"], found.period, found.limit[1]])
        misses.append(np.abs(here / closed - 1.0))
    ours.cycle.cache_clear()
    orders = np.log(np.array(misses[:-1]) / np.array(misses[1:])) / np.log(4.0)
    assert orders.min() > 0.9
    assert misses[1].max() < 0.01


def test_the_time_until_friction_falls_is_that_of_the_riccati_equation():
    width, error, fall = 1e-3, 0.07, 0.5

    def rates(t, v):
        return 4.0 * error * t + fall * (v / width) ** 2

    def far(_t, v):
        return v[0] - 1e3

    far.terminal = True
    end = solve_ivp(rates, (0.0, 1.0), [0.0], "DOP853", rtol=1e-11, atol=1e-14, events=far)
    assert end.t[-1] == pytest.approx(ours.late(error, fall), rel=1e-5)


def test_the_cycle_is_in_proportion_to_the_fall_of_friction():
    swings = [
        ballscrew.lyapunov(
            ours.PID, ours.MASS, stop=200.0, reference=1.0, plant_values={"Fs": fs, "Vs": 1e-6}
        ).motion.amplitude["plant_x"]
        for fs in (1.25, 1.5)
    ]
    assert swings[1] == pytest.approx(2.0 * swings[0], rel=1e-3)


def test_another_solver_hunts_below_the_border_of_the_gain_and_not_above():
    soft = {"stribeck": 0.05, "viscous": 0.0}
    assert Loop(kd=0.98 * ours.border(), **soft).hunts()
    assert not Loop(kd=1.02 * ours.border(), **soft).hunts()


def test_with_the_same_gains_it_hunts_after_a_large_step_and_not_after_a_small_one():
    soft = {"stribeck": 0.05, "viscous": 0.0, "kd": 5.0}
    swings = []
    for step in (0.01, 0.04):
        run = ballscrew.run(
            ours.PID,
            ours.MASS,
            reference=step,
            stop=400.0,
            step=1.0,
            coupling=ballscrew.Coupling("monolithic"),
            plant_values=ours.SOFT,
            controller_values={"Kd": 5.0},
        ).run
        x = run.outputs["x"]
        swings.append(np.ptp(x[len(x) // 2 :]))
        assert Loop(**soft).hunts(step) == (swings[-1] > 0.05)
    assert swings[0] < 0.01 < 0.05 < swings[1]


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
    run = ballscrew.run(
        ours.PID,
        ours.MASS,
        reference=1.0,
        stop=40.0,
        step=0.01,
        coupling=ballscrew.Coupling("monolithic"),
        plant_values={
            **{"m": mass, "Fc": coulomb, "Fs": coulomb, "sigma2": 0.0},
            **{"x_start": 1.0 - error, "v_start": v},
        },
        controller_values={"Kp": kp, "Ki": ki, "Kd": kd, "w_start": w},
    ).run
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
