"""Native FMUs in a host of C, and under tools that find wrong memory and undefined behaviour."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from thesis_axis import axis_under

from ballscrew.fmus.native.export import write_native
from ballscrew.orchestration.loop.catalogue import catalogued_model

HOST = Path(__file__).with_name("host.c")
FLAGS = ["-std=c99", "-O1", "-g", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
STEP = 1e-3
DRIVEN = {"plant": ("u", 5.0, ["x", "v", "z", "i"]), "pid_sampled": ("x_d", 0.08, ["u"])}
WINE = "/usr/lib/wine/wine64"  # where Debian puts it without its package of names


def run(*command, env=None):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-6000:]
    return done


def cc():
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if not compiler:
        pytest.skip("needs a C compiler of the system's, such as Debian's gcc, for the host")
    return compiler


@pytest.fixture(scope="module")
def host(tmp_path_factory):
    path = tmp_path_factory.mktemp("host") / "host"
    run(cc(), *FLAGS, "-o", path, HOST, "-ldl")
    return path


def unpacked(path, folder):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder


def arguments(path, folder, name, steps, binary="linux64/{}.so"):
    """Arguments of the host for an FMU that is driven by a constant."""
    description = fmpy.read_model_description(str(path))
    at = {v.name: v.valueReference for v in description.modelVariables}
    driven, value, outputs = DRIVEN[name]
    library = unpacked(path, folder) / "binaries" / binary.format(name)
    head = [library, description.guid, steps, STEP, at[driven], value]
    return head + [at[n] for n in outputs]


def numbers(text):
    return np.array([[float.fromhex(v) for v in line.split()] for line in text.splitlines()])


def test_a_host_in_c_gets_the_solution_of_another_solver(native, host, tmp_path):
    got = numbers(run(host, *arguments(native("plant"), tmp_path, "plant", 100)).stdout)
    exact = axis_under(5.0, np.arange(1, 101) * STEP)[:, :4]
    assert (np.abs(got - exact).max(axis=0) <= 1e-6 * np.ptp(exact, axis=0)).all()


@pytest.mark.ci
@pytest.mark.parametrize("name", DRIVEN)
def test_valgrind_finds_no_wrong_memory_no_leak_and_no_allocation_in_steps(
    native, host, tmp_path, name
):
    if not shutil.which("valgrind"):
        pytest.skip("needs valgrind")
    checked = ["valgrind", "--error-exitcode=9", "--leak-check=full"]
    checked += ["--show-leak-kinds=all", "--errors-for-leak-kinds=all"]
    counts = []
    for steps in (50, 100):
        heard = run(*checked, host, *arguments(native(name), tmp_path, name, steps)).stderr
        counts.append(re.search(r"total heap usage: ([\d,]+) allocs", heard)[1])
    assert counts[0] == counts[1]


@pytest.mark.ci
def test_the_library_needs_nothing_but_the_c_library(native, tmp_path):
    if not shutil.which("objdump"):
        pytest.skip("needs objdump, of Debian's binutils, to list what a library needs")
    folder = unpacked(native("plant"), tmp_path)
    listed = run("objdump", "-p", f"{folder}/binaries/linux64/plant.so").stdout
    needed = set(re.findall(r"NEEDED\s+(\S+)", listed))
    assert needed <= {"libm.so.6", "libc.so.6"}


@pytest.mark.ci
def test_the_sources_in_the_fmu_compile_alone_and_have_no_globals(native, tmp_path):
    """As the model description lists them, without this project and without FMI's own headers."""
    folder = unpacked(native("plant_classical"), tmp_path)
    listed = re.findall(r'<File name="([^"]+)"', (folder / "modelDescription.xml").read_text())
    assert set(listed) == {"fmi2.c"}
    source = folder / "sources" / "fmi2.c"
    built = tmp_path / "fmu.so"
    run(cc(), *FLAGS, "-pedantic", "-fPIC", "-shared", "-o", built, source, "-lm")
    exported = run("nm", "-D", "--defined-only", built).stdout
    assert {line.split()[-1] for line in exported.splitlines()} >= {"fmi2DoStep", "fmi2SetTime"}
    # no position-independent code, where the loader, too, writes to tables of constants
    prefixed = tmp_path / "prefixed.o"
    flags = ["-fno-pic", "-fno-pie", "-DFMI2_FUNCTION_PREFIX=own_", "-c"]
    run(cc(), *FLAGS, *flags, "-o", prefixed, source)
    symbols = [line.split()[-2:] for line in run("nm", prefixed).stdout.splitlines()]
    assert "VARIABLES" in {name for _, name in symbols}
    assert [name for kind, name in symbols if kind in "bBdDcC"] == []
    functions = {name for kind, name in symbols if kind == "T"}
    assert functions
    assert all(name.startswith("own_fmi2") for name in functions)


@pytest.mark.ci
@pytest.mark.parametrize("fmi", [2, 3])
def test_every_function_is_as_the_official_headers_declare_it(native, tmp_path, fmi):
    """The compiler compares, with the headers that fmpy ships in place of our declarations."""
    headers = Path(fmpy.__file__).parent / "c-code"
    sources = unpacked(native("plant", fmi), tmp_path) / "sources"
    (sources / f"fmi{fmi}_declarations.h").write_text(f'#include "fmi{fmi}Functions.h"\n')
    library = tmp_path / "plant.so"
    options = ["-std=c99", f"-I{headers}", "-fPIC", "-shared", "-o", library]
    run(cc(), *options, sources / f"fmi{fmi}.c", "-lm")
    listed = run("nm", "-D", "--defined-only", library)
    declared = (headers / f"fmi{fmi}FunctionTypes.h").read_text()
    needed = set(re.findall(rf"\b(fmi{fmi}\w+)TYPE\b", declared))
    assert needed <= {line.split()[-1] for line in listed.stdout.splitlines()}
    assert len(needed) > 30


@pytest.mark.ci
@pytest.mark.xdist_group("ziglang")  # which compiles a C library for each platform once
def test_a_windows_host_under_wine_gets_the_linux_numbers(native, host, tmp_path):
    wine = shutil.which("wine64") or shutil.which("wine") or shutil.which(WINE)
    if not wine:
        pytest.skip("needs Wine, such as Debian's wine64, to run the Windows binary")
    if not importlib.util.find_spec("ziglang"):
        pytest.skip("needs the package ziglang, which compiles for Windows")
    windows = tmp_path / "host.exe"
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"]
    run(*zig, "-std=c99", "-O1", "-ffp-contract=off", "-o", windows, HOST)
    quiet = os.environ | {"WINEPREFIX": str(tmp_path / "prefix"), "WINEDEBUG": "-all"}
    for name in DRIVEN:
        path = tmp_path / f"{name}.fmu"
        path = write_native(catalogued_model(name), path, 2, ["linux64", "win64"]).path
        here = run(host, *arguments(path, tmp_path / name, name, 100))
        given = arguments(path, tmp_path / name, name, 100, "win64/{}.dll")
        there = numbers(run(wine, windows, *given, env=quiet).stdout)
        expected = numbers(here.stdout)
        assert there.shape == expected.shape
        assert (np.abs(there - expected).max(axis=0) <= 1e-9 * np.ptp(expected, axis=0)).all()
