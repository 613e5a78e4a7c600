"""What one averaged friction curve costs in force in each direction."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from thesis_trials.averaging_cost import averaging_cost

pytestmark = pytest.mark.ci


THESIS = Path(__file__).resolve().parents[1] / "data" / "table_2_3_stribeck.csv"


def written(folder: Path, forwards: list[float], backwards: list[float]) -> Path:
    path = folder / "sides.csv"
    names = ("Fc", "Fs", "Vs", "sigma2")
    rows = [f"{n},{f},{b}" for n, f, b in zip(names, forwards, backwards, strict=True)]
    path.write_text("symbol,positive_velocity,negative_velocity\n" + "\n".join(rows) + "\n")
    return path


def test_a_coulomb_difference_costs_half_of_it_in_each_direction(tmp_path):
    cost = averaging_cost(written(tmp_path, [1, 2, 1e-3, 100], [1.4, 2.4, 1e-3, 100]))
    assert cost.forwards.rms == pytest.approx(0.2)
    assert cost.forwards.largest == pytest.approx(0.2)
    assert cost.backwards.largest == pytest.approx(-0.2)
    assert cost.unavoidable.rms == pytest.approx(0.2)
    assert cost.of_parameters.rms == pytest.approx(0.0, abs=1e-12)


def test_the_thesis_average_costs_up_to_half_of_the_coulomb_force():
    cost = averaging_cost(THESIS)
    assert cost.averaged["Fc"] == pytest.approx(1.284)
    assert cost.averaged["Vs"] == pytest.approx(1.13975e-3)

    def curve(fc: float, fs: float, vs: float, sigma2: float, v: float) -> float:
        return fc + (fs - fc) * math.exp(-((v / vs) ** 2)) + sigma2 * v

    v = cost.backwards.at_speed
    one = curve(1.284, 2.35, 1.13975e-3, 173.0, v)
    assert cost.backwards.largest == pytest.approx(one - curve(1.458, 2.4, 3.365e-4, 152.6, v))
    assert cost.backwards.largest == pytest.approx(0.617, abs=1e-3)
    assert cost.forwards.rms == pytest.approx(0.155, abs=1e-3)
    # most of it is the averaging of a speed that stands in an exponent
    assert cost.unavoidable.rms < cost.backwards.rms
