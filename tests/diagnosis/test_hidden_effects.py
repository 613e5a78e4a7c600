"""The generator of hidden effects: its physics, and the signal-to-noise ratio that sizes them."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from hidden import cases as hidden_cases
from hidden.cases import OUTSIDE, SIZES, Plan, draw_case, write_case
from hidden.effects import (
    COUNT,
    CURRENT_NOISE,
    DURATION,
    NOMINAL,
    SAMPLE,
    SAMPLES,
    force_along,
    friction_noise,
    numbers,
    simulate,
)
from hidden.excitations import draw_excitation
from hidden.signal import BASE, ZERO_WITHOUT, Scale, Scene, noise_paths, spectrum, times
from hidden.trials import CAUSE, NONE, OUT, PAIR, plan_trials, score
from scipy.integrate import solve_ivp

QUIET = np.zeros(SAMPLES + 1)


def plan_of(effect: str, seed: int, with_current: bool) -> Plan:
    random = np.random.default_rng([seed, 5])
    shapes = {effect: hidden_cases._draw_shape(effect, random)} if effect != "none" else {}
    law = "classical" if effect == "presliding_hysteresis" else "modified_lugre"
    plan = Plan(tuple(shapes), draw_excitation(random), QUIET, with_current, law, shapes)
    if effect == "bursts":
        plan.bursts = hidden_cases._draw_bursts(random)
    hidden_cases._fit_to_travel(plan, hidden_cases._run(plan, {}))
    return plan


def imbalance(scene: Scene) -> np.ndarray:
    """What drives less what the nominal model makes of the motion, from the truth's own states."""
    m = scene.motion
    speed = (m.motor_speed[1:] + m.motor_speed[:-1]) / 2
    inductive = BASE["L"] * np.diff(m.current) / SAMPLE
    resistance = BASE["R"] * (1 + scene.values.get("R_drift", 0.0) * times() / DURATION)
    current = (m.applied - BASE["ke"] * speed - inductive) / resistance
    believed = force_along(
        {}, m.motor_position, m.motor_speed, m.way, rigid=scene.law == "classical"
    )
    believed += (BASE["m"] + BASE["rotor"]) * np.diff(m.motor_speed) / SAMPLE
    back = BASE["ke"] * speed + inductive
    if scene.with_current:
        voltage = m.command[:-1] - BASE["R"] * current - back
        return np.stack([BASE["kt"] * current - believed, voltage])
    return (BASE["kt"] * (m.command[:-1] - back) / BASE["R"] - believed)[None]


def test_the_truth_is_what_an_independent_solver_makes_of_the_equations():
    hidden = {"asymmetry": 0.1, "ripple": 0.3, "ripple_n": 2.0, "load": -0.2, "s3": 300.0}
    u = np.where(np.arange(401) < 200, 3.0, -2.0)
    motion = simulate(hidden, u, np.zeros(401))
    n = NOMINAL
    angle = 2 * math.pi * n["p"]

    def rates(_: float, y: np.ndarray, voltage: float) -> list[float]:
        x, v, z, i = y
        scale = 1 + 0.1 * np.sign(v)
        g = scale * (n["Fc"] + (n["Fs"] - n["Fc"]) * np.exp(-((v / n["Vs"]) ** 2)))
        dz = v - n["sigma0"] * abs(v) * z / g
        friction = n["sigma0"] * z + n["sigma1"] * dz + n["sigma2"] * scale * v
        other = 0.3 * np.cos(2 * angle * x) - 0.2 + 300.0 * v * abs(v)
        dv = (n["kt"] * angle * i - friction - other) / (n["m"] + n["Jm"] * angle**2)
        return [v, dv, dz, (voltage - n["R"] * i - n["ke"] * angle * v) / n["L"]]

    y = np.zeros(4)
    for k, voltage in ((0, 3.0), (200, -2.0)):
        span = (k * SAMPLE, (k + 200) * SAMPLE)
        at = np.arange(k, k + 201, 20) * SAMPLE
        solved = solve_ivp(
            rates, span, y, "Radau", t_eval=at, args=(voltage,), rtol=1e-8, atol=1e-13
        )
        places = np.arange(k, k + 201, 20)
        assert np.abs(motion.position[places] - solved.y[0]).max() < 1e-9
        assert np.abs(motion.speed[places] - solved.y[1]).max() < 1e-6
        y = solved.y[:, -1]


