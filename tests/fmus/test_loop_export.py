"""``ballscrew export --loop``: one FMU of a whole closed loop, for either kind of simulation."""

import ctypes
import importlib.util
import zipfile

import fmpy
import numpy as np
import pytest
from exported_loops import IN_LOOPS
from fmpy.fmi2 import FMU2Model
from fmpy.validation import validate_fmu
from fmu_host import opened
from scipy.integrate import solve_ivp
from wired_loop import WiredLoop, missing_for_ecos, run_in

from ballscrew.cli import main
from ballscrew.controllers import CONTROLLERS
from ballscrew.fmus import catalogue
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.whole_loop import run_monolithic
from ballscrew.solver.compilers import compiler_for, own_platform
from ballscrew.solver.component import Component, Input, Output, symbol

GOAL, STOP, STEP = 0.08, 2.0, 1e-2
KINDS = {
    "pythonfmu": [],
    "native": ["--native"],
    "native, FMI 3": ["--native", "--fmi", "3"],
}


def needs_compiler():
    if not own_platform() or not compiler_for(own_platform()):
        pytest.skip("needs x86-64 and a C compiler; install one, or the package ziglang")


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    """``loop(controller, kind)`` is the path of the loop's FMU, as the command writes it."""
    made = {}

    def get(controller, kind):
        if kind != "pythonfmu":
            needs_compiler()
        if (controller, kind) not in made:
            folder = tmp_path_factory.mktemp("loop")
            assert main(["export", "--loop", controller, *KINDS[kind], "--out", str(folder)]) == 0
            made[controller, kind] = folder / f"{controller}_loop.fmu"
        return made[controller, kind]

    return get


@pytest.fixture(scope="module")
def truth():
    """``truth(controller, **parts)`` are the signals of one solver on the steps' grid."""

    def get(controller, **values):
        run = run_monolithic(
            Loop(controller, reference=Reference.constant(GOAL), stop=STOP, **values), 1e-3
        )
        every = round(STEP / 1e-3)
        return {n: y[::every] for n, y in (run.outputs | run.commands).items()}

    return get


def stepped(path, names, values=None, step=STEP):
    """Signals at the communication points, the step of the set-point from the start on."""
    start = {"x_d": GOAL} | (values or {})
    if fmpy.read_model_description(str(path)).fmiVersion == "3.0":
        course = fmpy.simulate_fmu(
            str(path),
            fmi_type="CoSimulation",
            stop_time=STOP,
            output_interval=step,
            start_values=start,
            output=names,
        )
        return {n: course[n] for n in names}
    slave, at = opened(path, start)
    rows = [slave.getReal([at[n] for n in names])]
    for k in range(round(STOP / step)):
        slave.doStep(k * step, step)
        rows.append(slave.getReal([at[n] for n in names]))
    slave.terminate()
    slave.freeInstance()
    return dict(zip(names, np.array(rows).T, strict=True))


def exchanged(course, name):
    """Values at the steps' grid; fmpy adds rows at events."""
    grid = np.round(course["time"] / STEP, 6)
    first = dict(zip(grid[::-1], course[name][::-1], strict=True))
    return np.array([first[float(k)] for k in range(round(STOP / STEP) + 1)])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("controller", ["iol", "nctf"])
def test_the_loop_follows_one_solver_at_ten_milliseconds(loop, truth, controller, kind):
    got, expected = stepped(loop(controller, kind), ["x", "v", "u"]), truth(controller)
    assert np.ptp(expected["x"]) > 0.07
    assert np.abs(got["x"] - expected["x"]).max() < 1e-8
    for name in ("v", "u"):
        assert np.abs(got[name] - expected[name]).max() < 1e-5 * np.ptp(expected[name]), name


@pytest.mark.parametrize("kind", KINDS)
def test_a_sampled_controller_meets_all_its_instants_within_a_step(loop, kind):
    """At a communication point `u` is what was held up to there: the instant comes after it."""
    got = stepped(loop("pid_sampled", kind), ["x", "u"])
    run = run_monolithic(Loop("pid_sampled", reference=Reference.constant(GOAL), stop=STOP), 1e-3)
    every = round(STEP / 1e-3)
    assert np.abs(got["x"] - run.outputs["x"][::every]).max() < 1e-8
    assert got["u"][0] == 0.0
    held = run.commands["u"][every - 1 :: every]
    assert np.abs(got["u"][1:] - held).max() < 1e-5 * np.ptp(held)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("controller", IN_LOOPS)
def test_fmpy_validates_without_a_message(loop, controller, kind):
    assert validate_fmu(str(loop(controller, kind))) == []


