"""Loops of a plant and a controller that follow each other at once."""

import numpy as np
import pytest

from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.master import run_loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.step_choice import choose_step


class Lag:
    """x' = u - x, y = x + D u; y as soon as u is set, or only in the step."""

    name, inputs, outputs, sample_time = "lag", ("u",), ("y",), 0.0

    def __init__(self, feedthrough, at_once=True, can_save=True):
        self.D, self.at_once, self.can_save = feedthrough, at_once, can_save

    def nominal(self, name):
        return 1.0

    def is_real(self, name):
        return True

    def follows_at_once(self, name):
        return True

    def initially_from(self, name):
        return self.inputs

    def enter_initialization(self, values, stop):
        self.x, self.u, self.y = 0.0, 0.0, 0.0

    def leave_initialization(self):
        pass

    def writer(self, names):
        def write(values):
            if names:
                self.u = float(values[0])

        return write

    def reader(self, names):
        def read():
            if self.at_once:
                self.y = self.x + self.D * self.u
            return np.full(len(names), self.y)

        return read

    def step(self, t, h):
        self.x = self.u + (self.x - self.u) * np.exp(-h)
        self.y = self.x + self.D * self.u

    def save(self):
        return self.x, self.u, self.y

    def restore(self, state):
        self.x, self.u, self.y = state

    def release(self, state):
        pass

    def reopened(self):
        return type(self)(self.D, self.at_once, self.can_save)

    def close(self):
        pass


class Gain(Lag):
    """u = f(K (x_d - y)), at once."""

    name, inputs, outputs = "gain", ("y", "x_d"), ("u",)

    def __init__(self, K, shape=float, can_save=True):
        self.K, self.shape, self.can_save = K, shape, can_save
        self.w = np.zeros(2)

    def enter_initialization(self, values, stop):
        self.w = np.zeros(2)

    def writer(self, names):
        at = [self.inputs.index(n) for n in names]

        def write(values):
            self.w[at] = values

        return write

    def reader(self, names):
        return lambda: np.array([self.shape(self.K * (self.w[1] - self.w[0])) for _ in names])

    def step(self, t, h):
        pass

    def save(self):
        return self.w.copy()

    def restore(self, state):
        self.w[:] = state

    def reopened(self):
        return type(self)(self.K, self.shape, self.can_save)


def run(plant, controller, step=0.01, **options):
    return run_loop(plant, controller, Reference.constant(1.0), 2.0, step, **options)


@pytest.mark.parametrize("coupling", [Coupling.JACOBI, Coupling.GAUSS_SEIDEL])
@pytest.mark.parametrize("can_save", [True, False])
@pytest.mark.parametrize("gain", [0.5, 20.0])
def test_every_row_solves_the_loop_and_the_run_meets_the_exact_solution(coupling, can_save, gain):
    """u = K (1 - x) / (1 + K D), also where simple iteration of the loop would run away."""
    K, D = gain / 0.2, 0.2
    slope = K / (1 + K * D)
    result = run(Lag(D, can_save=can_save), Gain(K, can_save=can_save), 1e-3, coupling=coupling)
    x = slope / (1 + slope) * (1 - np.exp(-(1 + slope) * result.time))
    exact = x + D * slope * (1 - x)
    y, u = result.outputs["y"], result.commands["u"]
    assert np.abs(y - exact).max() < 5e-3
    assert result.verdict.trusted
    if coupling is Coupling.GAUSS_SEIDEL:
        np.testing.assert_allclose(u, K * (1 - y), atol=1e-9)


def test_a_loop_that_is_not_linear_is_solved_too():
    result = run(Lag(0.3), Gain(4.0, np.tanh))
    np.testing.assert_allclose(
        result.commands["u"], np.tanh(4.0 * (1 - result.outputs["y"])), atol=1e-9
    )
    assert result.verdict.trusted


@pytest.mark.parametrize("can_save", [True, False])
def test_a_plant_that_shows_only_in_its_step_what_it_does_at_once_is_named(can_save):
    """With a gain of 2 the loop diverges from step to step, whatever the step."""

    def run_at(step, look_again=True):
        plant = Lag(0.2, at_once=False, can_save=can_save)
        return run(plant, Gain(10.0, can_save=can_save), step, look_again=look_again)

    result, choice = choose_step(run_at, 0.01)
    assert not result.verdict.trusted
    assert "algebraic loop has a loop gain of 2" in result.verdict.reason
    assert "a smaller step does not help" in result.verdict.reason
    assert len(choice.tried) == 1


def test_a_small_gain_in_the_step_alone_is_a_matter_of_the_step():
    result = run(Lag(0.2, at_once=False), Gain(1.0), 1e-3)
    assert "algebraic" not in result.verdict.reason


def test_a_relay_in_the_loop_finds_no_values_that_agree():
    with pytest.raises(Exception, match=r"algebraic loop through controller\.u has no solution"):
        run(Lag(2.0), Gain(4.0, np.sign))
