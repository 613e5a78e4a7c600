"""FMUs as the command writes them, in the processes of hosts; those that bring sources only."""

from __future__ import annotations

import importlib.util
import re
import stat
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import replace

import pytest
from any_fmu import Host, python, repacked
from fmpy.validation import validate_fmu

from ballscrew.cli import main
from ballscrew.controllers import CONTROLLERS
from ballscrew.fmus import carried_runtime, source_fmu
from ballscrew.fmus.native.export import NativeFmu
from ballscrew.orchestration.loop.catalogue import NAMES, component, fmu, fmu_kernel
from ballscrew.part_api import Export
from ballscrew.solver import compilers
from ballscrew.solver.kernel import Model
from ballscrew.stability import lyapunov_over_fmus
from ballscrew.stability.lyapunov_over_fmus import NATIVE, READABLE, ready_fmu


def export(*arguments):
    return main(["export", *map(str, arguments)])


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setattr(compilers.shutil, "which", lambda _: None)
    monkeypatch.setattr(compilers.importlib.util, "find_spec", lambda _: None)


@pytest.mark.parametrize(
    ("arguments", "some", "count"),
    [
        ("", {"plant.fmu", "iol.fmu", "nctf.fmu", "pid.fmu"}, 4),
        ("--ssp", {"iol.ssp", "nctf.ssp", "pid.ssp"}, 3),
        ("--all", {"plant_dahl.fmu", "p_pi.fmu", "position_encoder.fmu"}, len({*NAMES})),
        ("--all --ssp", {"iol.ssp", "p_pi.ssp"}, len(CONTROLLERS)),
    ],
)
def test_what_is_written_if_nothing_is_named(tmp_path, monkeypatch, arguments, some, count):
    written = []

    def write(self, part, path, folder):
        written.append(path.name)
        return NativeFmu(path, (), ())

    monkeypatch.setattr(Export, "write", write)
    assert export(*arguments.split(), "--out", tmp_path) == 0
    assert some <= {*written}
    assert len({*written}) == len(written) == count


def test_what_is_named_is_written_with_sources_binary_and_documentation(native, tmp_path, capsys):
    assert export("--native", "--only", "plant", "nctf", "--out", tmp_path) == 0
    written_to = [str(tmp_path / name) for name in ("plant.fmu", "nctf.fmu")]
    assert capsys.readouterr().out.split() == written_to
    assert sorted(map(str, tmp_path.glob("*.fmu"))) == sorted(written_to)
    with zipfile.ZipFile(tmp_path / "plant.fmu") as archive:
        names = set(archive.namelist())
    assert {"modelDescription.xml", "sources/fmi2.c", "documentation/index.html"} <= names
    assert len([n for n in names if n.startswith("binaries/")]) == 1
    assert not [n for n in names if n.endswith(".py")]
    assert export("--ssp", "--native", "--only", "nctf", "--out", tmp_path / "ssp") == 0
    with zipfile.ZipFile(tmp_path / "ssp" / "nctf.ssp") as archive:
        for side in ("plant", "controller"):
            with zipfile.ZipFile(archive.open(f"resources/{side}.fmu")) as fmu:
                assert "sources/fmi2.c" in fmu.namelist()


def test_without_a_compiler_there_are_sources_only_and_a_line_says_so(
    no_compiler, tmp_path, capsys
):
    options = ["--native", "--only", "pid", "--platforms", "linux64,win64"]
    assert export(*options, "--out", tmp_path) == 0
    heard = capsys.readouterr().err.strip()
    assert heard.count("\n") == 0
    assert "no C compiler for linux64, win64, so it contains sources only" in heard
    assert "ziglang" in heard
    with zipfile.ZipFile(tmp_path / "pid.fmu") as archive:
        assert "sources/fmi2.c" in archive.namelist()
        assert not [n for n in archive.namelist() if n.startswith("binaries/")]
    assert validate_fmu(str(tmp_path / "pid.fmu")) == []


