"""``mine.py:function`` wherever a command takes a part; its results are those of the catalogue."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import pytest

from ballscrew.cli import main
from ballscrew.fmus.reading import unpack

# The same equations as in the catalogue under names of their own: its results are the oracle.
MINE = """
from dataclasses import replace
from ballscrew.controllers.pid import pid_sampled
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
AXES = "--x Kp=200:400:2 --y plant.Fc=0.5:1:2 --stop 0.02 --workers 2"
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
    (f"run {LOOP} --set plant.Fc=0.9 --set my_law.Kp=250 {SHORT}", "trajectory.csv"),
    (f"swap --controllers {LAW}{SENSOR} iol --plant {BODY} {SHORT}", "comparison.csv"),
    (f"tune --controller pid --plant {BODY} --budget 2", "tuning.json"),
    (f"lyapunov --controller {LAW} --plant {BODY} --stop 0.05", "lyapunov.csv"),
    (f"map {LOOP} {AXES}", "map.csv"),
    ("study study.toml --workers 1", "study.json"),
]
FILES = [
    (f"--component {LAW}{SENSOR} {BODY}", ["my_law+position_encoder.fmu", "my_body.fmu"]),
    (f"--native --fmi 3 --component {LAW} {BODY}", ["my_law.fmu", "my_body.fmu"]),
    (f"--variational --component {BODY}", ["my_body_variational.fmu"]),
    (f"--loop {LAW}{SENSOR} --plant {BODY}", ["my_law+position_encoder_loop.fmu"]),
    (f"--ssp --component {LAW}{SENSOR} --plant {BODY}", ["my_law+position_encoder.ssp"]),
]


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


def first_shown(cases):
    return [cases[0], *(pytest.param(*case, marks=pytest.mark.ci) for case in cases[1:])]


@pytest.mark.parametrize(("command", "result"), first_shown(RESULTS))
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


@pytest.mark.parametrize(("options", "files"), first_shown(FILES))
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
        runs = [Path(f"{out}_run", "trajectory.csv").read_bytes() for out in ("own", "known")]
        assert runs[0] == runs[1]
