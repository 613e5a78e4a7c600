"""A motor without inductance: its current follows the voltage at once."""

import numpy as np
from cases import ballscrew, case


def test_every_row_has_the_current_of_its_own_voltage(tmp_path):
    folder = case("output_at_start", tmp_path)
    words = "--controller pd.fmu --plant motor.fmu --setpoint 0.1 --stop 0.1 --step 1e-3 --out out"
    answer = ballscrew(folder, f"run {words}")
    assert answer.returncode == 0, answer.stderr
    run = np.genfromtxt(folder / "out" / "trajectory.csv", delimiter=",", names=True)
    assert (run["u"][0], run["i"][0]) == (2.5, 1.25)
    # R = 2 ohm and a back-EMF of 0.5 V*s/m
    np.testing.assert_allclose(run["i"], (run["u"] - 0.5 * run["v"]) / 2.0, atol=1e-14)
