"""Each command that takes a plant or a controller by name takes both from a file."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from ballscrew.cli import command_parser, main
from ballscrew.fmus.reading import unpack

# The same equations as in the catalogue under names of their own: its results are the oracle.
MINE = """
from dataclasses import replace
from ballscrew.controllers.pid_sampled import pid_sampled
from ballscrew.plant.axis import axis

def law():
    return replace(pid_sampled(), name="my_law")

def body():
    return replace(axis(), name="my_body")
"""
OURS = {"mine.py:law": "pid_sampled", "mine.py:body": "plant"}
CALLED = {"my_law": "pid_sampled", "my_body": "plant"}
LAW, BODY, SENSOR = "mine.py:law", "mine.py:body", "+position_encoder"
LOOP = f"--controller {LAW}{SENSOR} --plant {BODY}"
SHORT = "--stop 0.02 --step 1e-3"
AXES = "--x Kp=200:400:2 --y plant.Fc=0.5:1:2 --stop 0.02 --workers 1"
STUDY = f"""
version = 1
plants = 2
plant = "{BODY}"
instruments = ["position_encoder"]
controllers.p = {{component = "{LAW}", tune = {{Kp = [50.0, 2000.0]}}}}
controllers.q = {{component = "{LAW}", tune = {{}}}}
duty = [
    {{name = "there", reference = "step:size=1e-3", stop = 0.02, tune = true}},
    {{name = "back", reference = "step:size=-1e-3", stop = 0.02}}]
tuning = {{budget = 1, plants = 0, seeds = 1}}
"""
RESULTS = [
    (f"run {LOOP} {SHORT}", "trajectory.csv"),
    (f"swap --controllers {LAW}{SENSOR} iol --plant {BODY} {SHORT}", "comparison.csv"),
    (f"tune --controller pid --plant {BODY} --budget 2", "tuning.json"),
    (f"lyapunov --controller {LAW} --plant {BODY} --stop 0.05", "lyapunov.csv"),
    (f"map {LOOP} {AXES}", "map.csv"),
    (f"map {LOOP} {AXES} --via fmu", "map.csv"),
    ("study study.toml --workers 1", "study.json"),
]
FILES = [
    (f"--component {LAW}{SENSOR} {BODY}", ["my_law+position_encoder.fmu", "my_body.fmu"]),
    (f"--native --fmi 3 --component {LAW} {BODY}", ["my_law.fmu", "my_body.fmu"]),
    (f"--variational --component {BODY}", ["my_body_variational.fmu"]),
    (f"--loop {LAW}{SENSOR} --plant {BODY}", ["my_law+position_encoder_loop.fmu"]),
    (f"--native --loop {LAW}{SENSOR} --plant {BODY}", ["my_law+position_encoder_loop.fmu"]),
    (f"--ssp --component {LAW}{SENSOR} --plant {BODY}", ["my_law+position_encoder.ssp"]),
    (f"--native --ssp --component {LAW} --plant {BODY}", ["my_law.ssp"]),
]
PLACES = {
    "export": {"--component", "--loop", "--plant"},
    "run": {"--controller", "--plant"},
    "swap": {"--controllers", "--plant"},
    "tune": {"--plant"},
    "lyapunov": {"--controller", "--plant"},
    "map": {"--controller", "--plant"},
}


@pytest.fixture(autouse=True)
def mine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(MINE, encoding="utf-8")


def ours(text):
    """The same with the catalogue's names."""
    for own, known in {**OURS, **CALLED}.items():
        text = text.replace(own, known)
    return text


def variables(fmu):
    unpacked = unpack(fmu)
    unpacked.remove()
    return [(v.name, v.causality, v.start, v.unit) for v in unpacked.description.variables]


@pytest.mark.parametrize(("command", "result"), RESULTS)
def test_a_file_s_plant_and_controller_give_the_catalogue_s_results(command, result, monkeypatch):
    # without pyarrow, a map's table is text
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    codes = []
    for out, told in (("own", command), ("known", ours(command))):
        Path("study.toml").write_text(STUDY if out == "own" else ours(STUDY), encoding="utf-8")
        codes.append(main([*told.split(), "--out", out]))
    assert codes[0] == codes[1] in (0, 1)
    own, known = (
        [
            line
            for line in Path(out, result).read_text(encoding="utf-8").splitlines()
            if "fingerprint" not in line
        ]
        for out in ("own", "known")
    )
    assert [ours(line) for line in own] == known  # to the last digit


