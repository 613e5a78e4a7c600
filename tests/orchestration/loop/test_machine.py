"""Motions and gains that fit a machine."""

import math

import numpy as np
import pytest
from heavy_drive import HEAVY

from ballscrew.controllers.p_pi import cascade
from ballscrew.orchestration.loop.machine import Machine, gain_ranges, model_values
from ballscrew.orchestration.loop.parts import Part
from ballscrew.orchestration.loop.reference_motions import read_motion
from ballscrew.plant import LAWS, plant_of
from ballscrew.solver.errors import BadParameter


def heavy(**other):
    return Machine(Part("drive_lugre"), {**HEAVY, **other}, 500.0)


@pytest.mark.ci
@pytest.mark.parametrize("law", LAWS)
def test_a_command_that_slides_steadily_overcomes_friction_and_back_emf(law):
    machine = Machine(Part(plant_of(law)), {}, 36.0)
    at = machine.sliding(0.05)
    axis = 37.4e-3 * 2 * math.pi * 1000
    friction = axis * at["i"]
    back_emf = 1 / (255 * 2 * math.pi / 60) * 2 * math.pi * 1000 * 0.05
    assert at["u"] == pytest.approx(21.4 * friction / axis + back_emf, rel=1e-9)
    values = {n: p.default for n, p in machine.plant.parameters.items()}
    if law in ("lugre", "modified_lugre", "classical", "maxwell_slip"):
        steady = values["Fc"] + values["sigma2"] * 0.05
        assert friction == pytest.approx(steady, rel=1e-5)


def test_a_heavy_drive_is_its_mass_and_its_viscous_friction():
    machine = heavy(gain=4.0)
    assert machine.command_per_speed == pytest.approx(200.0 / 4, rel=1e-6)
    assert machine.command_per_acceleration == pytest.approx(40.0 / 4, rel=1e-6)


def test_the_nominal_axis_is_what_the_cascade_s_rule_says():
    values = model_values(Part("p_pi"), Machine(Part("plant"), {}, 36.0))
    rule = cascade()
    assert values["Fv"] == pytest.approx(rule.velocity_forward, rel=1e-3)
    assert values["Fa"] == pytest.approx(rule.acceleration_forward, rel=1e-3)


def test_motions_stay_within_the_limit():
    machine = heavy()
    assert machine.sliding(machine.speed)["u"] <= 0.5 * 500.0
    assert machine.sliding(2 * machine.speed)["u"] > 0.0
    assert machine.acceleration * 40.0 <= 0.3 * 500.0
    step, move, judge = map(read_motion, machine.motions())
    time = np.linspace(0.0, 2.0, 20_001)
    assert abs(move.on(time, 1)).max() == pytest.approx(machine.speed)
    assert abs(move.on(time, 2)).max() <= machine.acceleration * (1 + 1e-9)
    assert 0 < step.values.max() < move.values.max()
    assert judge.values.min() < 0 == judge.values.max()


def test_ranges_go_with_the_inertia_and_inversely_with_the_command_s_force():
    one, _ = gain_ranges(Part("pid"), heavy(sigma2=0.0))
    other, _ = gain_ranges(Part("pid"), heavy(sigma2=0.0, m=80.0, gain=4.0))
    for name, ends in one.items():
        assert other[name] == pytest.approx([e * 2 / 4 for e in ends], rel=1e-6)
    cascade_one, _ = gain_ranges(Part("p_pi"), heavy())
    assert cascade_one["Kx"] == (0.5, 50.0)  # a bandwidth is one on every machine


def test_the_start_closes_a_stable_loop_of_twenty_per_second():
    _, start = gain_ranges(Part("pid"), heavy())
    assert start["Kp"] == pytest.approx(abs(20 * (40.0 * 20j + 200.0)), rel=1e-6)
    assert (200.0 + start["Kd"]) * start["Kp"] > 40.0 * start["Ki"]  # Routh


def test_a_controller_gets_its_machine_s_values():
    values = model_values(Part("pid_lugre"), heavy(gain=2.0))
    assert values["sigma0_hat"] == 1e7
    assert values["u_max"] == 500.0
    assert values["force_per_volt"] == 2.0
    assert not {"Kp", "Ki", "Kd", "k"} & values.keys()
    values = model_values(Part("pid_dob"), heavy())
    assert values["b"] == pytest.approx(1 / 200.0, rel=1e-6)
    assert values["lag"] == pytest.approx(0.2, rel=1e-6)


def test_a_limit_is_asked_for_only_where_nobody_says_it():
    drive = Part("drive_lugre")
    assert Machine.of(drive, {}, 7.0).limit == 7.0
    assert Machine.of(drive, {"voltage_limit": 5.0}, None).values == {"voltage_limit": 5.0}
    assert Machine.of(Part("plant"), {}, None).limit == 36.0
    with pytest.raises(BadParameter, match="--limit"):
        Machine.of(drive, {}, None)
    with pytest.raises(BadParameter, match="more than 0"):
        Machine.of(drive, {}, 0.0)
