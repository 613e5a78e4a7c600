"""A machine of one's own, by its parameter file: it runs, and what is written is read again."""

from __future__ import annotations

import json
import re

import fmpy
import numpy as np
import pytest
from case_inputs import karnopp_step
from diagnosed import run
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew import Loop, read_parameters
from ballscrew import run as run_loop

MACHINE = """
kind = "drive"
law = "lugre"

[plant]
m = 40.0
gain = 100.0
offset = 15.0
sigma0 = 1e7
sigma1 = 2e4
sigma2 = 200.0
Fc = 80.0
Fs = 110.0
Vs = 0.01

[controller.pid]
Kp = 400.0
Ki = 300.0
Kd = 60.0
"""
SET_POINT, STOP = 0.02, 0.5


def integrated(time):
    """The same loop, written down again and solved by SciPy."""

    def rate(_, y):
        x, v, z, w = y
        u = 400.0 * (SET_POINT - x) + 300.0 * w - 60.0 * v
        g = 80.0 + 30.0 * np.exp(-((v / 0.01) ** 2))
        dz = v - 1e7 * abs(v) * z / g
        friction = 1e7 * z + 2e4 * dz + 200.0 * v
        return [v, (100.0 * u - friction - 15.0) / 40.0, dz, SET_POINT - x]

    solver = {"method": "Radau", "rtol": 1e-9, "atol": 1e-13}
    return solve_ivp(rate, (0.0, STOP), [0.0] * 4, t_eval=time, **solver).y[0]


TURNS = 'command = "torque"' + MACHINE.replace('"drive"', '"rotary_drive"').replace("m = ", "J = ")


PUSHED = 'command = "force"' + MACHINE


@pytest.mark.parametrize(
    ("text", "units", "unit_of_inertia"),
    [
        (PUSHED, {"x": "m", "v": "m/s", "friction": "N", "u": "N", "Kp": "N/m"}, "kg"),
        (TURNS, {"x": "rad", "v": "rad/s", "friction": "N*m", "u": "N*m"}, "kg*m^2"),
    ],
    ids=["drive", "body that turns"],
)
def test_a_machine_runs_as_scipy_solves_it_and_its_run_writes_it_again(
    tmp_path, text, units, unit_of_inertia
):
    path = tmp_path / "machine.toml"
    path.write_text(text, encoding="utf-8")
    told = read_parameters(path)
    values = {n: v.value for n, v in told.plant.items()}
    gains = {n: v.value for n, v in told.controllers["pid"].items()}
    loop = Loop("pid", told.plant_name, SET_POINT, STOP, values, gains, file=told, step=1e-4)
    found = run_loop(loop).run
    assert found.outputs["x"] == pytest.approx(integrated(found.time), abs=2e-8)
    unit_of_gain = units.pop("Kp", "N*m/rad")
    assert {n: found.units[n] for n in units} == units
    loop.parameters().save(tmp_path / "again")
    again = read_parameters(tmp_path / "again" / "parameters.toml")
    assert (again.kind, again.command, again.law) == (told.kind, told.command, "lugre")
    (inertia,) = {"m", "J"} & set(again.plant)
    assert (again.plant[inertia].value, again.plant[inertia].unit) == (40.0, unit_of_inertia)
    assert again.controllers["pid"]["Kp"].unit == unit_of_gain
    assert {n: v.value for n, v in again.plant.items()}.items() >= values.items()
    assert {n: v.value for n, v in again.controllers["pid"].items()}.items() >= gains.items()


@pytest.mark.parametrize(
    ("command", "unit"), [pytest.param("current", "A", marks=pytest.mark.ci), ("force", "N")]
)
def test_fmus_of_a_machine_have_the_unit_of_its_command(tmp_path, command, unit):
    """Plant and controller alike, so that other tools connect them without a conversion."""
    path = tmp_path / "machine.toml"
    path.write_text(f'command = "{command}"' + MACHINE, encoding="utf-8")
    names, out = ("drive_lugre", "pid"), tmp_path / "fmus"
    assert run("export", "--only", *names, "--params", path, "--out", out)[0] == 0
    units = {}
    for name in names:
        for v in fmpy.read_model_description(str(out / f"{name}.fmu")).modelVariables:
            units[name, v.name] = v.unit
    assert units["drive_lugre", "u"] == units["pid", "u"] == unit
    assert units["drive_lugre", "gain"] == f"N/{unit}"
    assert units["pid", "Kp"] == f"{unit}/m"


