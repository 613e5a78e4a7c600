"""Tuning on costs whose minima are known; what runs get: a duty's and a drawn plant, noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.orchestration.study.plan import Duty, Entrant, Plan, Variation
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
    assert found.at_bound == ()


def test_exactly_the_budget_decides_and_twice_as_many_are_tried():
    asked = []

    def cost(values) -> float:
        asked.append(dict(values))
        return bowl(values)

    found = tune(cost, PUBLISHED, RANGES, 17, 3)
    assert len(asked) == found.tried == 34
    assert asked[0] == PUBLISHED
    assert all(v["c"] == 7.0 for v in asked)
    assert found.cost == min(map(bowl, asked[:17]))
    assert found.doubled_cost == min(map(bowl, asked))
    assert found == tune(bowl, PUBLISHED, RANGES, 17, 3)
    assert found.values != tune(bowl, PUBLISHED, RANGES, 17, 2).values


def test_every_candidate_is_within_its_range_and_an_end_is_told():
    asked = []

    def cost(values) -> float:
        asked.append(values["b"])
        return -values["b"] + abs(math.log(values["a"]))

    found = tune(cost, PUBLISHED, RANGES, 150, 1)
    assert all(-5 <= b <= 5 for b in asked)
    assert found.at_bound == ("b",)


def test_one_parameter_alone_can_be_tuned():
    for seed in range(5):
        found = tune(lambda v: (v["b"] - 1) ** 2, PUBLISHED, {"b": (-5.0, 5.0)}, 100, seed)
        assert found.values["b"] == pytest.approx(1, abs=0.1)


LOAD, LOAD_TIME = -5.0, 0.1
HOLD = Duty("hold", "step:size=0", 0.6, plant={"load_force": LOAD, "load_time": LOAD_TIME})
WARM = {"Fc": -0.01, "R": 0.00393}
PLAN = Plan(
    plant="plant_loaded",
    entrants=(Entrant("pid", "pid"), Entrant("lqi", "lqi")),
    duties=(Duty("move", "move:distance=0.01", 1.0, True), HOLD),
    variations=(
        Variation(("m", "payload"), (0.5, 1.5)),
        Variation(("Fc",), (0.7, 1.3)),
        Variation(tuple(WARM), (0.0, 40.0), "temperature", WARM),
    ),
    instruments=("position_encoder", "velocity_estimate", "current_sensor"),
    plants=2,
)
NOMINAL = [1.0, 1.0, 0.0]


@pytest.fixture(scope="module")
def contenders():
    return {e.name: Contender.of(PLAN, e) for e in PLAN.entrants}


@pytest.mark.ci
def test_a_load_of_a_duty_acts_from_its_time_on_and_the_motor_ends_up_holding_it(contenders):
    """At rest kt 2 pi p i + load is what friction holds, which is at most the breakaway force."""
    gains = {"Kp": 2000.0, "Ki": 2000.0, "Kd": 50.0}
    duties = [replace(HOLD, plant={**HOLD.plant, "load_force": force}) for force in (0.0, LOAD)]
    without, loaded = (contenders["pid"].run(gains, duty, NOMINAL, 7)[0] for duty in duties)
    before = loaded.time < LOAD_TIME
    np.testing.assert_allclose(loaded.position[before], without.position[before], atol=1e-12)
    assert np.abs(loaded.position - without.position)[~before].max() > 1e-5
    force = 37.4e-3 * 2 * math.pi * 1000 * loaded.current[-50:].mean()
    assert abs(force + LOAD) < 2.5
    assert force > 1.0
    assert np.abs(loaded.velocity[-50:]).max() < 1e-3


def test_factors_act_on_the_value_of_the_duty_else_on_the_nominal_one(contenders):
    """A temperature changes parameters by their coefficients, beside other factors."""
    duty = replace(HOLD, plant={"payload": 2.0})
    pid = contenders["pid"]
    values = pid.values({}, duty, [1.25, 1.2, 20.0], 0)
    assert (values["plant_payload"], values["plant_m"]) == (2.5, 1.25)
    nominal = {p.name: p.default for p in pid.loop.parameters}
    assert values["plant_Fc"] == pytest.approx(nominal["plant_Fc"] * 1.2 * 0.8, rel=1e-14)
    assert values["plant_R"] == pytest.approx(nominal["plant_R"] * 1.0786, rel=1e-14)


def test_noise_is_that_of_the_plant_for_every_controller_and_another_on_another_plant(contenders):
    def seeds(name, draw):
        values = contenders[name].values({}, HOLD, NOMINAL, draw)
        return {n: v for n, v in values.items() if n.endswith("seed")}

    assert list(seeds("pid", 3)) == ["controller_current_sensor_seed"]
    assert seeds("pid", 3) == seeds("lqi", 3) != seeds("lqi", 4)


@pytest.mark.parametrize(
    ("plant", "given", "limit"),
    [("plant", None, 36.0), ("drive", None, 1e6), ("plant", 24.0, 24.0), ("drive", 500.0, 500.0)],
)
def test_an_amplifier_has_its_volts_and_a_force_only_the_limit_that_is_given(plant, given, limit):
    """Of the plant's command and of the controller, as a run gets them."""
    plan = Plan(plant, (Entrant("p_pi", "p_pi"),), PLAN.duties, period=0.0, command_limit=given)
    values = Contender.of(plan, plan.entrants[0]).values({}, PLAN.duties[0], [], 0)
    assert (values["plant_voltage_limit"], values["controller_u_max"]) == (limit, limit)
