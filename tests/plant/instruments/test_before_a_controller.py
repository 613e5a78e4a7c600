"""A controller that is sampled, or measures through instruments: sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballscrew.controllers.linearization import input_output_linearization
from ballscrew.controllers.pid import pid, pid_sampled
from ballscrew.controllers.relay import relay
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.plant.instruments.current_sensor import current_sensor
from ballscrew.plant.instruments.encoder import encoder, position_encoder
from ballscrew.plant.instruments.measured_through import measured_through
from ballscrew.plant.instruments.sample_and_hold import sampled
from ballscrew.plant.instruments.velocity_estimate import velocity_estimate
from ballscrew.solver.codegen import generate
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import Model

PERIOD = 1e-3
CHAIN = (position_encoder(), velocity_estimate(), current_sensor())


def chained(controller, signals):
    """The command after each sample of parts that are asked one after the other."""
    parts = [Model(generate(c)) for c in (*CHAIN, controller)]
    commands = []
    for k, row in enumerate(signals):
        present = dict(row)
        for model in parts:
            for i in model.kernel.inputs:
                model.set_input(i.name, present[i.name])
            if model.kernel.discrete:
                model.sample(k * PERIOD)
            read = model.outputs(k * PERIOD, model.x)
            present |= {n.removesuffix("_measured"): v for n, v in read.items()}
        commands.append(present["u"])
        if parts[-1].kernel.states:
            parts[-1].advance(k * PERIOD, (k + 1) * PERIOD)
    return np.array(commands)


def moving(count):
    random = np.random.default_rng(5)
    t = np.arange(count) * PERIOD
    course = {"x": 0.08 * (1 - np.exp(-5 * t)), "v": 0.4 * np.exp(-5 * t)}
    course |= {"z": 1e-5 + 1e-7 * random.normal(size=count), "i": 0.3 * np.cos(40 * t)}
    return [{n: s[k] for n, s in course.items()} | {"x_d": 0.08} for k in range(count)]


@pytest.mark.parametrize("name", ["iol+sampled", "nctf+sampled"])
def test_at_each_sample_it_commands_as_the_chain_asked_one_after_the_other(name):
    controller = component(name)
    signals = moving(30)
    whole = Model(generate(measured_through(controller, CHAIN)))
    commands = []
    for k, row in enumerate(signals):
        for name, value in row.items():
            whole.set_input(name, value)
        whole.sample(k * PERIOD)
        commands.append(whole.outputs(k * PERIOD, whole.x)["u"])
        if whole.kernel.states:
            whole.advance(k * PERIOD, (k + 1) * PERIOD)
    expected = chained(controller, signals)
    assert np.ptp(expected) > 1.0
    np.testing.assert_allclose(commands, expected, rtol=1e-12, atol=1e-9)


def test_what_makes_no_chain_is_refused_with_one_line():
    late = replace(
        velocity_estimate(), sample_time=replace(velocity_estimate().sample_time, default=2e-3)
    )
    with pytest.raises(ContractError, match=r"pid_sampled samples every 0.001 s and velocity_esti"):
        measured_through(pid_sampled(), [late])
    with pytest.raises(ContractError, match="'x_counted' does not say what it measures"):
        measured_through(pid_sampled(), [encoder()])
    with pytest.raises(ContractError, match="measures 'i', which none of velocity_estimate takes"):
        measured_through(velocity_estimate(), [current_sensor()])


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
