"""Continuous laws that are sampled and held."""

from __future__ import annotations

import pytest

from ballscrew.controllers.linearization import input_output_linearization
from ballscrew.controllers.pid import pid, pid_sampled
from ballscrew.controllers.relay import relay
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.plant.instruments.sample_and_hold import sampled
from ballscrew.solver.codegen import generate
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import Model


@pytest.mark.parametrize("name", ["iol_observed", "pid+feed_forward"])
def test_what_a_set_point_does_between_two_samples_changes_nothing(name: str) -> None:
    def course(between: float) -> list[float]:
        model = Model(generate(sampled(component(name))))
        given = {i.name: 1e-4 for i in model.kernel.inputs if i.name in ("x_d", "v_d", "a_d")}
        commands = []
        for k in range(40):
            for signal, value in given.items():
                model.set_input(signal, value * (k + 1))
            model.sample(k * 1e-3)
            commands.append(model.outputs(k * 1e-3, model.x)["u"])
            for signal, value in given.items():
                model.set_input(signal, value * (k + 1) * between)
            model.advance(k * 1e-3, (k + 1) * 1e-3)
        return commands

    assert course(1.3) == course(1.0)


def test_what_is_sampled_already_or_has_modes_is_refused() -> None:
    with pytest.raises(ContractError, match="discrete states"):
        sampled(pid_sampled())
    with pytest.raises(ContractError, match="modes"):
        sampled(component("plant_classical"))
    for delay in (-1, 0.5):
        with pytest.raises(ContractError, match="expected 0, 1, 2"):
            sampled(pid(), delay=delay)


def test_a_delayed_command_is_that_of_so_many_samples_before() -> None:
    delay = 3
    held = Model(generate(sampled(input_output_linearization(), delay=delay)))
    law = Model(generate(input_output_linearization()))
    expected = [0.0] * delay
    for k in range(8):
        for model in (held, law):
            model.set_input("x", 1e-3 * k**2)
            model.set_input("x_d", 0.08)
        expected.append(law.outputs(0.0, law.x)["u"])
        held.sample(k * 1e-3)
        assert held.outputs(0.0, held.x)["u"] == pytest.approx(expected[k], rel=1e-12)


def test_a_sampled_relay_switches_at_the_first_instant_beyond_its_hysteresis() -> None:
    digital = Model(generate(sampled(relay())))
    commands = []
    for k, x in enumerate([0.0, 0.5e-4, -1.5e-4, 0.5e-4, 1.5e-4, 0.0, -1.5e-4]):
        digital.set_input("x", x)
        digital.sample(k * 1e-3)
        commands.append(digital.outputs(0.0, digital.x)["u"])
    assert commands == [0.0, 0.0, 15.0, 15.0, -15.0, -15.0, 15.0]
