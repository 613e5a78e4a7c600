"""FMUs that are not ours: whose port, whose parameter, what they can do, and who is sampled."""

import json

import numpy as np
import pytest
import small_fmus
from diagnosed import run as command
from third_party_fmus import following, proportional

from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.parameter_file import read_parameters
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.solver.errors import CouplingError


def by_hand(folder, name, goal="x_d", load=("load",), **options):
    """u = gain (x_d - pos) + load."""
    law = f"self.gain * (self.{goal} - self.pos)" + "".join(f" + self.{n}" for n in load)
    inputs = ("pos", goal, *load)
    return following(folder, name, options, inputs=inputs, gain=400.0, output="u", law=law)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("third_party")


@pytest.fixture(scope="module")
def hand(folder):
    return by_hand(folder, "Hand")


SHORT = ("--stop", "0.02", "--step", "1e-3")


def test_a_map_and_a_value_can_be_for_one_of_several_controllers(hand, tmp_path):
    given = ("--map", "Hand.pos=x", "--set", "Hand.gain=3", "--set", "pid.Ki=0")
    code, _, said = command(
        "swap", "--controllers", "pid", hand, *SHORT, *given, "--json", "--out", tmp_path
    )
    assert code in (0, 1), said
    rows = json.loads((tmp_path / "comparison.json").read_text())
    peaks = {r["controller"]: r["peak_voltage"] for r in rows}
    assert peaks["Hand"] == pytest.approx(3 * 0.08, rel=1e-3)
    assert peaks["pid"] > 1.0
    file = read_parameters(tmp_path / "parameters.toml")
    assert file.controllers["Hand"]["gain"].value == 3.0
    assert file.controllers["pid"]["Ki"].value == 0.0


@pytest.mark.ci
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--map", "pos=x", "--map", "pos=v"), "--map pos is given as x and as v"),
        (("--map", "pos=x", "--map", "Hand.pos=v"), "--map Hand.pos and --map pos: expected one"),
        (("--map", "pos=x", "--map", "v=u"), "mapping: v=u has the same name as plant's port 'u'"),
        (("--map", "pos=x", "--map", "v=x_d"), "has the same name as a column of the results"),
        (("--map", "pos=x", "--map", "Hand.spin=v"), "controller has no port 'spin'"),
        (("--map", "pos=x", "--set", "Hnd.Kp=1"), "plant.NAME=VALUE, Hand.NAME=VALUE"),
        (("--map", "posi=x"), "neither side has a port 'posi'; nearest: pos"),
    ],
)
def test_what_makes_no_sense_is_one_line(hand, tmp_path, given, said):
    words = "run", "--controller", hand, *given, *SHORT, "--out", tmp_path
    code, printed, told = command(*words)
    assert (code, printed, told.count("\n")) == (2, "", 1), told
    assert said in told


def test_an_input_that_nothing_drives_is_said_and_stays(hand, tmp_path):
    given = ("--map", "pos=x", *SHORT, "--setpoint", "0.05", "--out", tmp_path)
    _, _, said = command("run", "--controller", hand, *given)
    note = "nothing is connected to the input 'load' of Hand: it stays at 0; connect it, or give"
    assert f"note: {note}" in said
    figures = json.loads((tmp_path / "metrics.json").read_text())
    assert any(note in n for n in figures["notes"])
    assert figures["peak_voltage"] == pytest.approx(400 * 0.05, rel=1e-3)  # load takes no part


def test_a_set_point_by_another_name_is_taken_and_said(folder):
    path = by_hand(folder, "Goal", "goal", ())
    result = run_closed_loop(Loop(str(path), mapping={"pos": "x"}, stop=0.01, step=1e-3))
    assert any("'goal' of Goal" in n and "set-point" in n for n in result.notes)
    assert result.run.commands["u"][0] == pytest.approx(400 * 0.08)


@pytest.mark.ci
def test_two_candidates_for_the_set_point_are_refused_and_steps_that_may_not_vary_are_told(folder):
    path = by_hand(folder, "Two", "goal", canHandleVariableCommunicationStepSize=False)
    with pytest.raises(CouplingError, match="map one of them to the set-point: goal=x_d"):
        run_closed_loop(Loop(str(path), mapping={"pos": "x"}, stop=0.01, step=1e-3))
    mapping = {"pos": "x", "goal": "x_d"}
    notes = run_closed_loop(Loop(str(path), mapping=mapping, stop=0.01, step=1e-3)).notes
    assert not any("as the set-point" in n for n in notes)
    assert any("requires steps of constant length" in n for n in notes)


def test_a_stranger_that_reports_no_derivatives_is_probed_and_its_error_is_known(folder):
    """Against the same with a tenth of the step."""
    path = str(proportional(folder, "Plain", canGetAndSetFMUstate=True))
    run = run_closed_loop(Loop(path, stop=0.2, step=1e-3)).run
    fine = run_closed_loop(Loop(path, stop=0.2, step=1e-4, isolate=False)).run
    off = np.abs(run.outputs["x"] - fine.outputs["x"][::10]).max()
    assert run.coupling is Coupling.INTERFACE_JACOBIAN
    assert "probed" in run.coupling_reason
    assert run.verdict.trusted
    assert off < 2 * run.verdict.error_estimate["x"] + 1e-7


def test_a_controller_that_cannot_be_taken_back_is_stepped_once_a_step_and_never_past_the_end(
    tmp_path,
):
    """And its other outputs are in the table."""
    path, names = tmp_path / "counter.fmu", {"position": "input", "voltage": "output"}
    ports = [(name, kind, None, "") for name, kind in {**names, "steps": "output"}.items()]
    step = "if (t + h > 0.0101) return 3; $voltage$ += 0.125; $steps$ += 1;"
    small_fmus.build(str(path), "counter", ports, saves=False, init="$steps$ = 7;", step=step)
    mapping = {"position": "x", "voltage": "u"}
    how = {"stop": 0.01, "step": 1e-3, "coupling": Coupling.GAUSS_SEIDEL}
    result = run_closed_loop(Loop(str(path), mapping=mapping, **how))
    assert result.run.stopped == ""
    np.testing.assert_array_equal(result.run.commands["u"][:-1], 0.125 * np.arange(1, 11))
    np.testing.assert_array_equal(result.run.others["controller.steps"][:-1], np.arange(8, 18))
    header = next(iter(result.trajectory_csv())).decode().strip().split(",")
    assert header[-2:] == ["x_d", "controller.steps"]