def test_a_spring_between_screw_and_block_is_what_an_independent_solver_makes_of_it():
    k, n = 1e5, NOMINAL
    motion = simulate({"stiffness": k}, np.full(101, 3.0), np.zeros(101))
    angle = 2 * math.pi * n["p"]

    def rates(_: float, y: np.ndarray) -> list[float]:
        xm, vm, xb, vb, z, i = y
        g = n["Fc"] + (n["Fs"] - n["Fc"]) * np.exp(-((vb / n["Vs"]) ** 2))
        dz = vb - n["sigma0"] * abs(vb) * z / g
        friction = n["sigma0"] * z + n["sigma1"] * dz + n["sigma2"] * vb
        spring = k * (xm - xb) + 0.2 * math.sqrt(k * n["m"]) * (vm - vb)
        dvm = (n["kt"] * angle * i - spring) / (n["Jm"] * angle**2)
        di = (3.0 - n["R"] * i - n["ke"] * angle * vm) / n["L"]
        return [vm, dvm, vb, (spring - friction) / n["m"], dz, di]

    solved = solve_ivp(rates, (0.0, 0.1), np.zeros(6), "Radau", rtol=1e-8, atol=1e-13)
    assert abs(motion.motor_position[100] - solved.y[0, -1]) < 1e-9
    assert abs(motion.position[100] - solved.y[2, -1]) < 1e-9
    assert abs(motion.motor_position[100] - motion.position[100]) > 1e-5


@pytest.mark.parametrize("names", [*ZERO_WITHOUT.values(), ("delay",), ("R_drift",), ("gap",)])
def test_an_effect_of_no_size_is_no_effect(names):
    u = np.where(np.arange(1001) % 400 < 200, 3.0, -2.0)
    bursts = np.array([[0.2, 0.6]])
    shape = {"periodic_phase": 1.0, "ripple_n": 2.0, "detent_place": 1e-3, "memory_length": 1e-3}
    bare = simulate({}, u, np.zeros(1001))
    none = simulate(shape | dict.fromkeys(names, 0.0), u, np.zeros(1001), bursts=bursts)
    assert np.array_equal(none.position, bare.position)
    some = simulate(shape | dict.fromkeys(names, 3e-4), u, np.zeros(1001), bursts=bursts)
    assert not np.array_equal(some.position, bare.position)


@pytest.mark.parametrize(
    "effect",
    ["load_bias", "input_delay", "backlash", "compliance", "resistance_drift", "friction_drift"],
)
def test_the_signal_of_an_effect_is_what_the_believed_model_leaves_of_the_truth(effect):
    plan = plan_of(effect, 1, with_current=effect in ("resistance_drift", "load_bias", "backlash"))
    sizes = {effect: 2 * SIZES[effect].start}
    scene = hidden_cases._run(plan, sizes)
    scale = Scale(scene)
    found = scale.white(hidden_cases._signals(plan, scene, sizes)[effect])
    bare = Scene(hidden_cases._run(plan, {}).motion, {}, plan.with_current, "modified_lugre")
    floor = np.linalg.norm(Scale(bare).white(imbalance(bare)))
    left = scale.white(imbalance(scene)) - found
    assert np.linalg.norm(found) > 2 * floor
    assert np.linalg.norm(left) < 1.1 * floor + 0.03 * np.linalg.norm(found)


def test_a_late_command_shows_in_samples_of_the_current_by_whole_samples_only():
    plan = plan_of("input_delay", 1, with_current=True)
    for delay in (3e-4, 2.3e-3):
        scene = hidden_cases._run(plan, {"input_delay": delay})
        m = scene.motion
        command = m.command[:-1]
        back = BASE["ke"] * m.motor_speed[1:]
        seen = command - BASE["R"] * m.current[1:] - back
        believed = scene.late(delay)[1]
        keep = scene.weight > 0.9
        assert np.std(command[keep]) > 0.1
        assert np.abs(seen - believed)[keep].max() < 0.02 * np.abs(command).max()
        assert np.any(believed) == (delay > SAMPLE)


@pytest.mark.parametrize("effect", ["load_bias", "position_trend_friction", "unmodelled_inertia"])
def test_the_ratio_grows_linearly_with_the_size(effect):
    plan = plan_of(effect, 2, with_current=False)
    ratios = []
    for size in (SIZES[effect].start, SIZES[effect].start / 2):
        sizes = {effect: size}
        scene = hidden_cases._run(plan, sizes)
        found = hidden_cases._signals(plan, scene, sizes)
        ratios.append(hidden_cases._ratios(scene, found)[effect])
    assert ratios[0] == pytest.approx(2 * ratios[1], rel=0.05)


