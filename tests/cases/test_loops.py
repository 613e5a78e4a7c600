"""Loops of a cart and a PD controller, of which one has a peculiarity."""

import numpy as np
import pytest
import small_fmus as mk
from cases import cart_position, case, trajectory
from fmpy import simulate_fmu

from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.solver.errors import CouplingError

GOAL = "--setpoint 0.1 --stop 0.5"
PAIR = "--controller pd.fmu --plant"
RUN = f"run --no-isolate {PAIR}"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("sources_with_their_own_prefix", f"{PAIR} cart_src.fmu"),
        ("ssp_implementation_model_exchange", "--system me.ssp --step 1e-3"),
        ("step_discarded", f"{PAIR} cart_d.fmu"),
    ],
)
def test_the_cart_goes_where_the_exact_solution_does(tmp_path, command, name, words):
    folder = case(name, tmp_path)
    code, _, said = command(folder, f"run --no-isolate {words} {GOAL} --out out")
    assert code == 0, said
    assert trajectory(folder / "out")["x"][-1] == pytest.approx(cart_position(0.5), rel=1e-3)


def test_an_algebraic_loop_is_solved_at_every_communication_point(tmp_path, command):
    """x = x_s + 0.02 u and u = 25 (0.1 - x) - 8 v, at once: from rest, x = 0.1 / 3."""
    folder = case("algebraic_loop_step_too_long", tmp_path)
    code, _, said = command(folder, f"{RUN} cart_ft.fmu {GOAL} --out out")
    assert code == 0, said
    run = trajectory(folder / "out")
    assert run["x"][0] == pytest.approx(0.1 / 3, abs=1e-12)
    assert run["x"][-1] == pytest.approx(0.06395, abs=1e-4)
    np.testing.assert_allclose(run["u"], 25.0 * (0.1 - run["x"]) - 8.0 * run["v"], atol=1e-10)


def test_an_input_beside_the_command_stays_at_its_start_value_or_at_one_given(tmp_path, command):
    folder = case("disturbance_input_of_plant", tmp_path)
    loop = f"{RUN} cart_ld.fmu {GOAL} --step 1e-3 --out out"
    _, _, said = command(folder, loop)
    assert "note: nothing is connected to the input 'F_load' of cart_ld: it stays at 0" in said
    assert "give it a value" in said
    free = trajectory(folder / "out")["x"][-1]
    assert free == pytest.approx(cart_position(0.5), rel=1e-3)
    code, _, said = command(folder, f"{loop} --set plant.F_load=0.5")
    assert code == 0
    assert "F_load" not in said
    moved = free + 0.2 * cart_position(0.5)  # 0.5 N is 0.02 m of the set-point
    assert trajectory(folder / "out")["x"][-1] == pytest.approx(moved, rel=1e-3)
    code, _, said = command(folder, f"{loop} --set plant.u=1")
    assert code == 2
    assert said.count("\n") == 1
    assert "plant.u is an input that is connected in the loop" in said


def test_every_row_has_the_current_of_its_own_voltage(tmp_path, command):
    """A motor without inductance: R = 2 ohm and a back-EMF of 0.5 V*s/m."""
    folder = case("output_at_start", tmp_path)
    words = f"{RUN} motor.fmu --setpoint 0.1 --stop 0.1 --step 1e-3 --out out"
    code, _, said = command(folder, words)
    assert code == 0, said
    run = trajectory(folder / "out")
    assert (run["u"][0], run["i"][0]) == (2.5, 1.25)
    np.testing.assert_allclose(run["i"], (run["u"] - 0.5 * run["v"]) / 2.0, atol=1e-14)