@pytest.mark.parametrize(("options", "files"), FILES)
def test_a_file_s_plant_and_controller_are_exported_as_the_catalogue_s(options, files, request):
    if "--native" in options:
        request.getfixturevalue("native")  # skips where there is no compiler
    assert main(["export", *options.split(), "--out", "own"]) == 0
    assert main(["export", *ours(options).split(), "--out", "known"]) == 0
    for file in files:
        pair = Path("own", file), Path("known", ours(file))
        if file.endswith(".fmu"):
            assert variables(pair[0]) == variables(pair[1])
            continue
        names = [sorted(zipfile.ZipFile(path).namelist()) for path in pair]
        assert [ours(n) for n in names[0]] == names[1]
        for path, out in zip(pair, ("own", "known"), strict=True):
            assert main(["run", "--system", str(path), *SHORT.split(), "--out", f"{out}_run"]) == 0
        runs = [
            Path(f"{out}_run", "trajectory.csv").read_text(encoding="utf-8")
            for out in ("own", "known")
        ]
        assert runs[0] == runs[1]


@pytest.mark.parametrize("kind", [["--loop"], ["--ssp", "--component"]])
def test_an_exported_loop_is_around_the_plant_that_was_asked_for(kind):
    """Nothing of our plant in it: the plant's friction decides where the block stands."""
    sticky = "axis().with_defaults({'Fc': 2.0, 'Fs': 2.1}, 'measured')"
    Path("mine.py").write_text(MINE.replace("axis()", sticky), encoding="utf-8")
    assert main(["export", *kind, LAW, "--plant", BODY, "--out", "out"]) == 0
    (path,) = (p for p in Path("out").iterdir() if p.suffix in (".fmu", ".ssp"))
    if path.suffix == ".fmu":
        starts = {name: start for name, _, start, _ in variables(path)}
        assert starts["plant_Fc"] == 2.0
        return
    monolithic = ["--coupling", "monolithic", *SHORT.split(), "--out", "loop"]
    assert main(["run", "--controller", LAW, "--plant", BODY, *monolithic]) == 0
    assert main(["run", "--system", str(path), *SHORT.split(), "--out", "system"]) == 0
    loop, system = (
        np.genfromtxt(f"{out}/trajectory.csv", delimiter=",", names=True)["x"]
        for out in ("loop", "system")
    )
    np.testing.assert_allclose(system, loop, rtol=0, atol=1e-9)


def test_no_option_that_takes_a_part_is_left_out_here():
    choices = command_parser()._subparsers._group_actions[0].choices
    found = {
        command: {a.option_strings[0] for a in parser._actions if a.metavar == "PART"}
        for command, parser in choices.items()
    }
    assert {command: places for command, places in found.items() if places} == PLACES
    tried = [f"{command} " for command, _ in RESULTS] + [f"export {o} " for o, _ in FILES]
    for command, options in PLACES.items():
        lines = [line for line in tried if line.startswith(f"{command} ")]
        assert all(any(f"{option} " in line for line in lines) for option in options), command
        assert all("mine.py" in line for line in lines), command


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--component", "pid", "--plant", BODY], "--plant is for --loop and --ssp"),
        (["--loop", "pid", "--plant", "mine.py:no"], "--plant: mine.py has no function 'no'"),
        (["--loop", "pid", "--plant", LAW], "my_law has no output 'x', pid measures it; it has u"),
        (
            ["--ssp", "--component", "pid", "--plant", LAW],
            "pid.fmu: its inputs do not fit the outputs of my_law.fmu",
        ),
        (["--loop", "pid", "--plant", "hand.fmu"], "--plant 'hand.fmu' is neither one of plant"),
    ],
)
def test_a_plant_that_makes_no_sense_is_refused_with_one_line(arguments, line, capsys):
    assert main(["export", *arguments, "--out", "out"]) == 2
    heard = capsys.readouterr().err
    assert line in heard
    assert heard.count("\n") == 1
    assert not [p for p in Path().rglob("*") if p.suffix in (".fmu", ".ssp")]


def test_a_parameter_file_s_plant_goes_around_a_plant_of_a_file():
    """What `run` wrote of a file's plant becomes start values of the loop that is exported."""
    run = ["--controller", LAW, "--plant", BODY, "--set", "plant.Fc=0.9", *SHORT.split()]
    assert main(["run", *run, "--out", "run"]) == 0
    told = ["--params", "run/parameters.toml", "--out", "out"]
    assert main(["export", "--loop", LAW, "--plant", BODY, *told]) == 0
    starts = {name: start for name, _, start, _ in variables("out/my_law_loop.fmu")}
    assert starts["plant_Fc"] == 0.9
