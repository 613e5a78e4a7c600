"""FMUs that are not ours: whose port, whose parameter, what they can do, and who is sampled."""

import json
import textwrap

import numpy as np
import pytest
from diagnosed import run as command
from pythonfmu.builder import FmuBuilder

from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.parameter_file import read_parameters
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.solver.errors import CouplingError

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
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = self.v = self.x_d = self.u = 0.0
        self.{period} = 0.005
        self.samples = 0
        for name in ("x", "v", "x_d"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        fixed = {{"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}}
        self.register_variable(Real("{period}", **fixed))
        discrete = Fmi2Variability.discrete
        self.register_variable(Real("u", causality=Fmi2Causality.output, variability=discrete))

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


SHORT = ("--stop", "0.02", "--step", "1e-3")


def refused(*arguments):
    code, printed, said = command(*arguments)
    assert (code, printed) == (2, ""), said
    assert said.count("\n") == 1
    return said


@pytest.mark.parametrize("port", ["Hand.pos", pytest.param("pos", marks=pytest.mark.ci)])
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


@pytest.mark.ci
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--map", "pos=x", "--map", "pos=v"), "--map pos is given as x and as v"),
        (("--map", "pos=x", "--map", "Hand.pos=v"), "--map Hand.pos and --map pos: expected one"),
        (("--map", "pos=x", "--map", "v=u"), "--map v=u has the same name as plant's port 'u'"),
        (("--map", "pos=x", "--map", "v=x_d"), "has the same name as a column of the results"),
        (("--map", "pos=x", "--map", "Hand.spin=v"), "controller has no port 'spin'"),
        (("--map", "pos=x", "--set", "Hnd.Kp=1"), "plant.NAME=VALUE, Hand.NAME=VALUE"),
        (("--map", "posi=x"), "neither side has a port 'posi'; nearest: pos"),
    ],
)
def test_what_makes_no_sense_is_one_line(hand, tmp_path, given, said):
    assert said in refused("run", "--controller", hand, *given, *SHORT, "--out", tmp_path)


def test_an_input_that_nothing_drives_is_said_and_stays(hand, tmp_path):
    given = ("--map", "pos=x", *SHORT, "--setpoint", "0.05", "--out", tmp_path)
    _, _, said = command("run", "--controller", hand, *given)
    note = "nothing is connected to the input 'load' of Hand: it stays at 0; connect it, or give"
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


@pytest.mark.ci
def test_two_candidates_for_the_set_point_are_refused(folder):
    path = built(folder, "Two", HAND.replace("x_d", "goal").format(name="Two"))
    with pytest.raises(CouplingError, match="give the set-point, such as --map goal=x_d"):
        run_closed_loop(Loop(str(path), mapping={"pos": "x"}, stop=0.01, step=1e-3))
    mapping = {"pos": "x", "goal": "x_d"}
    result = run_closed_loop(Loop(str(path), mapping=mapping, stop=0.01, step=1e-3))
    assert [n for n in result.notes if "set-point" in n] == []


@pytest.mark.ci
def test_steps_that_may_not_vary_are_told(folder):
    text = HAND.format(name="Fixed")
    path = built(folder, "Fixed", text, canHandleVariableCommunicationStepSize=False)
    result = run_closed_loop(Loop(str(path), mapping={"pos": "x"}, stop=0.01, step=1e-3))
    assert any("requires steps of constant length" in n for n in result.notes)


@pytest.mark.ci
def test_a_sampled_controller_whose_period_has_another_name_is_stepped_by_communication_steps(
    folder,
):
    """Its own clock then samples at every fifth of them."""
    runs = []
    for name, period in (("Named", "sample_time"), ("Other", "Ts")):
        text = SAMPLED.format(name=name, period=period)
        path = built(folder, name, text, canGetAndSetFMUstate=True)
        runs.append(run_closed_loop(Loop(str(path), stop=0.1, step=1e-3)))
    named, other = runs
    assert "with the communication step of 0.001 s as its period" in " ".join(other.notes)
    np.testing.assert_allclose(other.run.outputs["x"], named.run.outputs["x"], rtol=1e-6, atol=1e-9)
    assert other.trusted


STATE = {"canGetAndSetFMUstate": True}


def test_a_stranger_that_reports_no_derivatives_is_probed_and_its_error_is_known(folder):
    """Against the same with a tenth of the step."""
    path = str(built(folder, "Plain", HAND.format(name="Plain"), **STATE))
    run = run_closed_loop(Loop(path, mapping={"pos": "x"}, stop=0.2, step=1e-3)).run
    fine = run_closed_loop(Loop(path, mapping={"pos": "x"}, stop=0.2, step=1e-4, isolate=False)).run
    off = np.abs(run.outputs["x"] - fine.outputs["x"][::10]).max()
    estimate = run.verdict.error_estimate["x"]
    assert run.coupling is Coupling.INTERFACE_JACOBIAN
    assert "probed" in run.coupling_reason
    assert run.verdict.trusted
    assert off < 2 * estimate + 1e-7


COUNTER = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Integer, Real


class Counter(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.position = 0.0
        self.voltage = 0.0
        self.register_variable(Real("position", causality=Fmi2Causality.input))
        self.register_variable(Real("voltage", causality=Fmi2Causality.output))
        self.steps = 7
        self.register_variable(Integer("steps", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        assert current_time + step_size < 0.0101
        self.steps += 1
        self.voltage += 0.125
        return True
"""


def test_a_controller_that_cannot_be_taken_back_is_stepped_once_a_step_and_never_past_the_end(
    tmp_path,
):
    """And its other outputs are in the table, whatever their type."""
    path = built(tmp_path, "Counter", COUNTER)
    ports = {"position": "x", "voltage": "u"}
    how = {"stop": 0.01, "step": 1e-3, "coupling": Coupling.GAUSS_SEIDEL}
    result = run_closed_loop(Loop(str(path), mapping=ports, **how))
    run = result.run
    assert run.stopped == ""
    np.testing.assert_array_equal(run.commands["u"][:-1], 0.125 * np.arange(1, 11))
    np.testing.assert_array_equal(run.others["controller.steps"][:-1], np.arange(8, 18))
    header = next(iter(result.trajectory_csv())).decode().strip().split(",")
    assert header[-2:] == ["x_d", "controller.steps"]
