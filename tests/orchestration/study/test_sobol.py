"""Sobol indices and regression coefficients against exact ones, and those of a small study."""

import json
import math

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.study.statistics import sensitivity, sobol_indices, sobol_shares

STUDY = """version = 1
plants = 2
period = 0
[controllers.pid]
tune = {}
[[vary]]
parameters = ["Fc", "Fs"]
uniform = [0.7, 1.3]
[[vary]]
parameters = ["Jm"]
uniform = [0.5, 1.5]
[[duty]]
name = "there"
reference = "step:size=1e-3"
stop = 0.1
tune = true
[[duty]]
name = "back"
reference = "step:size=-1e-3"
stop = 0.1
[tuning]
budget = 1
seeds = 1
[sensitivity]
sobol = 64
"""


@pytest.mark.ci
def test_the_indices_of_ishigami_are_the_exact_ones():
    """sin x1 + 7 sin^2 x2 + x3^4 sin(x1) / 10; T. Ishigami and T. Homma (1990), whose variance
    comes apart into integrals of powers of x and of sin x."""
    a, b, pi = 7.0, 0.1, math.pi
    x = pi * (2 * sobol_shares(4096, 3, 1).T - 1)
    y = np.sin(x[0]) + a * np.sin(x[1]) ** 2 + b * x[2] ** 4 * np.sin(x[0])
    first = 0.5 * (1 + b * pi**4 / 5) ** 2
    second = a**2 / 8
    both = b**2 * pi**8 * (1 / 18 - 1 / 50)
    whole = first + second + both
    found = sobol_indices(np.exp(y), ["1", "2", "3"], 1)
    exact = {"1": (first, first + both), "2": (second, second), "3": (0.0, both)}
    for name, (alone, total) in exact.items():
        assert found[name].first == pytest.approx(alone / whole, abs=0.02)
        assert found[name].total == pytest.approx(total / whole, abs=0.02)


@pytest.mark.ci
def test_the_indices_of_a_linear_law_are_its_squared_coefficients_within_the_intervals():
    coefficients = np.array([3.0, 4.0, 0.0])
    names = ["a", "b", "c"]
    held = []
    for seed in range(20):
        shares = sobol_shares(128, 3, seed)
        found = sobol_indices(np.exp(shares @ coefficients), names, seed)
        for name, exact in zip(names, coefficients**2 / 25, strict=True):
            index = found[name]
            held += [abs(index.first - exact) <= index.first_within + 1e-9]
            held += [abs(index.total - exact) <= index.total_within + 1e-9]
    assert np.mean(held) >= 0.85  # 90 % is what they say; the points are better than random ones


@pytest.mark.ci
def test_a_failed_run_leaves_no_indices_and_an_error_that_stays_none_above_zero():
    assert sobol_indices(np.array([1.0, np.nan, 2.0]), ["a"], 1) == {}
    steady = sobol_indices(np.ones(6), ["a"], 1)
    assert (steady["a"].first, steady["a"].total) == (0.0, 0.0)


@pytest.mark.ci
def test_a_study_says_what_matters_and_what_does_not(tmp_path):
    """A rotor inertia of zero stays zero, whatever its factor."""
    study, out = tmp_path / "study.toml", tmp_path / "out"
    study.write_text(STUDY)
    assert main(["study", str(study), "--workers", "1", "--out", str(out)]) == 0
    told = json.loads((out / "study.json").read_text())["sobol"]["pid"]["back"]
    assert told["factor_Jm"]["total"] == pytest.approx(0.0, abs=1e-9)
    assert told["factor_Fc_Fs"]["first"] == pytest.approx(1.0, abs=0.15)
    assert told["factor_Fc_Fs"]["total"] == pytest.approx(1.0, abs=0.15)
    assert "Sobol indices of the rms error" in (out / "report.html").read_text()


def test_coefficients_are_those_of_the_linear_law():
    random = np.random.default_rng(1)
    factors = random.random((4000, 3))
    log = 3 * factors[:, 0] - 4 * factors[:, 1]
    found = sensitivity(factors, np.exp(log), ["a", "b", "c"])
    assert found.coefficients == {
        "a": pytest.approx(0.6, abs=0.02),
        "b": pytest.approx(-0.8, abs=0.02),
        "c": pytest.approx(0.0, abs=0.02),
    }
    assert found.explained == pytest.approx(1.0, abs=1e-6)
    assert found.foremost == "b"


def test_what_is_not_linear_is_said_to_be_explained_badly():
    factors = np.linspace(-1, 1, 101)[:, None]
    found = sensitivity(factors, np.exp(factors[:, 0] ** 2), ["a"])
    assert found.explained == pytest.approx(0.0, abs=1e-9)