@pytest.mark.parametrize("with_current", [False, True])
@pytest.mark.parametrize("effect", ["position_periodic_friction", "load_bias"])
def test_what_is_called_noise_has_the_spread_that_the_ratio_is_counted_in(effect, with_current):
    plan = plan_of(effect, 3, with_current)
    sizes = {effect: SIZES[effect].start}
    scene = hidden_cases._run(plan, sizes)
    scale = Scale(scene)
    template = scale.left(hidden_cases._signals(plan, scene, sizes)[effect])
    template /= np.linalg.norm(template)
    paths, random, seen = noise_paths(with_current), np.random.default_rng(7), []
    position = scene.motion.motor_position[:SAMPLES]
    for _ in range(200):
        shifted = position + random.uniform(0.0, COUNT)
        rounding = np.floor(shifted / COUNT) * COUNT - shifted
        current = CURRENT_NOISE * random.standard_normal(SAMPLES)
        noises = spectrum(np.stack([rounding, current, friction_noise(random, SAMPLES)]))
        seen.append(template @ scale.white_spectrum(np.einsum("fbj,jf->bf", paths, noises)))
    assert np.std(seen) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("effects", [("torque_ripple",), ("none",), ("bursts",)])
def test_a_case_holds_what_it_says(effects, tmp_path):
    case = draw_case(effects, 11)
    again = draw_case(effects, 11)
    assert all(np.array_equal(case.record[n], again.record[n]) for n in case.record)
    assert set(case.sizes) == set(effects) - {"none"}
    assert len(case.snr) == len(case.sizes)
    assert all(8 <= r <= 20 for r in case.snr)
    x = case.record["x"]
    assert len(x) == SAMPLES
    assert np.abs(x).max() < 0.3
    assert np.diff(x).max() > 0 > np.diff(x).min()
    assert np.abs(x / COUNT - np.round(x / COUNT)).max() < 1e-6
    files = write_case(case, tmp_path)
    columns = files.record.read_text().splitlines()[0].split(",")
    assert columns == list(case.record)
    read = np.loadtxt(files.record, delimiter=",", skiprows=1)
    assert np.abs(read[:, 2] - x).max() < 1e-9
    believed = tomllib.loads(files.parameters.read_text())
    assert believed["law"] == case.law
    assert believed["plant"] == case.believed
    written = files.record.read_text()[:200] + files.parameters.read_text()
    assert not any(name in written for name in [*SIZES, *OUTSIDE, "none"])


def test_two_effects_are_each_seen_beside_the_other():
    case = draw_case(("load_bias", "position_periodic_friction"), 3)
    assert len(case.snr) == 2
    assert all(8 <= r <= 20 for r in case.snr)


def test_half_of_the_cases_have_exact_beliefs_and_half_are_off_by_at_most_three_percent():
    cases = [draw_case(("none",), seed) for seed in range(12)]
    assert {c.exact for c in cases} == {True, False}
    assert {"i" in c.record for c in cases} == {True, False}
    for case in cases:
        off = {n: abs(v / NOMINAL[n] - 1) for n, v in case.believed.items()}
        assert max(off.values()) <= (0.0 if case.exact else 0.03)
        assert off["L"] == off["p"] == off["Kv"] == 0
    assert numbers({})[0] == NOMINAL["m"]


def test_answers_count_as_the_truth_says():
    case = draw_case(("none",), 0)
    assert score(NONE, case, "none", []) == (True, "name")
    assert score(NONE, case, "explained", ["backlash"]) == (False, "")
    bias = replace(case, effects=("load_bias",), same_force=frozenset({"direction_asymmetry"}))
    assert score(CAUSE, bias, "explained", ["load_bias", "backlash"]) == (True, "name")
    assert score(CAUSE, bias, "explained", ["backlash", "load_bias"]) == (False, "")
    assert score(CAUSE, bias, "explained", ["direction_asymmetry"]) == (True, "same_force")
    assert score(CAUSE, bias, "none", []) == (False, "")
    hidden = replace(bias, out_of_reach=True)
    assert score(CAUSE, hidden, "none", []) == (True, "out_of_reach")
    assert score(CAUSE, hidden, "explained", ["backlash"]) == (False, "")
    outside = replace(case, effects=("detent",))
    assert score(OUT, outside, "unexplained", []) == (True, "name")
    assert score(OUT, outside, "partly", ["backlash"]) == (False, "")
    pair = replace(case, effects=("load_bias", "backlash"))
    assert score(PAIR, pair, "explained", ["backlash", "load_bias"]) == (True, "name")
    assert score(PAIR, pair, "explained", ["backlash", "compliance"]) == (False, "")
    assert score(CAUSE, bias, "failed", []) == (False, "")


def test_the_proof_has_the_trials_that_are_asked_for():
    trials = plan_trials()
    sizes = {g: sum(t.group == g for t in trials) for g in (CAUSE, NONE, OUT, PAIR)}
    assert sizes == {CAUSE: 16 * 30, NONE: 300, OUT: 200, PAIR: 100}
    assert len({t.key for t in trials}) == len(trials)
    assert all(t.effects[0] != t.effects[1] for t in trials if t.group == PAIR)
