"""``mine.py:function`` wherever a command takes a part; its results are those of the catalogue."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import ballscrew
from ballscrew.cli import main
from ballscrew.fmus import catalogue
from ballscrew.fmus.reading import Description, unpack
from ballscrew.orchestration.loop import Loop
from ballscrew.solver import codegen
from ballscrew.solver.component_file import read_component
from ballscrew.stability.map_plan import MapPlan, kernel_of, read_axis

# The same equations as in the catalogue, so that the catalogue's results are the oracle.
MINE = """
from dataclasses import replace
from ballscrew.controllers.pid import pid
from ballscrew.plant.axis import axis
from helper import NAME

def make():
    return replace(pid(), name=NAME)

def body():
    return replace(axis(), name="body")

def deaf():
    made = pid()
    return replace(made, name="deaf", outputs=(replace(made.outputs[0], name="volts"),))

def odd():
    made = pid()
    return replace(made, name="odd", outputs=(replace(made.outputs[0], unit="volt"),))
"""
SHORT = ["--stop", "0.05", "--step", "1e-3"]


@pytest.fixture
def mine(tmp_path, monkeypatch) -> str:
    """The user's file ``a/mine.py``, and one of the same name in ``b``."""
    monkeypatch.chdir(tmp_path)
    for folder in ("a", "b"):
        Path(folder).mkdir()
        Path(folder, "mine.py").write_text(MINE, encoding="utf-8")
        Path(folder, "helper.py").write_text(f"NAME = 'pid_{folder}'\n", encoding="utf-8")
    return "a/mine.py:make"


def description(fmu: str | Path) -> Description:
    unpacked = unpack(fmu)
    unpacked.remove()
    return unpacked.description


def position(file: str) -> np.ndarray:
    return np.genfromtxt(file, delimiter=",", names=True)["x"]


@pytest.mark.parametrize("how", [[], ["--coupling", "monolithic"]])
def test_a_run_of_both_sides_from_a_file_is_that_of_the_catalogue(mine, how, capsys):
    given = ["--set", "plant.Fc=0.9", "--set", "pid_a.Kp=250", *SHORT, *how]
    given_to_ours = [g.replace("pid_a", "pid") for g in given]
    own = ["--controller", mine, "--plant", "b/mine.py:body"]
    assert main(["run", *own, *given, "--out", "own"]) == 0
    assert main(["run", "--controller", "pid", *given_to_ours, "--out", "ours"]) == 0
    assert np.array_equal(position("own/trajectory.csv"), position("ours/trajectory.csv"))
    assert json.loads(Path("own/metrics.json").read_text(encoding="utf-8"))["controller"] == "pid_a"
    # its parameter file goes to the next command
    told = ["--params", "own/parameters.toml", "--out", "again"]
    assert main(["run", *own, *SHORT, *how, *told]) == 0
    assert np.array_equal(position("again/trajectory.csv"), position("own/trajectory.csv"))
    assert capsys.readouterr().err == ""


def test_files_of_one_name_are_told_apart_in_a_comparison(mine):
    controllers = ["--controllers", mine, "b/mine.py:make", "pid"]
    assert main(["swap", *controllers, "--set", "pid_b.Kp=200", *SHORT, "--out", "out"]) == 0
    first, second, ours = (position(f"out/trajectory_{n}.csv") for n in ("pid_a", "pid_b", "pid"))
    assert np.array_equal(first, ours)
    assert not np.array_equal(second, ours)


def test_an_edit_is_seen_at_once_and_what_is_derived_is_kept(mine, monkeypatch):
    def first_command(part: str) -> float:
        return float(ballscrew.run(part, stop=0.01, step=1e-3).run.commands["u"][0])

    before = first_command(mine)
    halved = MINE.replace(
        "replace(pid(), name=NAME)",
        "replace(pid(), name=NAME, outputs=(replace((o := pid().outputs[0]), value=o.value / 2),))",
    )
    Path("a/mine.py").write_text(halved, encoding="utf-8")
    after = first_command(mine)
    assert after == pytest.approx(0.5 * before)
    # the same equations in another file: nothing is derived again
    Path("moved.py").write_text(halved, encoding="utf-8")
    Path("helper.py").write_text("NAME = 'pid_a'\n", encoding="utf-8")
    monkeypatch.setattr(codegen, "generate", None)
    assert first_command("moved.py:make") == after


def test_readable_fmus_have_the_component_s_name_and_the_catalogue_s_variables(mine, capsys):
    parts = [mine, "b/mine.py:body"]
    assert main(["export", "--component", *parts, "--out", "fmus"]) == 0
    assert capsys.readouterr().out.splitlines() == ["fmus/pid_a.fmu", "fmus/body.fmu"]
    for name, ours in (("pid_a", "pid"), ("body", "plant")):
        own, known = (
            [(v.name, v.start, v.unit) for v in description(file).variables]
            for file in (f"fmus/{name}.fmu", catalogue.fmu(ours))
        )
        assert own == known
    assert main(["run", "--controller", "fmus/pid_a.fmu", *SHORT, "--out", "out"]) == 0


