"""FMUs that bring sources and no binary for this platform."""

from __future__ import annotations

import re
import zipfile

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.fmus import source_fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop


@pytest.fixture
def sources_only(native, tmp_path):
    """``sources_only(name, fmi, change)``: without binaries, each file's bytes as changed."""

    def packed(name, fmi=2, change=lambda name, data: data):
        path = tmp_path / f"{name}{fmi}.fmu"
        with zipfile.ZipFile(native(name, fmi)) as good, zipfile.ZipFile(path, "w") as bare:
            for file in good.namelist():
                if not file.startswith("binaries/"):
                    bare.writestr(file, change(file, good.read(file)))
        return path

    return packed


@pytest.mark.ci
@pytest.mark.parametrize("fmi", [2, pytest.param(3, marks=pytest.mark.ci)])
def test_sources_run_as_the_binary_does(native, sources_only, fmi):
    expected = run_closed_loop(
        Loop(str(native("pid", fmi)), str(native("plant", fmi)), stop=0.1, step=1e-3)
    ).run
    study = Loop(
        str(sources_only("pid", fmi)), str(sources_only("plant", fmi)), stop=0.1, step=1e-3
    )
    found = run_closed_loop(study).run
    np.testing.assert_allclose(found.outputs["x"], expected.outputs["x"], rtol=0, atol=1e-12)


def build(old, new):
    def change(name, data):
        return re.sub(old, new, data) if name == "sources/buildDescription.xml" else data

    return change


def broken(name, data):
    return data + b"\nthis is no C;\n" if name == "sources/fmi3.c" else data


@pytest.mark.ci
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (broken, "do not compile: ./sources/fmi3.c:"),
        (build(b'"C99"', b'"C++17"'), "they are in C++17, expected C"),
        (build(b'"fmi3.c"', b'"../../fmi3.c"'), "'../../fmi3.c' is outside their folder"),
        (build(b'"fmi3.c"', b'"other.c"'), "./sources/other.c is not there"),
        (None, "no C compiler was found; install one, or the package ziglang"),
        (build(b'Identifier="pid"', b'Identifier="other"'), "has no binary for this platform"),
    ],
)
def test_sources_that_give_no_library_are_refused_in_one_line(
    tmp_path, capsys, monkeypatch, sources_only, change, message
):
    if change is None:
        monkeypatch.setattr(source_fmu, "compiler_for", lambda name: [])
    path = sources_only("pid", 3, change or (lambda name, data: data))
    assert main(["run", "--controller", str(path), "--out", str(tmp_path / "out")]) == 2
    heard = capsys.readouterr().err
    assert f"{path}: " in heard
    assert message in heard
    assert heard.count("\n") == 1
