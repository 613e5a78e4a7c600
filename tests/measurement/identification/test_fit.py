"""Our own estimator: its laws are the plant's, its intervals honest, and it says what it cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from case_inputs import strokes
from identification.intervals import trial
from identification.records import Trial, constant_velocity, record_of, sine_velocity, slow_load
from prescribed_motion import prescribed_friction

from ballscrew.measurement.identification.fit import fit_along
from ballscrew.measurement.identification.fitted_law import assumed_damping, fitted_law
from ballscrew.measurement.identification.identify import identify
from ballscrew.measurement.identification.law_along_record import (
    LawValues,
    delayed,
    friction_along,
    score,
)
from ballscrew.measurement.identification.laws_in_c import HEADER, header
from ballscrew.measurement.identification.layout import lay_out
from ballscrew.plant.maxwell_slip import PARAMETERS as MAXWELL_SLIP

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
TRUTHS["directional_classical"] = {
    f"{n}_{side}": factor * v
    for side, factor in (("pos", 1.0), ("neg", 1.15))
    for n, v in TRUTHS["classical"].items()
}


def along(name, x, v, h):
    names = fitted_law(name).parameters
    truth = TRUTHS[name]
    one, other = (
        np.array([truth.get(f"{n}_{side}", truth.get(n, 0.0)) for n in names])
        for side in ("pos", "neg")
    )
    law = LawValues(name, one, other)
    return friction_along(law, x, v, np.array([h]), np.array([0, len(x)]), np.zeros((5, 1)))


@pytest.mark.parametrize(
    "name", ["lugre", *(pytest.param(n, marks=pytest.mark.ci) for n in TRUTHS if n != "lugre")]
)
def test_laws_along_a_record_are_the_plant_s_equations(name):
    """There and back twice, with presliding, break-away and reversals; better at half the step.

    LuGre's sigma1 is 2 sqrt(sigma0 m) - sigma2, Eq. 2.17 of the thesis.
    """
    assert assumed_damping(LUGRE["sigma0"], LUGRE["sigma2"]) == pytest.approx(LUGRE["sigma1"], 2e-5)
    amplitude, omega = 1.5e-3, 4.0
    truth = {n: value for n, value in TRUTHS[name].items() if n != "Kv"}
    errors = []
    for h in (1e-3, 5e-4):
        times = h * np.arange(round(3.0 / h))
        x = amplitude / omega * (1 - np.cos(omega * times))
        v = amplitude * np.sin(omega * times)
        reference = prescribed_friction(name, times, v, truth).outputs["friction"]
        # a step that straddles a reversal cannot know where within it that was
        away = np.abs(v) > 2 * amplitude * omega * h
        errors.append(float(np.abs(along(name, x, v, h) - reference)[away].max()))
    assert errors[0] < 5e-3
    assert errors[1] < max(0.6 * errors[0], 1e-12)  # the classical law is exact: it has no state


def test_the_laws_in_c_are_made_from_the_plant_s_equations_as_they_are():
    again = "make it anew: python -m ballscrew.measurement.identification.laws_in_c"
    assert HEADER.read_text(encoding="utf-8") == header(), again


def test_a_gain_and_a_vibration_change_the_motion_and_a_delay_the_force():
    """Of a linear spring, before it yields, and of a sine."""
    law = LawValues("dahl", np.array([1e3, 1e3, 1.0]), np.array([1e3, 1e3, 1.0]))
    x, v = 1e-3 * np.arange(200.0), np.ones(200)
    starts, step = np.array([0, 200]), np.array([1e-3])
    own = np.array([[2e-4], [0.1], [0.01], [0.2], [0.0]])
    moved = 0.1 + (x - 0.1) * (1.01 + 0.2 * (x - 0.1))
    expected = 1e3 * (1 - np.exp(-(moved - moved[0] + 2e-4)))  # dF/dx = sigma (1 - F/Fc)
    found = friction_along(law, x, v, step, starts, own)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    own[4] = 1.0  # of a millimetre in each step
    worn = 1e3 - (1e3 - found[0] * np.exp(-1e-3)) * np.exp(moved[0] - moved[1])
    assert friction_along(law, x, v, step, starts, own)[1] == pytest.approx(worn)
    t = np.arange(200.0)
    force = np.tile(np.sin(0.05 * t), (2, 1))
    late = delayed(force.ravel(), np.array([0, 200, 400]), np.array([0.7, -1.3]))
    expected = np.sin(0.05 * np.stack([t - 0.7, t + 1.3]))
    np.testing.assert_allclose(late.reshape(2, 200)[:, 40:-40], expected[:, 40:-40], atol=3e-4)


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


@pytest.mark.ci
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


STROKES = ((4e-4, 0.5, 2), (4e-3, 0.5, 2), (0.03, 0.5, 2), (0.06, 1, 2), (0.08, 1.5, 2))


@pytest.mark.ci
def test_the_minimum_found_is_the_global_one():
    """Strokes of 0.4 to 80 mm: other minima have a Coulomb friction that is twice the true one."""
    truth = {"sigma0": 631268.6, "sigma1": 1282.0, "sigma2": 60.749}
    truth |= {"Fc": 13.8147, "Fs": 20.2917, "Vs": 0.01143}
    trial = Trial("strokes", 10.0, lambda t: strokes(t, *STROKES)[0], step=2e-3)
    for seed in (10, 11):
        random = np.random.default_rng(seed)
        record = record_of(trial, "lugre", truth, random, noise=0.11, mass=6.07393)
        record = replace(record, mass=1.0, signals=record.signals | {"force": record.force - 0.889})
        fit = fit_along([record], "lugre", beside=("m", "offset"))
        for name, value in (truth | {"m": 6.07393, "offset": -0.889}).items():
            interval = fit.intervals[name]
            assert interval.low <= value <= interval.high, (name, interval)
            assert interval.identified or name == "sigma1"


@pytest.mark.ci
@pytest.mark.parametrize(("law", "seed"), [("classical", 1), ("classical", 28), ("lugre", 4)])
def test_trials_of_the_rig_give_no_friction_that_is_far_off(law, seed):
    """At speeds below that at which friction falls, Fc was up to 80 half intervals off."""
    for row in trial("closed_loop", law, seed):
        width = np.inf if row["low"] is None else row["high"] - row["low"]
        assert abs(row["value"] - row["truth"]) < width, row


@pytest.mark.ci
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


@pytest.mark.ci
def test_break_away_is_not_guessed_from_below_it():
    random = np.random.default_rng(0)
    truth = {"sigma": 8e4, "Fc": 2.4, "alpha": 1.3}
    trials = [slow_load(s * x) for s in (1, -1) for x in (5e-6, 8e-6, 1.2e-5)]
    fit = fit_along([record_of(t, "dahl", truth, random) for t in trials], "dahl")
    for i in fit.intervals.values():
        assert (i.identified, i.low, i.high) == (False, None, None)
        assert "break-away" in i.method


def test_a_record_of_one_count_of_motion_does_not_shift_what_the_others_show():
    """It is smoothed for longer than it lasts."""
    random = np.random.default_rng(0)
    records = [record_of(constant_velocity(2e-3), "lugre", LUGRE, random) for _ in range(2)]
    pushed = record_of(slow_load(1e-6, duration=0.5), "lugre", LUGRE, random)
    at = np.repeat([0.0, 1e-9], 50)
    pushed = replace(pushed, signals=dict(pushed.signals) | {"x_fine": at})
    alone, beside = lay_out(records), lay_out([pushed, *records])
    assert np.array_equal(beside.still[100:], alone.still)


@pytest.mark.ci
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


@pytest.mark.parametrize("mass", [1.0, 0.0])  # none: the force is that of friction alone
def test_directions_that_differ_are_noticed(mass):
    random = np.random.default_rng(0)
    truth = {"sigma_pos": 8e4, "Fc_pos": 1.9, "alpha_pos": 1.0}
    truth |= {"sigma_neg": 9e4, "Fc_neg": 2.1, "alpha_neg": 1.0}
    trials = [sine_velocity(s * 1e-3, 1.0, 3.14) for s in (1, -1)]
    records = [record_of(t, "dahl", truth, random, mass=mass) for t in trials]
    said: list[str] = []
    result = identify(records, "dahl", progress=said.append)
    assert [text for text in said if ": fit " in text][-1] == "fitting dahl: fit 3 of 3"
    assert result.time_shift.low < 0.0 < result.time_shift.high
    assert any("directions differ" in note for note in result.notes)
    assert result.per_direction["forwards"]["Fc"].value == pytest.approx(1.9, abs=0.01)
    assert result.per_direction["backwards"]["Fc"].value == pytest.approx(2.1, abs=0.01)


@pytest.mark.ci
def test_the_fit_on_held_out_data_is_that_of_fits_without_each_record():
    """Each record is one piece; what is not fitted to it is the law alone."""
    random = np.random.default_rng(4)
    trials = [sine_velocity(s * v, 4.0, 0.95) for s in (1, -1) for v in (5e-4, 1e-3, 2e-3)]
    records = [record_of(t, "dahl", TRUTHS["dahl"], random, noise=0.1) for t in trials]
    left = []
    for k, record in enumerate(records):
        values = fit_along([*records[:k], *records[k + 1 :]], "dahl").values
        own = np.array([values[n] for n in fitted_law("dahl").parameters])
        course = lay_out([record])
        motion = course.x, course.v, course.step, course.starts, np.zeros((5, 1))
        friction = friction_along(LawValues("dahl", own, own), *motion)
        left.append(record.force - course.inertial - friction)
    force, fit = np.concatenate([r.force for r in records]), fit_along(records, "dahl")
    expected = 1 - np.sqrt(np.mean(np.concatenate(left) ** 2)) / force.std()
    assert fit.share(force) == pytest.approx(expected, abs=2e-3)
    assert fit.share(force) < 1 - np.sqrt(np.mean((force - fit.predicted) ** 2)) / force.std()


@pytest.mark.ci
def test_why_a_parameter_is_not_known_is_computed():
    """Bristles that are fast beside the samples: another delay does what another sigma1 does."""
    random = np.random.default_rng(0)
    trials = [sine_velocity(s * 3e-3, 1.0, 6.28) for s in (1, -1)]
    records = [record_of(t, "lugre", LUGRE, random) for t in trials]
    sigma1 = identify(records, "lugre").parameters["sigma1"]
    assert "2 kHz" in sigma1.would_do
    assert "it and the delay between force and motion are only known together" in sigma1.because
    one_way = record_of(sine_velocity(3e-3, 1.0, 3.1), "lugre", LUGRE, random)
    forwards = identify([one_way], "directional_lugre").parameters
    assert forwards["sigma1_neg"].because == "there is no motion backwards"
    assert "motion forwards" not in forwards["sigma1_pos"].because
