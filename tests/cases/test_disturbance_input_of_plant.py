"""A plant with an input beside the command: at its start value, or at one that is given."""

import numpy as np
import pytest
from cases import ballscrew, case

LOOP = "run --controller pd.fmu --plant cart_ld.fmu --setpoint 0.1 --stop 0.5 --step 1e-3 --out out"


def test_it_stays_at_its_start_value_with_a_note_or_at_the_one_that_is_given(tmp_path):
    folder = case("disturbance_input_of_plant", tmp_path)

    def end(words=""):
        answer = ballscrew(folder, f"{LOOP} {words}")
        assert answer.returncode == 0, answer.stderr
        table = np.genfromtxt(folder / "out" / "trajectory.csv", delimiter=",", names=True)
        return table["x"][-1], answer.stderr

    free, said = end()
    assert "note: nothing is connected to the input 'F_load' of cart_ld: it stays at 0" in said
    assert "--set plant.F_load=VALUE" in said
    pushed, said = end("--set plant.F_load=0.5")
    assert "F_load" not in said
    assert pushed == pytest.approx(0.0856, abs=5e-5)
    assert pushed > free


def test_an_input_that_the_loop_drives_takes_no_value(tmp_path):
    folder = case("disturbance_input_of_plant", tmp_path)
    answer = ballscrew(folder, f"{LOOP} --set plant.u=1")
    assert answer.returncode == 2
    assert "plant.u is an input that is connected in the loop" in answer.stderr
    assert len(answer.stderr.splitlines()) == 1
