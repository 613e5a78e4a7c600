"""Our own estimator: its laws are the plant's, its intervals honest, and it says what it cannot."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp
from prescribed_motion import prescribed_friction
from scipy.integrate import solve_ivp
from synthetic.records import (
    constant_velocity,
    record_of,
    sine_velocity,
    slow_load,
    true_friction,
)
from synthetic.rigs import PRESCRIBED, identify_random_rig

from ballscrew.identification.fit import fit_along
from ballscrew.identification.fitted_law import LAWS
from ballscrew.identification.law_along_record import LawValues, friction_along, score
from ballscrew.identification.layout import lay_out
from ballscrew.identification.likelihood import Problem
from ballscrew.identification.optimizer import Climb
from ballscrew.plant.bliman_sorine import bliman_sorine
from ballscrew.plant.classical import classical
from ballscrew.plant.dahl import dahl
from ballscrew.plant.directional_lugre import directional_lugre
from ballscrew.plant.lugre import lugre
from ballscrew.plant.maxwell_slip import PARAMETERS as MAXWELL_SLIP
from ballscrew.plant.maxwell_slip import maxwell_slip
from ballscrew.plant.modified_lugre import modified_lugre
from ballscrew.solver.component import symbol

LUGRE = {
    "sigma0": 66967.231,
    "sigma1": 344.56,
    "sigma2": 173.0,
    "Fc": 1.284,
    "Fs": 2.35,
    "Vs": 1.13975e-3,
}
TRUTHS = {
    "lugre": LUGRE,
    "modified_lugre": LUGRE | {"Kv": 1e8},
    "dahl": {"sigma": 87750.0, "Fc": 2.0, "alpha": 1.4},
    "bliman_sorine": {"f1": 9.4, "f2": 7.3367, "eps_f": 1.88e-4, "eta": 0.7931},
    "directional_lugre": {f"{n}_pos": v for n, v in LUGRE.items()}
    | {f"{n}_neg": 0.8 * v for n, v in LUGRE.items()}
    | {"Kv": 1e8},
    "maxwell_slip": {p.name: p.default for p in MAXWELL_SLIP},
    "classical": {n: LUGRE[n] for n in ("sigma2", "Fc", "Fs", "Vs")},
}
PLANTS = {
    "lugre": lugre,
    "modified_lugre": modified_lugre,
    "dahl": dahl,
    "bliman_sorine": bliman_sorine,
    "directional_lugre": directional_lugre,
    "maxwell_slip": maxwell_slip,
    "classical": classical,
}


def plant_friction(name, velocity, times):
    """Friction of the plant's own equations along a velocity, by scipy's Radau.

    Maxwell slip's memory changes within a nanometre: the project's own solver takes that one.
    """
    if name == "maxwell_slip":
        return prescribed_friction(name, times, [velocity(t) for t in times]).outputs["friction"]
    v = symbol("v")
    term = PLANTS[name](v)
    states = [symbol(s.name) for s in term.states]
    known = {symbol(k): value for k, value in TRUTHS[name].items()}
    if name == "directional_lugre":
        known |= {symbol("Kv_pos"): 1e8, symbol("Kv_neg"): 1e8}
    rates = sp.lambdify([v, *states], [s.derivative.subs(known) for s in term.states])
    output = next(o for o in term.outputs if o.name == "friction").value.subs(known)
    force = sp.lambdify([v, *states], output)
    if not states:
        return np.array([force(velocity(t)) for t in times])
    solution = solve_ivp(
        lambda t, y: rates(velocity(t), *y),
        (0, times[-1]),
        np.zeros(len(states)),
        method="Radau",
        t_eval=times,
        rtol=1e-9,
        atol=1e-13,
        max_step=2e-3,
    )
    return np.array([force(velocity(t), *y) for t, y in zip(times, solution.y.T, strict=True)])


def along(name, x, v, h):
    names = LAWS[name].parameters
    truth = TRUTHS[name]
    one, other = (
        np.array([truth.get(f"{n}_{side}", truth.get(n, 0.0)) for n in names])
        for side in ("pos", "neg")
    )
    law = LawValues(name, one, other)
    return friction_along(law, x, v, np.array([h]), np.array([0, len(x)]), np.zeros(1), np.zeros(1))


@pytest.mark.parametrize("name", list(LAWS))
def test_laws_along_a_record_are_the_plant_s_equations(name):
    """There and back twice, with presliding, break-away and reversals; better at half the step."""
    amplitude, omega = 1.5e-3, 4.0
    errors = []
    for h in (1e-3, 5e-4):
        times = h * np.arange(round(3.0 / h))
        x = amplitude / omega * (1 - np.cos(omega * times))
        v = amplitude * np.sin(omega * times)
        reference = plant_friction(name, lambda t: amplitude * math.sin(omega * t), times)
        # a step that straddles a reversal cannot know where within it that was
        away = np.abs(v) > 2 * amplitude * omega * h
        errors.append(float(np.abs(along(name, x, v, h) - reference)[away].max()))
    assert errors[0] < 5e-3
    assert errors[1] < max(0.6 * errors[0], 1e-12)  # the classical law is exact: it has no state


@pytest.mark.parametrize("name", PRESCRIBED)
def test_synthetic_records_follow_the_plant_s_equations_too(name):
    amplitude, omega, h = 1e-3, 2.0, 2.5e-4
    times = h * np.arange(round(2.0 / h))
    x = amplitude / omega * (1 - np.cos(omega * times))
    reference = plant_friction(name, lambda t: amplitude * math.sin(omega * t), times)
    made = true_friction(name, x, h, TRUTHS[name])
    assert np.abs(made - reference).max() < 2e-3


def test_likelihood_of_rounded_samples_is_that_of_their_counts():
    random = np.random.default_rng(0)
    count = 0.089
    force = np.round(random.normal(1.5, 0.1, 300) / count) * count
    predicted = np.full(300, 1.52)

    def cost(shift, spread):
        gradient, information = np.empty((2, 300)), np.empty((3, 300))
        value = score(
            force, predicted + shift, np.full(300, spread), count, gradient, information, False
        )
        return value, gradient, information

    for spread in (0.012, 0.03, 0.1, 0.29, 0.31):
        _, gradient, _ = cost(0.0, spread)
        slope = (cost(1e-6, spread)[0] - cost(-1e-6, spread)[0]) / 2e-6
        assert -gradient[0].sum() == pytest.approx(slope, rel=1e-4, abs=1e-3)
        widening = (cost(0, spread + 1e-7)[0] - cost(0, spread - 1e-7)[0]) / 2e-7
        assert -gradient[1].sum() == pytest.approx(widening, rel=1e-3, abs=1e-2)


def test_expected_information_is_the_variance_of_the_score():
    random = np.random.default_rng(1)
    count, spread, level = 0.089, 0.025, 1.50
    n = 200_000
    force = np.round((level + spread * random.standard_normal(n)) / count) * count
    gradient, information = np.empty((2, n)), np.empty((3, n))
    score(force, np.full(n, level), np.full(n, spread), count, gradient, information, False)
    covariance = np.cov(gradient)
    assert information[0].mean() == pytest.approx(covariance[0, 0], rel=0.03)
    assert information[1].mean() == pytest.approx(covariance[0, 1], rel=0.05)
    assert information[2].mean() == pytest.approx(covariance[1, 1], rel=0.03)


@pytest.mark.long
def test_intervals_hold_the_truth_on_random_rigs():
    """A sample of what ``proofs/identification.py`` counts on a hundred rigs a law."""
    laws = ("modified_lugre", "dahl", "bliman_sorine", "directional_lugre")
    outcomes = [o for law in laws for o in identify_random_rig(law, 900)]
    missed = [o for o in outcomes if not o.covered]
    # 5 % of 25 are 1.3; those of one rig miss together
    assert len(missed) <= 3, missed
    assert sum(o.identified for o in outcomes) > 0.7 * len(outcomes)


def test_eq_2_14_is_biased_where_our_estimator_is_not():
    random = np.random.default_rng(4)
    trials = [slow_load(s * x) for s in (1, -1) for x in (8.4e-6, 1.95e-5, 3.57e-5)]
    trials += [sine_velocity(s * 1e-3, 0.5, 6.3) for s in (1, -1)]
    trials += [constant_velocity(v) for v in (1e-3, 2e-3, 4e-3, 6e-3)]
    records = [record_of(t, "lugre", LUGRE, random) for t in trials]
    from ballscrew.identification.identify import identify

    result = identify(records, "lugre")
    truth = LUGRE["sigma0"]
    rows = result.thesis["sigma0_eq_2_14"]["trials"]
    assert sorted({round(abs(r["force"]) * 2) / 2 for r in rows}) == [0.5, 1.0, 1.5]
    for row in rows:
        printed = {0.5: 59.0e3, 1.0: 51.1e3, 1.5: 41.8e3}[round(abs(row["force"]) * 2) / 2]
        # each trial's fine sensor is off by a percent or two of its scale
        assert row["sigma0"] == pytest.approx(printed, rel=0.06)
        assert row["sigma0"] < 0.95 * truth
    found = result.parameters["sigma0"]
    assert abs(found.value - truth) < 3 * found.standard_error
    assert found.low > max(r["sigma0"] for r in rows)
    assert "assumed" in result.thesis["sigma1_eq_2_17"]["note"]


@pytest.fixture(scope="module")
def thesis_trials():
    """Constant velocities and force steps, as the thesis identified LuGre; Table 2.3's truth."""
    random = np.random.default_rng(3)
    truth = {
        "sigma0": 66967.231,
        "sigma1": 344.56,
    }
    sides = {
        "pos": {"Fc": 1.11, "Fs": 2.3, "Vs": 1.943e-3, "sigma2": 193.4},
        "neg": {"Fc": 1.458, "Fs": 2.4, "Vs": 3.365e-4, "sigma2": 152.6},
    }
    truth = {f"{n}_{s}": v for s, own in sides.items() for n, v in (truth | own).items()}
    speeds = np.arange(2e-3, 5.6e-3, 0.5e-3)
    trials = [constant_velocity(s * v, 4.0) for s in (1, -1) for v in speeds]
    trials += [slow_load(x) for x in (8e-6, 8e-6, 17e-6, 17e-6, 35e-6, 35e-6, -35e-6, -6e-5, 6e-5)]
    return truth, [record_of(t, "directional_lugre", truth, random, 1e-3) for t in trials]


