"""A machine of one's own, by its parameter file: it runs, and what is written is read again."""

from __future__ import annotations

import json

import numpy as np
import pytest
from diagnosed import run
from scipy.integrate import solve_ivp

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


@pytest.fixture
def machine(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(MACHINE, encoding="utf-8")
    return path


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


def test_a_drive_runs_as_scipy_solves_it(machine):
    told = read_parameters(machine)
    loop = Loop(
        "pid",
        told.plant_name,
        SET_POINT,
        STOP,
        {n: v.value for n, v in told.plant.items()},
        {n: v.value for n, v in told.controllers["pid"].items()},
        step=1e-4,
    )
    found = run_loop(loop).run
    assert found.outputs["x"] == pytest.approx(integrated(found.time), abs=2e-8)


def test_the_file_that_a_run_writes_is_the_machine_again(machine, tmp_path):
    """And nothing is said of the nominal axis' amplifier, which this machine does not have."""
    out = tmp_path / "out"
    loop = ("--controller", "pid", "--stop", "0.5", "--set", "controller.Kp=4e4")
    code, _, said = run("run", *loop, "--step", "1e-3", "--params", machine, "--out", out)
    assert code in (0, 1)
    assert "amplifier" not in said
    before, after = (read_parameters(p) for p in (machine, out / "parameters.toml"))
    assert (after.kind, after.law) == ("drive", "lugre")
    values = {n: v.value for n, v in after.plant.items()}
    assert values.items() >= {n: v.value for n, v in before.plant.items()}.items()


RANDOM = np.random.default_rng(3)


def write_record(path, more=lambda x, v: 0.0):
    """Eight seconds of a screw of 40 kg, typed by hand: force and position, with noise of 1 N."""
    time = np.arange(0.0, 8.0, 1e-3)
    x = 0.1 * np.sin(2.0 * time) + 0.01 * np.sin(9.0 * time)
    v = 0.2 * np.cos(2.0 * time) + 0.09 * np.cos(9.0 * time)
    a = -0.4 * np.sin(2.0 * time) - 0.81 * np.sin(9.0 * time)
    force = 40.0 * a + 80.0 * np.sign(v) + 200.0 * v + more(x, v)
    table = np.column_stack([time, x, force + RANDOM.standard_normal(len(time))])
    np.savetxt(path, table, delimiter=",", header="time,x,force", comments="")
    return path


def periodic(x, v):
    """Friction that swings by 12 N with every 20 mm."""
    return 12.0 * np.sign(v) * np.cos(2.0 * np.pi * x / 0.02)


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The folder of what is identified from a record of force and position alone."""
    top = tmp_path_factory.mktemp("own")
    record, out = write_record(top / "record.csv"), top / "identified"
    code, *_ = run(
        "identify", record, "--law", "classical", "--mass", "40", "--fix", "Vs=0.01", "--out", out
    )
    assert code in (0, 1)
    return out


def test_what_is_identified_from_records_of_ones_own_is_a_machine(identified):
    """Records of force and position are of a drive: the mass is theirs, the command the force."""
    file = read_parameters(identified / "parameters.toml")
    assert (file.kind, file.plant["m"].value, file.plant["gain"].value) == ("drive", 40.0, 1.0)
    assert file.plant["Fc"].value == pytest.approx(80.0, rel=0.02)
    assert file.plant["sigma2"].value == pytest.approx(200.0, rel=0.05)


def test_an_identified_machine_runs_and_is_exported(identified, tmp_path):
    given = ("--params", identified / "parameters.toml")
    loop = ("--controller", "pid", "--stop", "0.1", "--out", tmp_path / "run")
    assert run("run", *loop, *given)[0] == 0
    one = ("--only", "drive_classical", "--out", tmp_path / "fmus")
    assert run("export", *one, *given)[0] == 0
    assert (tmp_path / "fmus" / "drive_classical.fmu").is_file()


def test_the_next_record_of_an_identified_machine_is_diagnosed(identified, tmp_path):
    """A healthy one has no fault; of one whose friction swings that is named, with its size."""
    given = ("--params", identified / "parameters.toml", "--map", "force=u", "--unit", "u=N")

    def told(name, more=lambda x, v: 0.0):
        record = write_record(tmp_path / f"{name}.csv", more)
        code, printed, _ = run("diagnose", record, *given, "--json", "--out", tmp_path / name)
        assert code == 0
        assert "nctf" not in printed
        return json.loads(printed)

    healthy, swings = told("healthy"), told("swings", periodic)
    assert (healthy["verdict"], healthy["causes"]) == ("none", [])
    assert [c["name"] for c in swings["causes"]] == ["position_periodic_friction"]
    (cause,) = swings["causes"]
    size = max(abs(v) for n, v in cause["parameters"].items() if n.startswith("friction_cos"))
    assert size == pytest.approx(12.0 / 80.0, rel=0.1)