@pytest.mark.parametrize("kind", KINDS)
def test_set_point_in_signals_out_and_names_that_say_whose_they_are(loop, kind):
    variables = fmpy.read_model_description(str(loop("nctf", kind))).modelVariables
    by = {v.name: v for v in variables}
    assert [v.name for v in variables if v.causality == "input"] == ["x_d"]
    outputs = [v.name for v in variables if v.causality == "output"]
    assert outputs == ["x", "v", "z", "i", "u", "friction"]
    for name in ("plant_sigma0", "controller_Kp", "plant_x_start", "controller_w_start"):
        assert by[name].causality == "parameter"
        assert by[name].unit
        assert by[name].description


@pytest.mark.parametrize("kind", ["pythonfmu", "native"])
def test_parameters_of_both_sides_act(loop, truth, kind):
    expected = truth(
        "nctf", plant_values={"sigma2": 200.0, "x_start": 0.01}, controller_values={"Kp": 4000.0}
    )
    values = {"plant_sigma2": 200.0, "plant_x_start": 0.01, "controller_Kp": 4000.0}
    got = stepped(loop("nctf", kind), ["x"], values)
    assert np.abs(expected["x"] - truth("nctf")["x"]).max() > 1e-3
    assert np.abs(got["x"] - expected["x"]).max() < 1e-8


def test_twins_of_the_loop_give_the_same_numbers(loop):
    courses = [stepped(loop("iol", kind), ["x", "u"]) for kind in KINDS]
    for other in courses[1:]:
        for name, values in courses[0].items():
            assert np.abs(other[name] - values).max() <= 1e-9 * np.ptp(values), name


@pytest.mark.parametrize("host", ["libcosim", "ecos"])
def test_third_party_masters_run_the_loop_at_ten_milliseconds(loop, truth, host):
    if host == "ecos" and missing_for_ecos():
        pytest.skip(missing_for_ecos())
    job = WiredLoop(
        {"plant": str(loop("iol", "native"))},
        [],
        [("plant", "x_d", GOAL)],
        ["x"],
        STEP,
        round(STOP / STEP),
    )
    x = np.array(run_in(host, job))[:, 0]
    assert np.abs(x - truth("iol")["x"]).max() < 1e-8


# -- model exchange --------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["native", "native, FMI 3"])
@pytest.mark.parametrize(("controller", "allowed"), [("iol", 1e-6), ("nctf", 2e-7)])
def test_the_loop_for_model_exchange_under_cvode(loop, truth, controller, allowed, kind):
    """6.1e-7 m and 9.2e-8 m at a relative tolerance of 1e-6, a solver that is not ours."""
    course = fmpy.simulate_fmu(
        str(loop(controller, kind)),
        fmi_type="ModelExchange",
        stop_time=STOP,
        output_interval=1e-3,
        relative_tolerance=1e-6,
        start_values={"x_d": GOAL},
        output=["x"],
    )
    assert np.abs(exchanged(course, "x") - truth(controller)["x"]).max() < allowed


class Exchanged:
    """One twin for model exchange, in the hands of whoever solves for its states."""

    def __init__(self, path, values):
        description = fmpy.read_model_description(str(path))
        variables = description.modelVariables
        self.at = {v.name: v.valueReference for v in variables}
        self.ports = {
            causality: [v.name for v in variables if v.causality == causality and v.type == "Real"]
            for causality in ("input", "output")
        }
        self.fmu = FMU2Model(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(path)),
            modelIdentifier=description.modelExchange.modelIdentifier,
            instanceName=path.stem,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)
        for name, value in values.items():
            self.fmu.setReal([self.at[name]], [value])
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        while self.fmu.newDiscreteStates()[0]:
            pass
        self.fmu.enterContinuousTimeMode()
        self.states = np.zeros(description.numberOfContinuousStates)
        self.fmu.getContinuousStates(self._pointer(self.states), len(self.states))

    @staticmethod
    def _pointer(array):
        return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

    def move(self, t, states):
        self.states[:] = states
        self.fmu.setTime(t)
        self.fmu.setContinuousStates(self._pointer(self.states), len(self.states))

    def rates(self):
        rates = np.zeros(len(self.states))
        self.fmu.getDerivatives(self._pointer(rates), len(rates))
        return rates

    def send(self, names, other):
        values = self.fmu.getReal([self.at[n] for n in names])
        other.fmu.setReal([other.at[n] for n in names], values)


