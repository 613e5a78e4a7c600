"""FMUs that are not FMI 2.0 co-simulation of real signals, as the master takes them."""

import math
import re
import zipfile
from fractions import Fraction

import numpy as np
import pytest
import small_fmus
from reference_fmus import reference_fmu

from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.fmu.model_exchange import Integrator
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.master.couplings import Coupling

STOP, STEP = 0.3, 1e-3


def course(plant, controller, **options):
    options = {"step": STEP, "stop": STOP, **options}
    run = run_closed_loop(Loop(str(controller), str(plant), **options)).run
    assert not run.stopped
    return run, run.outputs | run.commands


@pytest.mark.parametrize(
    ("controller", "isolate"),
    [("pid_sampled", False), pytest.param("iol", True, marks=pytest.mark.ci)],
)
def test_fmi_3_runs_as_fmi_2_does(native, controller, isolate):
    other, expected = course(native("plant"), native(controller))
    run, found = course(native("plant", 3), native(controller, 3), isolate=isolate)
    assert run.coupling is other.coupling
    assert run.verdict.trusted == other.verdict.trusted
    assert run.step_range == other.step_range
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-12)


@pytest.fixture
def described(native, tmp_path):
    """``described(name, fmi, old, new)``: the native FMU with its description changed."""

    def packed(name, fmi, old, new):
        path = tmp_path / f"{name}{fmi}.fmu"
        with zipfile.ZipFile(native(name, fmi)) as given, zipfile.ZipFile(path, "w") as other:
            for file in given.namelist():
                data = given.read(file)
                if file == "modelDescription.xml":
                    data = re.sub(old, new, data, flags=re.DOTALL)
                other.writestr(file, data)
        return path

    return packed


@pytest.fixture
def exchanged(described):
    """``exchanged(name, fmi)`` is the native FMU for model exchange only."""
    element = rb"<CoSimulation[^>]*/>|<CoSimulation.*?</CoSimulation>"
    return lambda name, fmi=2: described(name, fmi, element, b"")


@pytest.mark.ci
@pytest.mark.parametrize(
    ("step", "stop"),
    [(STEP, 0.06), (STEP / 4, 0.01), pytest.param(STEP, STOP, marks=pytest.mark.prove)],
)
@pytest.mark.parametrize(("plant", "fmi"), [("plant", 2), ("plant_classical", 3)])
def test_model_exchange_runs_as_co_simulation_does(native, exchanged, fmi, plant, step, stop):
    """A sampled controller by its time events, dry friction by its state events.

    With shorter steps than the sampling period a sample has to be taken at the instant itself.
    """
    asked = {"step": step, "stop": stop}
    held = {"coupling": Coupling.GAUSS_SEIDEL, **asked}
    _, expected = course(native(plant), native("pid_sampled"), **held)
    _, found = course(exchanged(plant, fmi), exchanged("pid_sampled", fmi), **asked)
    np.testing.assert_allclose(found["x"], expected["x"], rtol=0, atol=1e-8)


@pytest.mark.ci
def test_a_controller_for_model_exchange_reports_its_law(native, exchanged):
    _, expected = course(native("plant"), native("iol"))
    run, found = course(native("plant"), exchanged("iol", 3))
    assert run.coupling is Coupling.INTERFACE_JACOBIAN
    np.testing.assert_allclose(found["x"], expected["x"], rtol=0, atol=1e-12)


@pytest.mark.ci
@pytest.mark.parametrize("fmi", [2, 3])
def test_model_exchange_goes_on_from_a_saved_state_as_before(exchanged, fmi):
    plant = FmuInstance(exchanged("plant_classical", fmi), "plant")
    plant.initialize({}, 1.0)
    read, write = plant.reader(["x", "v", "i"]), plant.writer(["u"])
    write(np.array([5.0]))
    plant.step(0.0, 0.01)
    state, before = plant.save(), read()
    courses = []
    for _ in range(2):
        write(np.array([3.0]))
        for k in range(1, 5):
            plant.step(k * 0.01, 0.01)
        courses.append(read())
        plant.restore(state)
        np.testing.assert_array_equal(read(), before)
    plant.release(state)
    plant.close()
    np.testing.assert_array_equal(*courses)


@pytest.mark.ci
@pytest.mark.parametrize("isolate", [True, False])
def test_integer_and_boolean_signals_are_the_numbers_they_are(tmp_path, isolate):
    """A plant that says whether it is near, and an FMU that passes this on as its command."""
    plant, controller = str(tmp_path / "cart.fmu"), str(reference_fmu(tmp_path, "Feedthrough", 2))
    small_fmus.plant(plant, more=[("near", "output", None, "")], more_out="$near$ = S[0] < 0.02;")
    how = {"stop": 0.6, "step": 0.01, "coupling": Coupling.GAUSS_SEIDEL, "isolate": isolate}
    courses = []
    for kind in ("Float64_continuous", "Int32", "Boolean"):
        mapping = {f"{kind}_input": "near", f"{kind}_output": "u", "Float64_discrete_input": "x_d"}
        run = run_closed_loop(Loop(controller, plant, mapping=mapping, **how)).run
        assert not run.stopped
        assert set(run.commands["u"]) == {0.0, 1.0}
        courses.append(run.outputs["x"])
    np.testing.assert_array_equal(courses[1:], [courses[0]] * 2)


class Ticking:
    """A model-exchange FMU without states that counts at times, which it compares exactly."""

    def __init__(self, period):
        self.period, self.time, self.next, self.count = period, 0.0, period, 0

    def setTime(self, time):
        self.time = time

    def updateDiscreteStates(self):
        if self.time >= self.next:
            self.count, self.next = self.count + 1, self.next + self.period
        return False, False, False, False, True, self.next

    def completedIntegratorStep(self):
        return False, False

    def __getattr__(self, name):  # the rest of FMI 3.0
        return lambda *_: None


@pytest.mark.parametrize("period", [0.1, 0.025, 0.0007])
@pytest.mark.parametrize("driven", [True, False])
def test_a_time_event_comes_at_its_own_time_to_the_last_digit(period, driven):
    """Of an FMU with inputs, one at a communication point belongs to the next step."""
    fmu = Ticking(period)
    master = Integrator(fmu, 0, 0, driven)
    for k in range(1, 71):
        master.step((k - 1) * 1e-2, k * 1e-2)
        periods = Fraction(k, 100) / Fraction(str(period))
        assert fmu.count == (math.ceil(periods) - 1 if driven else math.floor(periods))


@pytest.mark.ci
def test_another_name_of_a_port_connects_it(native, described):
    """Aliases of FMI 3.0."""

    def renamed(found):
        return b'<Float64 name="my_%b"%b><Alias name="%b"/></Float64>' % (*found.groups(), found[1])

    _, expected = course(native("plant"), native("pid", 3))
    other = described("pid", 3, rb'<Float64 name="(x|u)"([^>]*?) ?/>', renamed)
    _, found = course(native("plant"), other)
    np.testing.assert_allclose(found["x"], expected["x"], rtol=0, atol=1e-9)
    _, found = course(native("plant"), other, mapping={"my_u": "u", "controller.x": "x"})
    np.testing.assert_allclose(found["x"], expected["x"], rtol=0, atol=1e-9)
