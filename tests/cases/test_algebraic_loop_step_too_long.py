"""Position and command follow each other at once: an algebraic loop, which no step cures."""

import numpy as np
import pytest
from cases import ballscrew, case


def test_it_is_solved_at_every_communication_point(tmp_path):
    folder = case("algebraic_loop_step_too_long", tmp_path)
    words = "--controller pd.fmu --plant cart_ft.fmu --setpoint 0.1 --stop 0.5 --out out"
    answer = ballscrew(folder, f"run {words}")
    assert answer.returncode == 0, answer.stderr
    run = np.genfromtxt(folder / "out" / "trajectory.csv", delimiter=",", names=True)
    assert run["x"][0] == pytest.approx(0.1 / 3, abs=1e-12)
    assert run["x"][-1] == pytest.approx(0.06395, abs=1e-4)
    np.testing.assert_allclose(run["u"], 25.0 * (0.1 - run["x"]) - 8.0 * run["v"], atol=1e-10)
