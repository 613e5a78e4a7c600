"""Tuning on costs whose minima are known; what runs get: a duty's and a drawn plant, noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.orchestration.study.loop import StudyLoop
from ballscrew.orchestration.study.plan import Duty, Entrant, Plan, Variation
from ballscrew.orchestration.study.study import contenders_of
from ballscrew.orchestration.study.tuning import Contender, tune

RANGES = {"a": (1e-2, 1e3), "b": (-5.0, 5.0)}
PUBLISHED = {"a": 100.0, "b": 0.0, "c": 7.0}


def bowl(values) -> float:
    """Smallest, 1, at a = 3, b = 2."""
    return 1 + math.log(values["a"] / 3) ** 2 + (values["b"] - 2) ** 2


def test_a_minimum_is_found_within_the_budget():
    found = tune(bowl, PUBLISHED, RANGES, 200, 1)
    assert found.cost == pytest.approx(1.0, abs=1e-2)
    assert found.values == {"a": pytest.approx(3, rel=0.1), "b": pytest.approx(2, abs=0.1)}
    assert found.doubled_cost <= found.cost
    assert found.tried == 400
    assert found.at_bound == ()


@pytest.mark.ci
@pytest.mark.parametrize("seed", range(5))
def test_tuned_is_never_worse_than_the_published_rule(seed):
    """Even with a budget of two on a cost that punishes every move."""
    found = tune(lambda v: 0.0 if v == PUBLISHED else 1.0 + v["a"], PUBLISHED, RANGES, 2, seed)
    assert found.cost == found.published_cost == 0.0
    assert found.values == {"a": 100.0, "b": 0.0}


def test_exactly_the_budget_decides_and_twice_as_many_are_tried():
    asked = []

    def cost(values) -> float:
        asked.append(dict(values))
        return bowl(values)

    found = tune(cost, PUBLISHED, RANGES, 17, 3)
    assert len(asked) == 34
    assert asked[0] == PUBLISHED
    assert all(v["c"] == 7.0 for v in asked)
    assert found.cost == min(map(bowl, asked[:17]))
    assert found.doubled_cost == min(map(bowl, asked))


def test_the_same_seed_gives_the_same_values_and_another_others():
    first, again, other = (tune(bowl, PUBLISHED, RANGES, 20, seed) for seed in (1, 1, 2))
    assert first == again
    assert first.values != other.values


def test_every_candidate_is_within_its_range_and_an_end_is_told():
    asked = []

    def cost(values) -> float:
        asked.append(values["b"])
        return -values["b"] + abs(math.log(values["a"]))

    found = tune(cost, PUBLISHED, RANGES, 150, 1)
    assert all(-5 <= b <= 5 for b in asked)
    assert found.at_bound == ("b",)


def test_one_parameter_alone_can_be_tuned():
    for seed in range(20):
        found = tune(lambda v: (v["b"] - 1) ** 2, PUBLISHED, {"b": (-5.0, 5.0)}, 100, seed)
        assert found.values["b"] == pytest.approx(1, abs=0.1)


LOAD, LOAD_TIME = -5.0, 0.1
HOLD = Duty("hold", "step:size=0", 0.6, plant={"load_force": LOAD, "load_time": LOAD_TIME})
PLAN = Plan(
    plant="plant_loaded",
    entrants=(Entrant("pid", "pid"), Entrant("lqi", "lqi")),
    duties=(Duty("move", "move:distance=0.01", 1.0, True), HOLD),
    variations=(Variation(("m", "payload"), (0.5, 1.5)),),
    instruments=("position_encoder", "velocity_estimate", "current_sensor"),
    plants=2,
)


@pytest.fixture(scope="module")
def contenders():
    return contenders_of(PLAN)


@pytest.fixture(scope="module")
def held(contenders):
    """The course of the duty, by the value of the load's force."""

    def run(force):
        duty = replace(HOLD, plant={**HOLD.plant, "load_force": force})
        given = {"Kp": 2000.0, "Ki": 2000.0, "Kd": 50.0}, duty, [1.0], 7
        pid = contenders["pid"]
        return pid.values(*given), pid.run(*given)[0]

    return {force: run(force) for force in (0.0, LOAD)}


@pytest.mark.ci
def test_a_load_of_a_duty_acts_from_its_time_on_and_not_before(held):
    (_, without), (_, loaded) = held[0.0], held[LOAD]
    before = loaded.time < LOAD_TIME
    np.testing.assert_allclose(loaded.position[before], without.position[before], atol=1e-12)
    apart = np.abs(loaded.position - without.position)
    assert apart[~before].max() > 1e-5


@pytest.mark.ci
def test_the_motor_ends_up_holding_the_load_but_for_friction(held):
    """At rest kt 2 pi p i + load is what friction holds, which is at most the breakaway force."""
    values, course = held[LOAD]
    force = 37.4e-3 * 2 * math.pi * 1000 * course.current[-50:].mean()
    assert abs(force + LOAD) < 2.5
    assert force > 1.0
    assert np.abs(course.velocity[-50:]).max() < 1e-3
    assert values["plant_load_force"] == LOAD


def test_a_factor_acts_on_the_value_of_the_duty_else_on_the_nominal_one(contenders):
    duty = replace(HOLD, plant={"payload": 2.0})
    values = contenders["pid"].values({}, duty, [1.25], 0)
    assert (values["plant_payload"], values["plant_m"]) == (2.5, 1.25)


def test_noise_is_that_of_the_plant_for_every_controller_and_another_on_another_plant(contenders):
    def seeds(name, draw):
        values = contenders[name].values({}, HOLD, [1.0], draw)
        return {n: v for n, v in values.items() if n.endswith("seed")}

    assert list(seeds("pid", 3)) == ["controller_current_sensor_seed"]
    assert seeds("pid", 3) == seeds("lqi", 3) != seeds("lqi", 4)


def limits(plant, **given):
    """Of the plant's command and of the controller, as a run gets them."""
    plan = replace(PLAN, plant=plant, variations=(), instruments=(), period=0.0, **given)
    loop = StudyLoop(loop_kernel(plant, "p_pi"))
    duty = replace(HOLD, plant={})
    values = Contender(plan, Entrant("p_pi", "p_pi"), loop).values({}, duty, [], 0)
    return values["plant_voltage_limit"], values["controller_u_max"]


def test_an_amplifier_has_its_volts_and_a_force_has_no_limit_but_the_one_that_is_given():
    assert limits("plant") == (36.0, 36.0)
    assert limits("drive") == (1e6, 1e6)
    assert limits("plant", command_limit=24.0) == (24.0, 24.0)
    assert limits("drive", command_limit=500.0) == (500.0, 500.0)