def test_a_readable_one_names_the_platform_that_it_is_for_where_no_other_can_be_compiled(
    no_compiler, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(carried_runtime, "_in_package", lambda: ["linux64"])
    assert export("--only", "pid", "--out", tmp_path) == 0
    heard = capsys.readouterr().err.strip()
    assert "no C compiler for win64, so it contains binaries for linux64; install" in heard


def test_a_compiler_that_fails_is_quoted_in_one_block_and_nothing_is_written(
    native, tmp_path, capsys, monkeypatch
):
    folder = tmp_path / "bin"
    folder.mkdir()
    command = folder / "cc"
    command.write_text("#!/bin/sh\necho 'first word' >&2\necho 'second word' >&2\nexit 4\n")
    command.chmod(command.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}:/bin:/usr/bin")
    assert export("--native", "--only", "pid", "--out", tmp_path / "out") == 2
    heard = capsys.readouterr().err
    assert heard.startswith("ballscrew: cc does not compile pid for ")
    assert heard.endswith("says:\nfirst word\nsecond word\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("arguments", [["--native", "--only", "pid"], ["--loop", "pid"]])
def test_an_output_that_cannot_be_written_is_one_line(native, tmp_path, capsys, arguments):
    for name in ("pid", "pid_loop"):
        (tmp_path / f"{name}.fmu").mkdir()
    assert export(*arguments, "--out", tmp_path) == 2
    heard = capsys.readouterr().err
    assert heard.startswith("ballscrew: cannot write")
    assert heard.count("\n") == 1


@pytest.mark.parametrize(
    "more",
    [
        [],
        pytest.param(["--native"], marks=pytest.mark.ci),
        pytest.param(["--native", "--fmi", "3"], marks=pytest.mark.ci),
        pytest.param(["--ssp"], marks=pytest.mark.ci),
    ],
)
def test_export_is_reproducible_byte_for_byte(tmp_path, more):
    code = "import sys; from ballscrew.cli import main; sys.exit(main(sys.argv[1:]))"
    command = ["export", *more, "--only", "nctf", "--out"]
    assert main([*command, str(tmp_path / "here")]) == 0
    done = subprocess.run(
        [sys.executable, "-c", code, *command, str(tmp_path / "there")],
        capture_output=True,
        text=True,
        cwd=tempfile.gettempdir(),
    )
    assert done.returncode == 0, done.stderr
    here, there = ([*(tmp_path / place).iterdir()] for place in ("here", "there"))
    assert [p.read_bytes() for p in here] == [p.read_bytes() for p in there]


def test_a_native_fmu_is_made_once_and_a_readable_one_taken_where_nothing_compiles(
    native, monkeypatch, tmp_path
):
    made = ready_fmu("pid")
    assert made[1] == NATIVE
    monkeypatch.setattr(lyapunov_over_fmus, "compiler_for", lambda _: [])
    assert ready_fmu("pid") == made  # it is there already
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path))
    assert ready_fmu("pid") == (fmu("pid"), READABLE)


@pytest.mark.ci
@pytest.mark.xdist_group("ziglang")  # which compiles a C library for each platform once
def test_ziglang_makes_binaries_for_windows_and_macos_here(tmp_path):
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("needs the package ziglang, which compiles for other platforms")
    options = ["--native", "--platforms", "linux64,win64,darwin64"]
    assert export(*options, "--loop", "pid", "--out", tmp_path) == 0
    with zipfile.ZipFile(tmp_path / "pid_loop.fmu") as archive:
        library = archive.read("binaries/win64/pid_loop.dll")
        assert library[:2] == b"MZ"
        assert b"fmi2DoStep" in library
        assert archive.read("binaries/darwin64/pid_loop.dylib")[:4] == b"\xcf\xfa\xed\xfe"
        assert archive.read("binaries/linux64/pid_loop.so")[:4] == b"\x7fELF"
    assert (tmp_path / "pid_loop.fmu").stat().st_size < 3 * 100_000
    assert export("--only", "pid", "--out", tmp_path) == 0
    with zipfile.ZipFile(tmp_path / "pid.fmu") as archive:
        (core,) = (n for n in archive.namelist() if n.endswith("/c/libcore-win64.dll"))
        assert archive.read(core)[:2] == b"MZ"


