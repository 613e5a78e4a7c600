"""Values of FMUs: what is set is allowed, and what a run tells is what its FMUs have."""

import math

import pytest
import small_fmus
from case_inputs import system
from cases import cart_position, case, trajectory

from ballscrew.orchestration.fmu.isolated import IsolatedInstance, open_fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import SystemLoop
from ballscrew.orchestration.loop.parameter_file import read_parameters

PAIR = "--controller pd.fmu --plant cart.fmu"
GOAL = "--setpoint 0.1 --stop 0.5 --step 1e-3 --out"
M = 'start="1.0"'  # of the parameter m in the description of the cart


@pytest.fixture
def folder(tmp_path):
    small_fmus.plant(str(tmp_path / "cart.fmu"))
    small_fmus.pd(str(tmp_path / "pd.fmu"))
    return tmp_path


def edited(folder, *changes):
    small_fmus.edited(str(folder / "cart.fmu"), *changes)


@pytest.mark.parametrize("loop", [PAIR, "--system s.ssp"])
def test_differences_of_temperatures_are_converted_without_the_offset(tmp_path, command, loop):
    """10 T' = 20 (30 - T) - 2 T."""
    folder = case("units_relative_quantity", tmp_path)
    words = f"run --no-isolate {loop} --setpoint 30 --stop 2 --step 1e-3 --out out"
    code, _, said = command(folder, words)
    assert code == 0, said
    exact = 600 / 22 * -math.expm1(-2.2 * 2.0)
    assert trajectory(folder / "out")["x"][-1] == pytest.approx(exact, rel=1e-3)


BOUND = """<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
version="1.0" name="p"><ssv:Parameters>
<ssv:Parameter name="m"><ssv:Real value="7"/></ssv:Parameter></ssv:Parameters>
</ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"""


@pytest.mark.parametrize(
    ("loop", "inside", "told"),
    [
        (f"{PAIR} --set plant.m=-1", "", "m = -1 kg is out of its range [0.1, 5]"),
        ("--system s.ssp --set plant.m=5.1", "", "m = 5.1 kg is out of its range [0.1, 5]"),
        ("--system s.ssp", BOUND, "m = 7 kg is out of its range [0.1, 5]"),
    ],
)
def test_a_value_that_the_fmu_does_not_allow_is_refused(folder, command, loop, inside, told):
    edited(folder, (M, f'{M} unit="kg" min="0.1" max="5"'))
    system(folder, "s.ssp", inside=inside)
    code, _, said = command(folder, f"run --no-isolate {loop} {GOAL} out")
    assert (code, said.count("\n")) == (2, 1)
    assert told in said


def test_an_item_that_an_enumeration_does_not_have_is_refused(folder, command):
    items = '<Item name="slow" value="1"/><Item name="fast" value="2"/>'
    kind = f'<SimpleType name="Pace"><Enumeration>{items}</Enumeration></SimpleType>'
    before = f"<TypeDefinitions>{kind}</TypeDefinitions><ModelVariables>"
    pace = '<Enumeration declaredType="Pace" start="1"'
    edited(folder, ("<ModelVariables>", before), (f"<Real {M}", pace))
    code, _, said = command(folder, f"run --no-isolate {PAIR} --set plant.m=3 {GOAL} out")
    assert code == 2
    assert "plant.m is 3, expected one of slow (1), fast (2)" in said


@pytest.mark.parametrize("how", ["--no-isolate", pytest.param("", marks=pytest.mark.ci)])
def test_a_start_value_that_only_the_description_has_is_set_and_told(folder, command, how):
    """The library starts with m = 1; what a run writes down gives the same run again."""
    edited(folder, (M, 'start="3.0"'))
    code, _, said = command(folder, f"run {how} {PAIR} {GOAL} out")
    assert code == 0, said
    assert "cart.fmu starts with m = 1, but its description says 3: this was set" in said
    x = trajectory(folder / "out")["x"][-1]
    assert x == pytest.approx(cart_position(0.5, m=3.0), rel=2e-3)
    told = f"run {how} {PAIR} --params out/parameters.toml {GOAL} again"
    assert command(folder, told)[0] == 0
    courses = [(folder / out / "trajectory.csv").read_bytes() for out in ("out", "again")]
    assert courses[0] == courses[1]