def test_what_the_thesis_trials_cannot_tell_is_said_with_a_trial_that_would_do(thesis_trials):
    from ballscrew.identification.identify import identify

    truth, records = thesis_trials
    result = identify(records, "directional_lugre")
    assert not result.trusted
    open_ones = {n for n, i in result.parameters.items() if not i.identified}
    assert open_ones == {"sigma1_pos", "sigma1_neg", "Vs_neg"}
    assert "delay between force and motion" in result.parameters["sigma1_pos"].because
    assert "2 kHz" in result.parameters["sigma1_pos"].would_do
    assert "0.002 m/s" in result.parameters["Vs_neg"].because
    assert "would be enough" in result.parameters["Vs_neg"].would_do
    for name, i in result.parameters.items():
        assert (i.low or 0.0) <= truth[name] <= (i.high or math.inf), name
    file = result.parameter_file()
    assert "sigma1_pos" not in file.plant
    assert "delay between force and motion" in file.not_identified["sigma1_pos"]
    assert file.plant["Fc_neg"].value == result.parameters["Fc_neg"].value


def test_the_trials_that_would_do_do(thesis_trials):
    truth, records = thesis_trials
    random = np.random.default_rng(8)
    more = [sine_velocity(s * 1e-3, 1 / 6, 18.0) for s in (1, -1)]
    shaken = sine_velocity(5e-4, 20 * math.pi, 5.0)
    shaken = type(shaken)(shaken.name, shaken.duration, shaken.position, step=5e-4, fine=True)
    new = [record_of(t, "directional_lugre", truth, random, 1e-3) for t in more]
    new.append(record_of(shaken, "directional_lugre", truth, random, 1e-4))
    fit = fit_along([*records, *new], "directional_lugre")
    for name in ("Vs_neg", "sigma1_pos", "sigma1_neg"):
        i = fit.intervals[name]
        assert i.identified, name
        assert i.low <= truth[name] <= i.high, name