def test_a_parameter_file_s_values_become_start_values_of_either_side(mine):
    own = ["--controller", mine, "--plant", "b/mine.py:body", *SHORT]
    given = ["--set", "plant.Fc=0.9", "--set", "controller.Kp=250"]
    assert main(["run", *own, *given, "--out", "run"]) == 0
    parts = ["--component", mine, "b/mine.py:body"]
    assert main(["export", *parts, "--params", "run/parameters.toml", "--out", "fmus"]) == 0
    for name, parameter, value in (("pid_a", "Kp", 250.0), ("body", "Fc", 0.9)):
        starts = {v.name: v.start for v in description(f"fmus/{name}.fmu").variables}
        assert starts[parameter] == value


@pytest.mark.parametrize("via", [[], ["--via", "fmu", "--step", "1e-3"]])
def test_exponents_of_a_file_s_loop_are_the_catalogue_s(mine, via):
    found = []
    for controller, plant, out in ((mine, "b/mine.py:body", "own"), ("pid", "plant", "ours")):
        loop = ["--controller", controller, "--plant", plant, *via]
        arguments = ["lyapunov", *loop, "--stop", "0.5", "--out", out]
        assert main(arguments) in (0, 1)
        found.append(json.loads(Path(out, "lyapunov.json").read_text(encoding="utf-8")))
    assert found[0]["label"] == "pid_a on body"
    assert found[0]["exponents_bits_per_s"] == found[1]["exponents_bits_per_s"]


def test_a_map_over_a_file_s_parameters_is_the_catalogue_s_with_workers_too(mine):
    axes = ["--x", "Kp=200:400:2", "--y", "plant.Fc=0.5:1:2", "--stop", "0.2", "--workers", "2"]
    maps = []
    for controller, out in ((mine, "own"), ("pid", "ours")):
        assert main(["map", "--controller", controller, *axes, "--out", out]) == 0
        maps.append(json.loads(Path(out, "map.json").read_text(encoding="utf-8"))["verdicts"])
    assert maps[0] == maps[1]


def test_workers_of_a_map_take_the_equations_that_it_began_with(mine):
    read_component(mine)
    loop = Loop(mine)
    plan = MapPlan(loop, *(read_axis(t, loop) for t in ("Kp=200:400:2", "Ki=100:200:2")))
    sent, module = pickle.dumps(plan), kernel_of(plan).module
    Path("a/mine.py").unlink()
    assert kernel_of(pickle.loads(sent)).module == module
    assert pickle.loads(sent) == plan


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "--controller", "a/mine.py:mak"], "--controller: a/mine.py has no function 'mak'"),
        (["run", "--controller", "pid", "--plant", "c.py:f"], "--plant: there is no file c.py"),
        (["run", "--controller", "a/mine.py"], "give the function that makes the component"),
        (["run", "--controller", "a/mine.py:odd", *SHORT], "'volt' is not known"),
        (
            ["run", "--controller", "a/mine.py:deaf", *SHORT],
            "nothing is connected to the input 'u' of",
        ),
        (
            ["run", "--controller", "a/mine.py:deaf", "--coupling", "monolithic", *SHORT],
            "deaf has no output 'u', plant needs it",
        ),
        (["swap", "--controllers", "pid", "a/mine.py:mak"], "--controllers: a/mine.py has no func"),
        (
            ["swap", "--controllers", "a/mine.py:make", "./a/mine.py:make"],
            "--controllers: a/mine.py:make and ./a/mine.py:make are both called pid_a; rename one",
        ),
        (["lyapunov", "--controller", "a/mine.py:mak"], "--controller: a/mine.py has no function"),
        (["lyapunov", "--controller", "a/mine.py:deaf"], "deaf has no output 'u', plant needs it"),
        (
            ["map", "--controller", "a/mine.py:deaf", "--x", "Kp=1:2:2", "--y", "Ki=1:2:2"],
            "deaf has no output 'u', plant needs it",
        ),
        (
            ["map", "--controller", "a/mine.py:make", "--x", "Kq=1:2:2", "--y", "Ki=1:2:2"],
            "neither pid_a nor plant has 'Kq'; nearest: ",
        ),
        (["export", "--component", "a/mine.py:mak"], "--component: a/mine.py has no function"),
        (["export", "--component", "a/mine.py:odd"], "'volt' is not known"),
        (["export", "--loop", "a/mine.py:mak"], "--loop: a/mine.py has no function 'mak'"),
        (["export", "--loop", "a/mine.py:deaf"], "deaf has no output 'u', plant needs it"),
        (
            ["export", "--ssp", "--component", "a/mine.py:deaf"],
            "nothing is connected to the input 'u' of",
        ),
        (
            ["export", "--component", "a/mine.py:make", "./a/mine.py:make"],
            "--component: a/mine.py:make and ./a/mine.py:make are both called pid_a; rename one",
        ),
    ],
)
def test_what_makes_no_sense_of_a_file_is_one_line(mine, arguments, said, capsys):
    del mine
    assert main([*arguments, "--out", "out"]) == 2
    heard = capsys.readouterr().err
    assert said in heard
    assert heard.count("\n") == 1


def test_the_public_functions_take_files_too(mine):
    assert ballscrew.component(mine).name == "pid_a"
    assert ballscrew.export(mine, "own.fmu").is_file()
    assert ballscrew.lyapunov(mine, "b/mine.py:body", stop=0.1).label == "pid_a on body"
    compared = ballscrew.swap([mine, Path("b/mine.py:make")], stop=0.02, step=1e-3)
    assert [r.loop.label for r in compared.results] == ["pid_a", "pid_b"]
    with pytest.raises(ValueError, match=r"there is no file c\.py"):
        ballscrew.run("c.py:make")