@pytest.mark.parametrize("how", ["--no-isolate", pytest.param("", marks=pytest.mark.ci)])
@pytest.mark.parametrize("given", ["", "--set plant.m=3"])
def test_a_value_that_the_library_does_not_take_is_told_as_what_it_has(folder, command, given, how):
    """Its m is 2, whatever is set, and so is the motion."""
    small_fmus.plant(str(folder / "cart.fmu"), more_out="$m$ = 2.0;")
    edited(folder, (M, 'start="3.0"'))
    code, _, said = command(folder, f"run {how} {PAIR} {given} {GOAL} out")
    assert code == 0, said
    told = "it does not take the given 3" if given else "description says 3: this cannot be set"
    assert told in said
    x = trajectory(folder / "out")["x"][-1]
    assert x == pytest.approx(cart_position(0.5, m=2.0), rel=2e-3)
    assert read_parameters(folder / "out" / "parameters.toml").plant["m"].value == 2.0
    system(folder, "s.ssp")
    loop = SystemLoop(folder / "s.ssp", stop=0.5, step=1e-3, isolate=False, values={"plant.m": 3.0})
    result = run_closed_loop(loop)
    assert result.loop.values == {"plant.m": 2.0}
    assert any("it does not take the given 3" in note for note in result.notes)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (M, 'start="NaN"', "the start value of 'm' is 'NaN', expected a finite number"),
        (M, 'start="1e999"', "the start value of 'm' is '1e999', expected a finite number"),
        (M, f'{M} min="NaN"', "the min of 'm' is 'NaN', expected a number"),
        (M, f'{M} min="5" max="1"', "m has the min 5 above its max 1"),
        ('name="d"', 'name="d&#10;e"', "the name 'd\\ne' has a line break"),
    ],
)
def test_a_description_with_impossible_values_is_refused(folder, command, old, new, told):
    edited(folder, (old, new))
    code, _, said = command(folder, f"run --no-isolate {PAIR} {GOAL} out")
    assert (code, said.count("\n")) == (2, 1)
    assert told in said


def test_an_fmu_that_allows_one_instance_in_a_process_has_a_process_for_each(folder):
    edited(folder, (" modelId", ' canBeInstantiatedOnlyOncePerProcess="true" modelId'))
    instance = open_fmu(folder / "cart.fmu", "plant", isolate=False)
    instance.close()
    assert isinstance(instance, IsolatedInstance)


def test_a_controller_that_measures_nothing_is_refused_in_a_system_too(folder, command):
    system(folder, "s.ssp", without="x v")
    code, _, said = command(folder, f"run --no-isolate --system s.ssp {GOAL} out")
    assert code == 2
    assert "nothing is connected to the input pd.x" in said
    system(folder, "s.ssp", without="v")
    _, _, said = command(folder, f"run --no-isolate --system s.ssp {GOAL} out")
    assert "nothing is connected to the input 'v' of pd: it stays at 0" in said


@pytest.mark.ci
@pytest.mark.parametrize("isolate", ["--isolate", "--no-isolate"])
def test_a_state_that_cannot_be_saved_costs_only_the_saved_states(
    folder, command, monkeypatch, isolate
):
    whole = "fmi2GetFMUstate(Part *part, void **kept) {"
    monkeypatch.setattr(small_fmus, "_C", small_fmus._C.replace(whole, whole + "return 3;"))
    small_fmus.plant(str(folder / "cart.fmu"))
    code, _, said = command(folder, f"run {isolate} {PAIR} {GOAL} out")
    assert code == 0, said
    assert "cart.fmu declares that it can save its state but does not" in said
    x = trajectory(folder / "out")["x"][-1]
    assert x == pytest.approx(cart_position(0.5), rel=1e-3)


ENDS = """*ended = S[7] > 0; return S[7] < 0 ? 3 : 0; }
API int fmi2GetRealStatus(Part *part, int kind, double *at) { *at = S[7]; return 0;"""
LAST = small_fmus.PLANT_STEP + "S[7]=t+h>0.5-1e-9?t+h:0; if(S[7]>0)return 2;"


@pytest.mark.parametrize(
    ("step", "stop", "told"),
    [
        ("S[7]=-1;return 2;", 0.5, "rejects the step because it is too long"),
        (LAST, 0.5, "trusted"),
        (LAST, 0.6, "cart.fmu): requested the end of the simulation at t = 0.5 s"),
    ],
)
def test_a_discarded_step_is_judged_alike_with_and_without_a_process_of_its_own(
    step, stop, told, folder, command, monkeypatch
):
    """It may be the last one; or too long, also if the FMU does not answer which."""
    source = small_fmus._C.replace("*ended = 0; return 0;", ENDS)
    monkeypatch.setattr(small_fmus, "_C", source)
    monkeypatch.setattr(small_fmus, "_REFUSED", small_fmus._REFUSED.replace("GetRealStatus ", ""))
    small_fmus.plant(str(folder / "cart.fmu"), step=step)
    run = f"run {PAIR} {GOAL} out --stop {stop}"
    both = [command(folder, f"{run} {how}") for how in ("--isolate", "--no-isolate")]
    assert both[0] == both[1]
    assert told in "".join(both[0][1:])