def test_no_static_peak_is_claimed_where_friction_does_not_fall():
    """Dahl's friction breaks away without a peak: the Stribeck curve found does not rise."""
    random = np.random.default_rng(0)
    truth = {"sigma": 8e4, "Fc": 1.9, "alpha": 1.0}
    trials = [sine_velocity(s * 3e-3, 1.0, 6.28) for s in (1, -1)]
    fit = fit_along([record_of(t, "dahl", truth, random) for t in trials], "lugre")
    assert fit.values["Fs"] > 0.98 * fit.values["Fc"]
    for name in ("Fs", "Vs"):
        i = fit.intervals[name]
        narrow = i.identified and i.value > 1.02 * fit.values["Fc"]
        assert not narrow, name


def test_break_away_is_not_guessed_from_below_it():
    random = np.random.default_rng(0)
    truth = {"sigma": 8e4, "Fc": 2.4, "alpha": 1.3}
    trials = [slow_load(s * x) for s in (1, -1) for x in (5e-6, 8e-6, 1.2e-5)]
    fit = fit_along([record_of(t, "dahl", truth, random) for t in trials], "dahl")
    for i in fit.intervals.values():
        assert (i.identified, i.low, i.high) == (False, None, None)
        assert "break-away" in i.method


def test_one_speed_does_not_tell_the_parts_of_a_stribeck_curve():
    random = np.random.default_rng(0)
    one = [constant_velocity(s * 3e-3, 4.0) for s in (1, -1)]
    more = [constant_velocity(s * v, 4.0) for s in (1, -1) for v in (1e-3, 2e-3, 5e-3)]
    few = [record_of(t, "lugre", LUGRE, random) for t in one]
    many = few + [record_of(t, "lugre", LUGRE, random) for t in more]
    fit = fit_along(few, "lugre")
    for name in ("Fc", "Vs", "sigma2"):
        assert (fit.intervals[name].low, fit.intervals[name].high) == (None, None), name
    fit = fit_along(many, "lugre")
    for name in ("Fc", "sigma2"):
        assert fit.intervals[name].identified, name


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_stiffness_is_as_doubtful_as_its_way_is_in_counts(factor):
    """More samples or records do not make a sixth of a count smaller, nor a stiff contact's way."""
    random = np.random.default_rng(0)
    truth = LUGRE | {"sigma0": factor * LUGRE["sigma0"]}
    trials = [sine_velocity(s * 1e-3, 0.5, 6.3) for s in (1, -1)]
    fit = fit_along([record_of(t, "lugre", truth, random) for t in trials], "lugre")
    found = fit.intervals["sigma0"]
    assert found.low <= truth["sigma0"] <= found.high
    count, way = 1e-3 / 512, truth["Fs"] / truth["sigma0"]
    assert found.standard_error / found.value > 0.95 * count / 6 / way


