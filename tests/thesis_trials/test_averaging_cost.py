"""What one averaged friction curve costs in force in each direction."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from tables_of_trials import BEGIN, END, PAGE, thesis
from thesis_trials.averaging_cost import averaging_cost
from thesis_trials.scatter import BadTable

THESIS = Path(__file__).resolve().parents[1] / "data" / "table_2_3_stribeck.csv"


def written(folder: Path, forwards: list[float], backwards: list[float]) -> Path:
    path = folder / "sides.csv"
    names = ("Fc", "Fs", "Vs", "sigma2")
    rows = [f"{n},{f},{b}" for n, f, b in zip(names, forwards, backwards, strict=True)]
    path.write_text("symbol,positive_velocity,negative_velocity\n" + "\n".join(rows) + "\n")
    return path


def test_directions_that_are_alike_cost_nothing(tmp_path):
    cost = averaging_cost(written(tmp_path, [1, 2, 1e-3, 100], [1, 2, 1e-3, 100]))
    assert cost.forwards.rms == cost.backwards.rms == cost.unavoidable.rms == 0


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


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("symbol,positive_velocity\nFc,1\n", "no column 'negative_velocity'"),
        ("symbol,positive_velocity,negative_velocity\nFc,1,1\n", "no row for Fs, Vs, sigma2"),
    ],
)
def test_a_table_without_both_directions_is_refused(text, says, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(BadTable, match=says):
        averaging_cost(path)


def test_a_range_of_speed_that_is_none_is_refused():
    with pytest.raises(BadTable, match="expected more than zero"):
        averaging_cost(THESIS, 0.0)


def test_the_page_says_what_comes_out():
    assert BEGIN + thesis()[2] + END in PAGE.read_text(encoding="utf-8")