def write_record(path, more=lambda x, v: 0.0, seed=3):
    """Eight seconds of a screw of 40 kg, typed by hand: its torque and place, noise of 1 N."""
    time = np.arange(0.0, 8.0, 1e-3)
    x = 0.1 * np.sin(2.0 * time) + 0.01 * np.sin(9.0 * time)
    v = 0.2 * np.cos(2.0 * time) + 0.09 * np.cos(9.0 * time)
    a = -0.4 * np.sin(2.0 * time) - 0.81 * np.sin(9.0 * time)
    force = 40.0 * a + 80.0 * np.sign(v) + 200.0 * v + more(x, v)
    force += np.random.default_rng(seed).standard_normal(len(time))
    table = np.column_stack([time, 1e3 * x, force * LEAD / (2 * np.pi)])
    np.savetxt(path, table, delimiter=",", header="t,place,torque", comments="")
    return path


def periodic(x, v):
    """Friction that swings by 12 N with every 20 mm."""
    return 12.0 * np.sign(v) * np.cos(2.0 * np.pi * x / 0.02)


LEAD = 0.005


def screw(command):
    """How a program reads a record of a screw: its torque is this column of ours."""
    mapping = {"t": "time", "place": "x", "torque": command}
    return {"mapping": mapping, "units": {"time": "s", "x": "mm", command: "N*m"}, "lead": LEAD}


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The folder of what is identified from a record of torque and position alone."""
    top = tmp_path_factory.mktemp("own")
    record = write_record(top / "record.csv")
    ballscrew.identify(record, "classical", mass=40.0, **screw("force")).save(top, False)
    return top


def test_what_is_identified_from_a_record_of_ones_own_is_a_whole_machine(identified):
    """The mass is given, the command is the torque; what no record can show has an estimate."""
    file = read_parameters(identified / "parameters.toml")
    assert (file.kind, file.command, file.plant["m"].value) == ("drive", "torque", 40.0)
    gain = file.plant["gain"]
    assert (gain.value, gain.unit) == (pytest.approx(2 * np.pi / 0.005), "N/(N*m)")
    assert file.plant["Fc"].value == pytest.approx(80.0, rel=0.02)
    assert file.plant["sigma2"].value == pytest.approx(200.0, rel=0.05)
    assert set(file.not_identified) == {"Fs", "Vs"}  # this friction has no peak at break-away
    assert file.plant["Vs"].source.startswith("an estimate, not identified from ")


@pytest.mark.ci
def test_friction_that_is_larger_backwards_is_identified_compared_and_diagnosed_so(tmp_path):
    record, other = (
        write_record(tmp_path / f"{seed}.csv", lambda x, v: -12.0 * (v < 0), seed)
        for seed in (3, 4)
    )
    law = "directional_classical"
    ballscrew.identify(record, law, mass=True, **screw("force")).save(tmp_path, False)
    file = read_parameters(tmp_path / "parameters.toml")
    found = [file.plant[n].value for n in ("m", "Fc_pos", "Fc_neg", "sigma2_pos")]
    assert found == pytest.approx([40.0, 80.0, 92.0, 200.0], rel=0.05)
    models = ballscrew.compare(other, file.path, **screw("u")).models
    assert models["model"]["all"].force.value == pytest.approx(np.sqrt(0.5), rel=0.02)
    assert ballscrew.diagnose(other, file.path, **screw("u")).verdict == "none"


def test_the_next_record_of_an_identified_machine_is_compared_and_diagnosed(identified, tmp_path):
    """A healthy one has no fault; of one whose friction swings that is named, with its size."""
    given = ["--params", identified / "parameters.toml"]  # its gain is 2 pi/lead
    given += (
        "--map t=time --map place=x --map torque=u --unit time=s --unit x=mm --unit u=N*m"
    ).split()
    healthy = write_record(tmp_path / "healthy.csv", seed=4)
    swings = write_record(tmp_path / "swings.csv", periodic, seed=5)
    code, printed, _ = run("compare", healthy, *given, "--json")
    assert code == 0
    left = json.loads(printed)["models"]["model"]["all"]["force"]["value_N"]
    # of the white noise of 1 N, the half that lies within the band that is compared
    assert left == pytest.approx(np.sqrt(0.5), rel=0.02)

    def told(record):
        code, printed, _ = run(
            "diagnose", record, *given, "--json", "--out", tmp_path / record.stem
        )
        assert code == 0
        assert "nctf" not in printed
        return json.loads(printed)

    healthy = told(healthy)
    assert (healthy["verdict"], healthy["causes"]) == ("none", [])
    (cause,) = told(swings)["causes"]
    assert cause["name"] == "position_periodic_friction"
    size = max(abs(v) for n, v in cause["parameters"].items() if n.startswith("friction_cos"))
    assert size == pytest.approx(12.0 / 80.0, rel=0.1)


def karnopp(stop, goal, backwards, step=4e-6):
    """Positions of a screw with stiction and its controller, each 1 ms, by own integration."""
    x = v = w = 0.0
    places = [x]
    for k in range(round(stop / step)):
        force = 2e5 * (goal - x) + 1e6 * w - 4e3 * v
        w += step * (goal - x)
        x, v = karnopp_step(x, v, force, step, 40.0, 80.0, backwards)
        if (k + 1) % round(1e-3 / step) == 0:
            places.append(x)
    return np.array(places)


SAME = {"Fc": 80.0, "Fs": 1.28 * 80.0, "sigma2": 260.0, "Vs": 0.012}
EACH = {f"{n}_pos": v for n, v in SAME.items()} | {f"{n}_neg": v for n, v in SAME.items()}
EACH |= {"Fc_neg": 92.0, "Fs_neg": 1.28 * 92.0}


@pytest.mark.parametrize(
    ("law", "own", "goal", "backwards"),
    [
        pytest.param("classical", SAME, 0.02, 1.0, marks=pytest.mark.ci),
        ("directional_classical", EACH, -0.02, 1.15),
    ],
)
def test_a_drive_that_comes_to_rest_by_classical_friction_is_trusted_and_is_right(
    law, own, goal, backwards
):
    """Whether it sticks already or still moves differs at one point, and hid that all else fits."""
    gains = {"Kp": 2e5, "Ki": 1e6, "Kd": 4e3}
    result = run_loop(Loop("pid", f"drive_{law}+force", goal, 0.8, {"m": 40.0, **own}, gains))
    assert result.run.verdict.trusted
    found = np.interp(1e-3 * np.arange(801), result.run.time, result.run.outputs["x"])
    assert found == pytest.approx(karnopp(0.8, goal, backwards), abs=5e-6)
    assert result.run.outputs["stuck"].max() == 1.0


@pytest.mark.ci
def test_inertia_and_friction_of_a_body_that_turns_come_from_its_record(tmp_path):
    """Eight seconds of a joint, typed by hand in degrees and N*m; written as such a body again."""
    time = np.arange(0.0, 8.0, 1e-3)
    angle = 1.2 * np.sin(2.0 * time) + 0.1 * np.sin(9.0 * time)
    v = 2.4 * np.cos(2.0 * time) + 0.9 * np.cos(9.0 * time)
    a = -4.8 * np.sin(2.0 * time) - 8.1 * np.sin(9.0 * time)
    torque = 0.5 * a + 2.0 * np.sign(v) + 1.5 * v
    torque += 0.02 * np.random.default_rng(4).standard_normal(len(time))
    record, head = tmp_path / "record.csv", "time [s],angle [deg],torque [N*m]"
    table = np.column_stack([time, np.degrees(angle), torque])
    np.savetxt(record, table, delimiter=",", header=head, comments="")
    start, out = tmp_path / "joint.toml", tmp_path / "out"
    start.write_text('kind = "rotary_drive"\ncommand = "torque"\n[plant]\ngain = 1.0\n')
    columns = ("--map", "angle=x", "--map", "torque=force", "--params", start)
    fit = ("--law", "classical", "--mass", "fit", "--fix", "Vs=0.01", "--out", out)
    code, printed, said = run("identify", record, *columns, *fit)
    assert code in (0, 1)
    assert "here N means N*m" not in said
    assert re.search(r"^J .* kg\*m\^2$", printed, re.MULTILINE)
    assert re.search(r"^unexplained .* N\*m$", printed, re.MULTILINE)
    file = read_parameters(out / "parameters.toml")
    assert (file.kind, file.command) == ("rotary_drive", "torque")
    assert file.plant["J"].value == pytest.approx(0.5, rel=0.01)
    assert file.plant["J"].unit == "kg*m^2"
    assert file.plant["Fc"].value == pytest.approx(2.0, rel=0.02)
    assert file.plant["sigma2"].unit == "N*m*s/rad"