@pytest.mark.ci
def test_a_hundred_instances_of_two_fmus_live_in_one_process_which_ends_without_a_crash(fmus):
    """pythonfmu 0.7 frees the slave's namespace from the second instance on; ours survive.

    It corrupts the heap at exit, too, seen in 13 of 20 processes.
    """
    code = """
        from any_fmu import Host
        hosts = [Host(sys.argv[1 + k % 2], name=f"i{k}") for k in range(100)]
        for host in hosts:
            host.step(0.0, 1e-3)
        for host in hosts:
            host.fmu.terminate()
            host.close()
        print("done")
    """
    for _ in range(3):
        assert python(code, fmus["plant"], fmus["nctf"]) == "done\n"


def test_an_older_version_of_the_same_fmu_runs_beside_the_newer(written):
    """Same model name, other equations: each keeps its own code."""
    new = component("pid")
    doubled = replace(new.outputs[0], value=2 * new.outputs[0].value)
    answers = []
    for part in (new, replace(new, outputs=(doubled,)), new):
        host = Host(written(part, "readable"), {"x_d": 0.08})
        answers += host.get("u")
        host.close()
    assert answers[0] != 0.0
    assert answers[1] == pytest.approx(2 * answers[0], rel=1e-12)
    assert answers[2] == answers[0]


def test_an_fmu_needs_neither_this_project_nor_sympy(fmus):
    code = """
        for name in ("sympy", "ballscrew", "scipy", "matplotlib"):
            sys.modules[name] = None
        import fmpy
        r = fmpy.simulate_fmu(sys.argv[1], stop_time=0.02, output_interval=1e-3,
                              start_values={"u": 20.0})
        assert not any(m == "ballscrew" or m.startswith("ballscrew.") for m, v in
                       sys.modules.items() if v is not None)
        print(float(r["x"][-1]))
    """
    model = Model(fmu_kernel("plant"))
    model.set_input("u", 20.0)
    model.advance(0.0, 0.02)
    expected = model.outputs(0.02, model.x)["x"]
    assert float(python(code, fmus["plant"])) == pytest.approx(expected, rel=1e-9)


def test_without_a_core_for_the_platform_it_fails_in_one_line(fmus, tmp_path):
    code = """
        from any_fmu import Host
        host = Host(sys.argv[1])
        print(host.get("x"), host.message())
        try:
            host.step(0.0, 1e-3)
        except Exception as error:
            print(type(error).__name__)
        host.fmu.freeFMUState(host.fmu.getFMUState())
        host.close()
    """
    bare = tmp_path / "plant.fmu"
    repacked(fmus["plant"], bare, lambda name, data: None if "/c/libcore" in name else data)
    said, ended = python(code, bare).splitlines()
    assert said.startswith("[nan] instance: ")
    assert "no compiled solver for this platform, linux" in said
    assert ended == "FMICallException"


# -- FMUs that bring sources and no binary for this platform; that they run: the Reference FMUs ----


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
    tmp_path, capsys, monkeypatch, native, change, message
):
    if change is None:
        monkeypatch.setattr(source_fmu, "compiler_for", lambda name: [])

    def without_binaries(name, data):
        return None if name.startswith("binaries/") else change(name, data) if change else data

    path = repacked(native("pid", 3), tmp_path / "pid3.fmu", without_binaries)
    assert main(["run", "--controller", str(path), "--out", str(tmp_path / "out")]) == 2
    heard = capsys.readouterr().err
    assert f"{path}: " in heard
    assert message in heard
    assert heard.count("\n") == 1
