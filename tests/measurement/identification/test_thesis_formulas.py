"""The thesis' formulas: its printed figures come back, and their bias is known."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballscrew.measurement.identification.bliman_sorine_map import (
    map_points,
    points_of,
    read_points,
)
from ballscrew.measurement.identification.dahl_fit import dahl_curve
from ballscrew.measurement.identification.intervals import spread
from ballscrew.measurement.identification.lugre_dynamics import assumed_damping, secant_bias

DATA = Path(__file__).resolve().parents[2] / "data"


def table(name):
    with open(DATA / f"{name}.csv", encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_averages_and_bands_of_table_2_5_come_back():
    rows = table("table_2_5_dahl")
    sigma = spread([float(r["sigma_N_m"]) for r in rows])
    fc = spread([float(r["Fc_N"]) for r in rows])
    assert sigma.mean == 87750.0
    assert sigma.deviation == pytest.approx(18346.7, abs=0.05)
    assert fc.mean == pytest.approx(2.0, abs=0.005)
    assert fc.deviation == pytest.approx(0.164, abs=0.0005)
    assert sigma.outside == fc.outside == ()


def test_nominal_values_of_table_2_9_come_back():
    rows = table("table_2_9_lugre")
    sigma0 = spread([float(r["sigma0_N_m"]) for r in rows])
    assert sigma0.mean == pytest.approx(66967.231, abs=5e-4)
    assert sigma0.outside == ()
    assert assumed_damping(sigma0.mean, 173.0) == pytest.approx(344.56, abs=0.005)


@pytest.mark.ci
@pytest.mark.parametrize(("trial", "p"), [("6", 1.2305), ("9", 1.6163)])  # 9: digits corrected
def test_rows_of_table_2_7_come_back_from_their_reference_points(trial, p):
    row = next(r for r in table("table_2_7_bliman_sorine") if r["trial"] == trial)
    printed = [float(row[n]) for n in ("f1_N", "f2_N", "eps_f_m", "eta")]
    points = points_of(*printed)
    found = map_points(points)
    assert [found.f1, found.f2, found.eps_f, found.eta] == pytest.approx(printed, rel=1e-9)
    assert found.p == pytest.approx(p, abs=7e-5)
    if trial == "6":
        assert points.fs == pytest.approx(2.502, abs=5e-4)


def test_the_map_s_points_lie_on_the_law_s_branch_after_a_reversal():
    f1, f2, eps, eta = 19.875, 17.8227, 0.000121, 0.9063
    x = np.linspace(0, 2e-3, 200001)
    friction = f1 * (1 - 2 * np.exp(-x / (eta * eps))) - f2 * (1 - 2 * np.exp(-x / eps))
    points, printed = read_points(x, friction), points_of(f1, f2, eps, eta)
    assert points.fs == pytest.approx(printed.fs, rel=1e-6)
    assert points.x_e == pytest.approx(printed.x_e, rel=1e-3)


@pytest.mark.ci
@pytest.mark.parametrize("sign", [1, -1])
def test_dahl_s_curve_solves_dahl_s_equation_so_the_sign_of_eq_2_5_is_corrected(sign):
    x = np.linspace(0, sign * 2e-4, 400)
    f = dahl_curve(x, 87750.0, 2.0)
    slope = np.gradient(f, x)
    np.testing.assert_allclose(slope[1:-1], 87750 * (1 - sign * f / 2.0)[1:-1], rtol=1e-3)


@pytest.mark.ci
@pytest.mark.parametrize("force", [0.5, 1.5])
def test_the_bias_of_eq_2_14_is_that_of_the_integrated_law(force):
    s0, s1, s2, fc, fs, vs = 66967.231, 344.56, 173.0, 1.284, 2.35, 1.13975e-3

    def rates(t, y):
        _, v, z = y
        rate = v - s0 * abs(v) / (fc + (fs - fc) * math.exp(-((v / vs) ** 2))) * z
        applied = force * (1 - math.exp(-t))  # reached in about four seconds, as in Fig. 2.11
        return [v, applied - (s0 * z + s1 * rate + s2 * v), rate]

    end = solve_ivp(rates, (0, 12), [0, 0, 0], method="Radau", rtol=1e-8, atol=1e-12).y[:, -1]
    assert force / end[0] == pytest.approx(secant_bias(force, fs) * s0, rel=2e-3)