def test_fs_below_fc_is_pulled_back_as_its_slope_says():
    random = np.random.default_rng(0)
    course = lay_out([record_of(sine_velocity(1e-3, 0.5, 6.3), "lugre", LUGRE, random)])
    law = LAWS["lugre"]
    off = LUGRE | {"Fs": 0.95 * LUGRE["Fc"]}
    guess = law.coordinates_of(np.array([off[n] for n in law.parameters]))
    climb = Climb(Problem(course, law, True), guess)
    pulled = climb.normal(climb.point).slope - np.concatenate(
        [climb.normal(climb.point).columns @ climb.problem.gradient[0], np.zeros(5)]
    )
    for j in (law.parameters.index(n) for n in ("Fc", "Fs")):
        step = np.zeros(len(climb.prior_std))
        step[j] = 1e-5
        rise = climb.prior(climb.point.moved(step)) - climb.prior(climb.point.moved(-step))
        assert pulled[j] == pytest.approx(-rise / 2e-5, rel=1e-6)
        assert pulled[j] != 0


def test_a_law_that_does_not_fit_is_not_believed():
    from ballscrew.identification.identify import identify

    random = np.random.default_rng(0)
    trials = [sine_velocity(s * 4e-3, 1.0, 9.0) for s in (1, -1)]
    records = [record_of(t, "lugre", LUGRE, random) for t in trials]
    result = identify(records, "dahl")
    assert any("unexplained" in warning for warning in result.warnings)


def test_directions_that_differ_are_noticed():
    from ballscrew.identification.identify import identify

    random = np.random.default_rng(0)
    truth = {"sigma_pos": 8e4, "Fc_pos": 1.9, "alpha_pos": 1.0}
    truth |= {"sigma_neg": 9e4, "Fc_neg": 2.1, "alpha_neg": 1.0}
    trials = [sine_velocity(s * 1e-3, 1.0, 3.14) for s in (1, -1)]
    records = [record_of(t, "dahl", truth, random) for t in trials]
    result = identify(records, "dahl")
    assert any("directions differ" in note for note in result.notes)
    assert result.per_direction["forwards"]["Fc"].value == pytest.approx(1.9, abs=0.01)
    assert result.per_direction["backwards"]["Fc"].value == pytest.approx(2.1, abs=0.01)
    assert result.per_direction["averaged"]["Fc"].value == pytest.approx(2.0, abs=0.01)


def test_truth_is_nearly_the_most_likely_point_without_noise():
    """Guards the whole chain: layout, law, delay, likelihood agree on clean records."""
    random = np.random.default_rng(0)
    trials = [sine_velocity(1e-3, 0.5, 6.0), slow_load(1.5e-5)]
    records = [record_of(t, "lugre", LUGRE, random, noise=0.02) for t in trials]
    course = lay_out(records)
    law = LAWS["lugre"]
    truth = np.array([LUGRE[n] for n in law.parameters])
    climb = Climb(Problem(course, law, True), law.coordinates_of(truth))
    residual = course.force - climb.force(climb.point)
    assert residual.std() < 1.1 * math.hypot(0.02, 0.089 / math.sqrt(12))
