"""A controller that measures through instruments is that chain, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballscrew.controllers.pid import pid_sampled
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.plant.instruments.current_sensor import current_sensor
from ballscrew.plant.instruments.encoder import encoder, position_encoder
from ballscrew.plant.instruments.measured_through import measured_through
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