@pytest.mark.parametrize("law", [False, True])
@pytest.mark.parametrize(("controller", "allowed"), [("iol", 4e-7), ("nctf", 2e-7)])
def test_two_twins_for_model_exchange_in_one_solver_are_the_loop(
    truth, tmp_path, controller, allowed, law
):
    """2.1e-7 m and 1.2e-7 m at 1e-6; wiring the law's ports as well changes nothing to speak of."""
    needs_compiler()
    assert main(["export", "--native", "--only", "plant", controller, "--out", str(tmp_path)]) == 0
    plant = Exchanged(tmp_path / "plant.fmu", {})
    other = Exchanged(tmp_path / f"{controller}.fmu", {"x_d": GOAL})
    measured = [n for n in plant.ports["output"] if n in other.ports["input"]]
    commands = [n for n in other.ports["output"] if n in plant.ports["input"] and (law or n == "u")]
    n = len(plant.states)

    def right(t, x):
        plant.move(t, x[:n])
        other.move(t, x[n:])
        plant.send(measured, other)
        other.send(commands, plant)
        return np.concatenate([plant.rates(), other.rates()])

    start = np.concatenate([plant.states, other.states])
    times = np.minimum(np.arange(round(STOP / STEP) + 1) * STEP, STOP)
    nominal = np.array([1e-2, 1e-1, 1e-5, 1e-1, 1e-2])[: len(start)]
    done = solve_ivp(right, (0.0, STOP), start, "BDF", times, rtol=1e-6, atol=1e-8 * nominal)
    assert done.success, done.message
    assert np.abs(done.y[0] - truth(controller)["x"]).max() < allowed
    for part in (plant, other):
        part.fmu.terminate()
        part.fmu.freeInstance()


# -- what makes no sense ---------------------------------------------------------------------


def far_sighted():
    """A controller that asks for a signal which no plant has."""
    return Component(
        "far_sighted",
        "a controller of the distance to the moon",
        inputs=(Input("moon", "m", "distance", role="measurement"),),
        outputs=(Output("u", "V", "command", symbol("moon")),),
    )


@pytest.mark.parametrize("kind", [[], ["--native"]])
def test_a_controller_that_cannot_be_connected_is_one_line(tmp_path, capsys, monkeypatch, kind):
    monkeypatch.setitem(CONTROLLERS, "far_sighted", f"{__name__}:far_sighted")
    monkeypatch.setitem(catalogue.NAMES, "far_sighted", f"{__name__}:far_sighted")
    assert main(["export", "--loop", "far_sighted", *kind, "--out", str(tmp_path)]) == 2
    heard = capsys.readouterr().err
    assert heard.startswith("ballscrew: ")
    assert "no output 'moon'" in heard
    assert heard.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["iool"], "--loop 'iool' is neither one of iol, iol_true_acceleration, nctf, pid, "),
        (["plant"], "--loop 'plant' is neither one of iol"),
        (["../iol"], "--loop '../iol' is neither one of iol"),
        ([""], "--loop '' is neither one of iol"),
        (["iool", "--native"], "--loop 'iool' is neither one of iol"),
        (["iol", "--only", "iol"], "--loop and --only: expected one of them"),
        (["iol", "--ssp"], "--loop and --ssp: expected one of them"),
        (["iol", "--variational"], "--loop and --variational: expected one of them"),
        (["iol", "--fmi", "3"], "--fmi needs --native"),
        (["iol", "--native", "--fmi", "1"], "--fmi is '1', expected one of 2, 3"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(tmp_path, capsys, arguments, said):
    assert main(["export", "--loop", *arguments, "--out", str(tmp_path / "out")]) == 2
    heard = capsys.readouterr().err
    assert heard.startswith(f"ballscrew: {said}")
    assert heard.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", [[], ["--native"]])
def test_an_output_that_cannot_be_written_is_one_line(tmp_path, capsys, kind):
    (tmp_path / "pid_loop.fmu").mkdir()
    assert main(["export", "--loop", "pid", *kind, "--out", str(tmp_path)]) == 2
    heard = capsys.readouterr().err
    assert heard.startswith("ballscrew: cannot write")
    assert heard.count("\n") == 1


@pytest.mark.xdist_group("ziglang")  # which compiles a C library for each platform once
def test_ziglang_makes_the_loop_for_windows_too(tmp_path):
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("needs the package ziglang, which compiles for other platforms")
    arguments = ["--loop", "nctf", "--native", "--platforms", "linux64,win64"]
    assert main(["export", *arguments, "--out", str(tmp_path)]) == 0
    with zipfile.ZipFile(tmp_path / "nctf_loop.fmu") as archive:
        assert archive.read("binaries/win64/nctf_loop.dll")[:2] == b"MZ"
