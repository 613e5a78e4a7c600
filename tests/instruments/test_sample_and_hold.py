"""Continuous laws that are sampled and held."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ballscrew.controllers.linearization import input_output_linearization
from ballscrew.controllers.pid import pid
from ballscrew.controllers.pid_sampled import pid_sampled
from ballscrew.fmus.catalogue import component
from ballscrew.instruments.sample_and_hold import sampled_and_held
from ballscrew.orchestration.whole_loop import loop_kernel
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, ContractError
from ballscrew.solver.kernel import Model


def test_a_held_command_is_the_continuous_law_at_the_last_sample() -> None:
    law = Model(generate(input_output_linearization()))
    held = Model(generate(sampled_and_held(input_output_linearization(), "iol_sampled")))
    read = {"x": 0.03, "v": 0.02, "z": 1e-5, "i": 0.4, "x_d": 0.08}
    for model in (law, held):
        for name, value in read.items():
            model.set_input(name, value)
    held.sample(0.0)  # reads the measurements,
    held.sample(0.0)  # and commands by them
    expected = law.outputs(0.0, law.x)["u"]
    held.set_input("x", 0.05)
    assert held.outputs(0.0, held.x)["u"] == pytest.approx(expected, rel=1e-12)


def test_the_sampled_loop_goes_to_the_continuous_one_in_the_first_order() -> None:
    def end(controller: Component) -> float:
        model = Model(loop_kernel("plant_classical", controller))
        model.set_input("x_d", 0.08)
        period = model.sample_time or 0.1
        for k in range(round(0.2 / period)):
            if model.sample_time:
                model.sample(k * period)
            model.advance(k * period, (k + 1) * period)
        return model.outputs(0.2, model.x)["x"]

    errors = []
    for period in (1e-3, 5e-4):
        law = sampled_and_held(pid(), "pid_held")
        given = replace(law.sample_time, default=period)
        errors.append(abs(end(replace(law, sample_time=given)) - end(pid())))
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.1)


def test_what_is_sampled_already_or_has_modes_is_refused() -> None:
    with pytest.raises(ContractError, match="discrete states"):
        sampled_and_held(pid_sampled(), "twice")
    with pytest.raises(ContractError, match="modes"):
        sampled_and_held(component("plant_classical"), "sticking")
    assert sampled_and_held(pid(), "held").sample_time is not None
