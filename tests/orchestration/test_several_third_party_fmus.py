"""FMUs of others side by side: whose port, whose parameter, and who is sampled."""

from __future__ import annotations

import json
import textwrap

import numpy as np
import pytest
from diagnosed import run as command
from pythonfmu.builder import FmuBuilder
from third_party_fmus import proportional

from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.parameter_reading import read_parameters
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.orchestration.wiring import WiringError

HAND = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.pos = self.x_d = self.load = self.u = 0.0
        self.Kp = 400.0
        for name in ("pos", "x_d", "load"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        self.register_variable(
            Real("Kp", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed)
        )
        self.register_variable(Real("u", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.u = self.Kp * (self.x_d - self.pos) + self.load
        return True
"""

SAMPLED = """
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = self.v = self.x_d = self.u = 0.0
        self.{period} = {seconds}
        self.samples = 0
        for name in ("x", "v", "x_d"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        if {told}:
            self.register_variable(
                Real(
                    "{period}",
                    causality=Fmi2Causality.parameter,
                    variability=Fmi2Variability.fixed,
                )
            )
        self.register_variable(
            Real("u", causality=Fmi2Causality.output, variability=Fmi2Variability.{variability})
        )

    def do_step(self, current_time, step_size):
        while self.samples * self.{period} < current_time + step_size - 1e-9:
            self.samples += 1
            self.u = 400.0 * (self.x_d - self.x) - 20.0 * self.v
        return True

    def _get_fmu_state(self):
        return {{"u": self.u, "samples": self.samples, "x": self.x, "v": self.v, "x_d": self.x_d}}

    def _set_fmu_state(self, state):
        self.__dict__.update(state)
"""


def built(folder, name, text, **options):
    folder.mkdir(parents=True, exist_ok=True)
    script = folder / f"script_{name.lower()}.py"
    script.write_text(textwrap.dedent(text))
    FmuBuilder.build_FMU(script, dest=folder / f"{name}.fmu", **options)
    return folder / f"{name}.fmu"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("third_party")


@pytest.fixture(scope="module")
def hand(folder):
    return built(folder, "Hand", HAND.format(name="Hand"))


def sampled(folder, name, period="Ts", seconds=0.005, told=True, variability="continuous"):
    text = SAMPLED.format(
        name=name, period=period, seconds=seconds, told=told, variability=variability
    )
    return built(folder, name, text, canGetAndSetFMUstate=True)


SHORT = ("--stop", "0.02", "--step", "1e-3")


def refused(*arguments):
    code, printed, said = command(*arguments)
    assert (code, printed) == (2, ""), said
    assert said.count("\n") == 1
    return said


# -- whose port, whose parameter ---------------------------------------------------------------


@pytest.mark.parametrize("port", ["pos", "Hand.pos"])
def test_a_map_and_a_value_can_be_for_one_of_several_controllers(hand, tmp_path, port):
    given = ("--map", f"{port}=x", "--set", "Hand.Kp=3", "--set", "pid.Ki=0")
    code, _, said = command(
        "swap", "--controllers", "pid", hand, *SHORT, *given, "--json", "--out", tmp_path
    )
    assert code in (0, 1), said
    peaks = {r["controller"]: r["peak_voltage"] for r in _rows(tmp_path)}
    assert peaks["Hand"] == pytest.approx(3 * 0.08, rel=1e-3)
    assert peaks["pid"] > 1.0
    file = read_parameters(tmp_path / "parameters.toml")
    assert file.controllers["Hand"]["Kp"].value == 3.0
    assert file.controllers["pid"]["Ki"].value == 0.0


def _rows(folder):
    return json.loads((folder / "comparison.json").read_text())


def test_what_is_said_of_one_wins_over_what_is_said_of_all(hand, tmp_path):
    pid = ("run", "--controller", hand, "--map", "pos=x", *SHORT, "--out", tmp_path)
    for order in (("Hand.Kp=3", "controller.Kp=7"), ("controller.Kp=7", "Hand.Kp=3")):
        command(*pid, "--set", order[0], "--set", order[1])
        assert read_parameters(tmp_path / "parameters.toml").controllers["Hand"]["Kp"].value == 3


def test_two_files_of_one_name_are_refused(hand, folder, tmp_path):
    other = built(folder / "other", "Hand", HAND.format(name="Hand"))
    said = refused("swap", "--controllers", hand, other, *SHORT, "--out", tmp_path)
    assert "are both called Hand; rename one of them" in said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--map", "pos=x", "--map", "pos=v"), "--map pos is given as x and as v"),
        (("--map", "pos=x", "--map", "Hand.pos=v"), "--map Hand.pos and --map pos: expected one"),
        (("--map", "pos=x", "--map", "load=x"), "has the same name as controller's port"),
        (("--map", "pos=x", "--map", "v=u"), "--map v=u has the same name as plant's port 'u'"),
        (("--map", "pos=x", "--map", "v=x_d"), "has the same name as a column of the results"),
        (("--map", "pos=x", "--map", "plant.v=time"), "has the same name as a column of the"),
        (("--map", "pos=x", "--map", "Hand.spin=v"), "controller has no port 'spin'"),
        (("--map", "pos=x", "--map", "posi=v"), "neither side has a port 'posi'; nearest: pos"),
        (
            ("--map", "pos=x", "--set", "Hnd.Kp=1"),
            "controller.NAME=VALUE or Hand.NAME=VALUE",
        ),
        (("--map", "pos=x", "--set", "Hand.Kq=1"), "controller has no parameter 'Kq'"),
    ],
)
def test_what_makes_no_sense_is_one_line(hand, tmp_path, given, said):
    assert said in refused("run", "--controller", hand, *given, *SHORT, "--out", tmp_path)


def test_a_port_that_only_one_of_several_has_must_be_there_somewhere(hand, tmp_path):
    given = ("--map", "Hand.pos=x", "--map", "spin=v")
    said = refused("swap", "--controllers", "pid", hand, *given, *SHORT, "--out", tmp_path)
    assert "neither side has a port 'spin'" in said


# -- inputs that nothing drives ------------------------------------------------------------------


def test_an_input_that_nothing_drives_is_said_and_stays(hand, tmp_path):
    given = ("--map", "pos=x", *SHORT, "--setpoint", "0.05", "--out", tmp_path)
    _, _, said = command("run", "--controller", hand, *given)
    note = "nothing is connected to the input 'load' of Hand: it stays at 0; --map load=NAME"
    assert f"note: {note}" in said
    figures = json.loads((tmp_path / "metrics.json").read_text())
    assert any(note in n for n in figures["notes"])
    assert figures["peak_voltage"] == pytest.approx(400 * 0.05, rel=1e-3)  # load takes no part


def test_a_set_point_by_another_name_is_taken_and_said(folder):
    text = HAND.replace("x_d", "goal").replace('"pos", "goal", "load"', '"pos", "goal"')
    path = built(folder, "Goal", text.format(name="Goal"))
    result = run_closed_loop(Loop(str(path), mapping={"pos": "x"}, stop=0.01, step=1e-3))
    assert any("'goal' of Goal" in n and "set-point" in n for n in result.notes)
    assert result.run.commands["u"][0] == pytest.approx(400 * 0.08)


def test_two_candidates_for_the_set_point_are_refused(folder):
    path = built(folder, "Two", HAND.replace("x_d", "goal").format(name="Two"))
    with pytest.raises(WiringError, match="give the set-point, such as --map goal=x_d"):
        run_closed_loop(Loop(str(path), mapping={"pos": "x"}, stop=0.01, step=1e-3))
    mapping = {"pos": "x", "goal": "x_d"}
    result = run_closed_loop(Loop(str(path), mapping=mapping, stop=0.01, step=1e-3))
    assert [n for n in result.notes if "set-point" in n] == []


# -- who is sampled ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def by_name(folder):
    """A sampled controller whose period is called as ours is."""
    path = sampled(folder, "Named", period="sample_time")
    return run_closed_loop(Loop(str(path), stop=0.2, step=1e-3)).run


@pytest.mark.parametrize(
    ("name", "changes", "found"),
    [
        ("Ts", {}, "its parameter Ts"),
        ("Silent", {"told": False}, "the interval between jumps of its commands"),
    ],
)
def test_a_sampled_controller_is_known_by_how_it_moves(folder, by_name, name, changes, found):
    path = sampled(folder, name, **changes)
    result = run_closed_loop(Loop(str(path), stop=0.2, step=1e-3))
    assert any(f"is sampled every 0.005 s, by {found}" in n for n in result.notes)
    assert result.run.coupling_reason == by_name.coupling_reason
    np.testing.assert_array_equal(result.run.outputs["x"], by_name.outputs["x"])
    assert result.run.verdict == by_name.verdict


@pytest.mark.parametrize("seconds", [0.0005, 0.001, 0.0013, 0.04])
def test_periods_shorter_and_longer_than_a_step_are_found(folder, seconds):
    path = sampled(folder, f"P{round(1e6 * seconds)}", seconds=seconds)
    result = run_closed_loop(Loop(str(path), stop=0.2, step=1e-3))
    assert any(f"every {seconds:g} s, by its parameter Ts" in n for n in result.notes)


def test_a_period_that_is_set_is_the_one_that_counts(folder):
    path = sampled(folder, "Set", seconds=0.005)
    result = run_closed_loop(Loop(str(path), controller_values={"Ts": 0.008}, stop=0.2, step=1e-3))
    assert any("every 0.008 s, by its parameter Ts" in n for n in result.notes)


def test_a_controller_that_answers_in_every_step_is_not_sampled(folder):
    path = proportional(folder, "EveryStep")
    result = run_closed_loop(Loop(str(path), stop=0.05, step=1e-3, coupling=Coupling.GAUSS_SEIDEL))
    assert not any("is sampled every" in note for note in result.notes)


def test_an_uneven_period_that_nothing_tells_is_refused(folder, tmp_path):
    path = sampled(folder, "Uneven", seconds=0.0013, told=False)
    said = refused(
        "run", "--controller", path, "--stop", "0.1", "--step", "1e-3", "--out", tmp_path
    )
    assert "it is sampled" in said
    assert "name its period parameter sample_time" in said


def test_discrete_commands_whose_period_is_not_to_be_had_are_refused(folder, tmp_path):
    path = sampled(folder, "Slow", seconds=5.0, told=False, variability="discrete")
    said = refused(
        "run", "--controller", path, "--stop", "0.1", "--step", "1e-3", "--out", tmp_path
    )
    assert "declares discrete commands" in said
    assert "name its period parameter sample_time" in said


def test_steps_that_may_not_vary_are_told(folder):
    text = HAND.format(name="Fixed")
    path = built(folder, "Fixed", text, canHandleVariableCommunicationStepSize=False)
    result = run_closed_loop(Loop(str(path), mapping={"pos": "x"}, stop=0.01, step=1e-3))
    assert any("requires steps of constant length" in n for n in result.notes)