def test_a_set_point_drives_the_controller_where_a_plant_echoes_x_d(tmp_path, command):
    folder = case("setpoint_taken_by_plant_output", tmp_path)
    words = "cart_uu.fmu --map controller.u=u_in --setpoint 0.1 --stop 0.1 --step 1e-3"
    code, _, said = command(folder, f"{RUN} {words} --out out")
    assert code == 0, said
    path = folder / "out" / "trajectory.csv"
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    assert len(header) == len(set(header))
    table = dict(zip(header, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    np.testing.assert_array_equal(table["x_d"], 0.1)
    np.testing.assert_array_equal(table["plant.x_d"], 88.0)  # its echo
    np.testing.assert_allclose(table["u_in"], 25.0 * (0.1 - table["x"]) - 8.0 * table["v"])


@pytest.mark.ci
def test_one_loop_of_a_cascade_comes_to_its_set_point_in_a_run_a_map_and_an_exported_fmu(
    tmp_path, command
):
    """At rest v_d and a_d are zero, so that x = x_d, but for what friction holds."""
    from pyarrow.parquet import read_table

    part, goal = "cascade.py:cascade", "--stop 3 --setpoint 0.02"
    folder = case("roles_of_set_points", tmp_path)
    assert command(folder, f"run --controller {part} {goal} --step 1e-3 --out r")[0] == 0
    assert trajectory(folder / "r")["x"][-1] == pytest.approx(0.02, abs=1e-4)
    grid = "--x Kpos=7:8:2 --y Kvel=400:410:2 --workers 1"
    assert command(folder, f"map --controller {part} {goal} {grid} --out m")[0] == 0
    left = read_table(folder / "m" / "map.parquet").to_pydict()["final_error"]
    np.testing.assert_allclose(left, 0.0, atol=1e-4)
    assert command(folder, f"export --loop {part} --native --out l")[0] == 0
    (path,) = (folder / "l").glob("*.fmu")
    starts = {"x_d": 0.02}
    end = simulate_fmu(str(path), stop_time=3.0, start_values=starts, output=["x"])["x"][-1]
    assert end == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize(
    ("begins", "unit", "said"),
    [
        (0.0, " [deg]", "ballscrew: the set-point's file has x_d as angle, and the plant's"),
        (100.0, "", "note: the set-point does not change within this run of 0.05 s: its first"),
        (0.0, "", ""),
    ],
)
def test_a_set_point_of_another_quantity_is_refused_and_one_of_another_time_is_told(
    tmp_path, command, begins, unit, said
):
    rows = f"time,x_d{unit}\n{begins},0\n{begins + 1},0.1\n"
    (tmp_path / "motion.csv").write_text(rows)
    words = "run --controller pid --reference motion.csv --stop 0.05 --step 1e-3 --out out"
    code, _, heard = command(tmp_path, words)
    assert code == (2 if unit else 0)
    assert heard.startswith(said)
    assert heard.count("\n") == (said > "")
    assert (tmp_path / "out").exists() == (unit == "")


def test_a_plant_with_one_length_of_step_gets_it(tmp_path, command):
    folder = case("plant_with_fixed_step", tmp_path)
    code, *texts = command(folder, f"{RUN} cart_fx.fmu {GOAL} --out out")
    assert code in (0, 1)
    run = trajectory(folder / "out")
    np.testing.assert_allclose(run["time"], 0.01 * np.arange(51), atol=1e-12)
    assert run["x"][-1] == pytest.approx(cart_position(0.5), rel=2e-2)
    assert "its FMUs take steps of 0.01 s only" in texts[1]
    assert "use shorter communication steps" not in texts[1]  # it takes none


def study(folder, stop=0.5, step=1e-3, controller="pd", plant="cart", **options):
    names = str(folder / f"{controller}.fmu"), str(folder / f"{plant}.fmu")
    return Loop(*names, Reference.constant(0.1), stop=stop, step=step, isolate=False, **options)


def test_two_lengths_of_step_that_differ_are_refused_in_one_line(tmp_path):
    for make, name, step in ((mk.plant, "cart", 0.01), (mk.pd, "pd", 0.02)):
        exp = f'<DefaultExperiment stepSize="{step}"/>'
        make(str(tmp_path / f"{name}.fmu"), varstep=False, exp=exp)
    with pytest.raises(CouplingError, match=r"cart\.fmu of 0\.01 s and pd\.fmu of 0\.02 s"):
        run_closed_loop(study(tmp_path, step=None))


@pytest.mark.parametrize(
    ("attributes", "scale", "bias"),
    [
        ("", 1.0, 8_388_608.0),  # an absolute encoder, far from 0 at rest
        ('nominal="1"', 1e6, 0.0),  # counts; some tools write this always
        pytest.param('nominal="1e-6"', 1.0, 0.0, marks=pytest.mark.ci),  # less than what is moved
    ],
)
def test_an_output_that_is_large_at_rest_does_not_diverge(tmp_path, attributes, scale, bias):
    mk.plant(str(tmp_path / "cart.fmu"), xa=attributes, scale=scale, bias=bias)
    mk.pd(str(tmp_path / "pd.fmu"), scale=1 / scale, bias=bias / scale)
    result = run_closed_loop(study(tmp_path))
    moved = (result.run.outputs["x"][-1] - bias) / scale
    assert result.trusted
    assert moved == pytest.approx(cart_position(0.5), rel=2e-3)


STRICT = "if(t+h>stop)return 3;"


@pytest.mark.parametrize(
    ("saves", "in_step"),
    [
        (False, False),
        *(pytest.param(*p, marks=pytest.mark.ci) for p in ((False, True), (True, False))),
    ],
)
def test_fmus_that_refuse_a_step_behind_the_stop_time(tmp_path, saves, in_step):
    """5e-4 s does not divide 5 s exactly: a short last step would end a unit of round-off later.

    A controller that answers in its step is not tried beyond the end either.
    """
    mk.plant(str(tmp_path / "cart.fmu"), saves=saves, step=STRICT + mk.PLANT_STEP)
    law = "$u$=25.0*($x_d$-$x$)-8.0*$v$;"
    body = {"out": "", "step": STRICT + law, "init": law} if in_step else {"step": STRICT}
    mk.pd(str(tmp_path / "pd.fmu"), saves=saves, **body)
    for stop, step in ((5.0, 5e-4), (0.3, 7e-4), (0.7, 1e-3), (0.35, 3.1e-4)):
        run = run_closed_loop(study(tmp_path, stop, step)).run
        assert not run.stopped
        assert run.verdict.trusted or in_step  # one that answers in its step is late by one
        assert run.time[-1] == stop
        assert run.outputs["x"][-1] == pytest.approx(cart_position(stop), rel=5e-3)


@pytest.mark.ci
@pytest.mark.parametrize("lost", [False, True])
def test_state_that_an_fmu_keeps_elsewhere(tmp_path, lost):
    """An integral in the instance is saved with it, one in a variable of the library is not."""
    name = "lost" if lost else "kept"
    where = "static double w;" if lost else "double w=S[3];"
    step = f"{where} w+=h*($x_d$-$x$); S[3]=w; $u$=25*($x_d$-$x$)-8*$v$+5*w;"
    mk.plant(str(tmp_path / "cart.fmu"))
    mk.pd(str(tmp_path / f"{name}.fmu"), name=name, out="", step=step, init="$u$=2.5;")
    result = run_closed_loop(study(tmp_path, controller=name))
    said = "lost.fmu declares that it can save its state but does not restore it correctly"
    assert any(note.startswith(said) for note in result.notes) == lost
    assert not result.run.stopped
