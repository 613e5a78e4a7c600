"""The PIDs: the tuning rule against numbers worked by hand, and the sampled one's arithmetic."""

import math

import numpy as np
import pytest

from ballscrew.controllers.pid import simc
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model


def test_simc_gains_follow_the_rule_for_an_integrating_process_with_a_lag():
    force_per_ampere = 37.4e-3 * 2 * math.pi * 1000
    back_emf = 2 * math.pi * 1000 / (255 * 2 * math.pi / 60)
    damping = 173 + force_per_ampere * back_emf / 21.4
    gain = force_per_ampere / 21.4 / damping
    time = 0.6 + 0.953e-3 / 21.4
    assert gain == pytest.approx(0.00398, rel=2e-3)  # m/s per volt, as 30 V give 0.119 m/s
    g = simc()
    assert g.proportional == pytest.approx(1 / (gain * time) * (1 + 1 / damping / (4 * time)))
    assert g.integral == pytest.approx(1 / (gain * time) / (4 * time))
    assert g.derivative == pytest.approx(1 / (gain * time) / damping)


def test_sampled_pid_does_the_difference_equation_at_its_samples():
    model = Model(generate(component("pid_sampled")))
    gains = simc()
    x = np.array([0.0, 0.001, 0.003, 0.002])
    integral, last = 0.0, 0.0
    for k, position in enumerate(x):
        model.set_input("x", position)
        model.set_input("x_d", 0.08)
        model.sample(k * 1e-3)
        error = 0.08 - position
        integral += 1e-3 * error
        expected = (
            gains.proportional * error
            + gains.integral * integral
            - gains.derivative * (position - last) / 1e-3
        )
        last = position
        assert model.outputs(k * 1e-3, model.x)["u"] == pytest.approx(expected, rel=1e-12)
