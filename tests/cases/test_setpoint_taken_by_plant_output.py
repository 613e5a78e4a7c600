"""A plant that echoes a command in an output called x_d."""

import numpy as np
from cases import ballscrew, case


def test_the_set_point_drives_the_controller_and_no_two_columns_have_one_name(tmp_path):
    folder = case("setpoint_taken_by_plant_output", tmp_path)
    words = "--plant cart_uu.fmu --map controller.u=u_in --setpoint 0.1 --stop 0.1 --step 1e-3"
    answer = ballscrew(folder, f"run --controller pd.fmu {words} --out out")
    assert answer.returncode == 0, answer.stderr
    path = folder / "out" / "trajectory.csv"
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    assert len(header) == len(set(header))
    table = dict(zip(header, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    np.testing.assert_array_equal(table["x_d"], 0.1)
    np.testing.assert_array_equal(table["plant.x_d"], 88.0)  # its echo
    np.testing.assert_allclose(table["u_in"], 25.0 * (0.1 - table["x"]) - 8.0 * table["v"])
