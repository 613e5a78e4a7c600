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
from fmu_host import opened
from wired_loop import wired

from ballscrew.fmus.native.export import write_native
from ballscrew.fmus.native.sources import catalogued_model

HOST = Path(__file__).with_name("host.c")
FLAGS = ["-std=c99", "-O1", "-g", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
STEP = 1e-4
OUTPUTS = ("x", "v", "i", "friction")
WINE = "/usr/lib/wine/wine64"  # where Debian puts it without its package of names


def run(*command):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
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


def arguments(folder, native, names, steps, library=None):
    """Arguments of the host for a loop with the law wired; `library` finds an FMU's binary."""
    paths = [native(name) for name in names]
    loop = wired(*paths, STEP, steps * STEP, law=True)
    given, references = [], []
    for name, path in zip(names, paths, strict=True):
        description = fmpy.read_model_description(str(path))
        references.append({v.name: v.valueReference for v in description.modelVariables})
        if library is None:
            unpacked = Path(fmpy.extract(str(path), unzipdir=str(folder / name)))
            given += [unpacked / "binaries" / "linux64" / f"{name}.so", description.guid]
        else:
            given += [library(name), description.guid]
    number = {"plant": 0, "controller": 1}
    lines = [
        f"w {number[a]} {references[number[a]][x]} {number[b]} {references[number[b]][y]}"
        for (a, x), (b, y) in loop.connections
    ]
    lines += [f"s {number[n]} {references[number[n]][v]} {x!r}" for n, v, x in loop.starts]
    lines += [f"o {references[0][name]}" for name in OUTPUTS]
    wiring = folder / "wiring"
    wiring.write_text("\n".join(lines) + "\n")
    return [*given, wiring, steps, STEP]


def numbers(text):
    return np.array([[float.fromhex(v) for v in line.split()] for line in text.splitlines()])


@pytest.mark.parametrize("controller", ["nctf", "iol"])
def test_a_host_in_c_gets_the_numbers_of_the_same_loop_of_python_fmus(
    fmus, native, host, tmp_path, controller
):
    steps = 2000
    got = numbers(run(host, *arguments(tmp_path, native, ["plant", controller], steps)).stdout)
    loop = wired(fmus["plant"], fmus[controller], STEP, steps * STEP, law=True)
    parts = {name: opened(path, name=name) for name, path in loop.fmus.items()}
    for name, variable, value in loop.starts:
        slave, at = parts[name]
        slave.setReal([at[variable]], [value])

    def exchange():
        values = [parts[a][0].getReal([parts[a][1][x]]) for (a, x), _ in loop.connections]
        for (_, (b, y)), value in zip(loop.connections, values, strict=True):
            parts[b][0].setReal([parts[b][1][y]], value)

    exchange()
    rows = []
    for k in range(steps):
        exchange()
        for slave, _ in parts.values():
            slave.doStep(k * STEP, STEP)
        slave, at = parts["plant"]
        rows.append(slave.getReal([at[n] for n in OUTPUTS]))
    assert got.shape == (steps, len(OUTPUTS))
    assert (np.abs(got - rows).max(axis=0) <= 1e-9 * np.ptp(rows, axis=0)).all()


def test_the_library_needs_nothing_but_the_c_library(native, tmp_path):
    if not shutil.which("objdump"):
        pytest.skip("needs objdump, of Debian's binutils, to list what a library needs")
    folder = fmpy.extract(str(native("plant")), unzipdir=str(tmp_path))
    listed = run("objdump", "-p", f"{folder}/binaries/linux64/plant.so").stdout
    needed = set(re.findall(r"NEEDED\s+(\S+)", listed))
    assert needed <= {"libm.so.6", "libc.so.6"}


@pytest.mark.parametrize("controller", ["nctf", "pid_sampled"])
def test_valgrind_finds_no_wrong_memory_and_no_leak(native, host, tmp_path, controller):
    if not shutil.which("valgrind"):
        pytest.skip("needs valgrind")
    checked = ["valgrind", "--quiet", "--error-exitcode=9", "--leak-check=full"]
    checked += ["--show-leak-kinds=all", "--errors-for-leak-kinds=all"]
    done = run(*checked, host, *arguments(tmp_path, native, ["plant", controller], 100))
    assert "==" not in done.stderr


def test_no_step_allocates_memory(native, host, tmp_path):
    """Twice the steps, the same number of allocations, of host and FMUs together."""
    if not shutil.which("valgrind"):
        pytest.skip("needs valgrind")
    counts = []
    for steps in (50, 100):
        folder = tmp_path / str(steps)
        folder.mkdir()
        given = arguments(folder, native, ["plant_classical", "pid_sampled"], steps)
        heard = run("valgrind", host, *given).stderr
        counts.append(re.search(r"total heap usage: ([\d,]+) allocs", heard)[1])
    assert counts[0] == counts[1]


def test_there_are_no_globals_that_instances_could_share(native, tmp_path):
    with zipfile.ZipFile(native("plant_classical")) as archive:
        archive.extractall(tmp_path)
    built = tmp_path / "fmu.o"
    # no position-independent code, where the loader, too, writes to tables of constants
    source = tmp_path / "sources" / "fmi2.c"
    run(cc(), *FLAGS, "-fno-pic", "-fno-pie", "-c", "-o", built, source)
    symbols = [line.split()[-2:] for line in run("nm", built).stdout.splitlines()]
    assert "VARIABLES" in {name for _, name in symbols}
    assert [name for kind, name in symbols if kind in "bBdDcC"] == []


@pytest.mark.parametrize("names", [("plant", "nctf"), ("plant_classical", "pid_sampled")])
def test_the_sanitizers_find_no_undefined_behaviour(native, tmp_path, names):
    options = ["-fsanitize=undefined", "-fno-sanitize-recover=all"]
    probe = tmp_path / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    if subprocess.run([cc(), *options, "-o", tmp_path / "probe", probe]).returncode:
        pytest.skip("needs a compiler with the undefined-behaviour sanitizer")

    def library(name):
        folder = tmp_path / f"{name}-sources"
        with zipfile.ZipFile(native(name)) as archive:
            archive.extractall(folder)
        built = folder / f"{name}.so"
        source = folder / "sources" / "fmi2.c"
        run(cc(), *FLAGS, *options, "-fPIC", "-shared", "-o", built, source, "-lm")
        return built

    host = tmp_path / "host"
    run(cc(), *FLAGS, *options, "-o", host, HOST, "-ldl")
    done = run(host, *arguments(tmp_path, native, list(names), 300, library))
    assert "runtime error" not in done.stderr
    assert len(done.stdout.splitlines()) == 300


def test_the_sources_in_the_fmu_compile_alone_and_give_the_same_library(native, tmp_path):
    """As the model description lists them, without this project and without FMI's own headers."""
    path = native("plant")
    with zipfile.ZipFile(path) as archive:
        listed = re.findall(r'<File name="([^"]+)"', archive.read("modelDescription.xml").decode())
        archive.extractall(tmp_path)
    assert set(listed) == {"fmi2.c"}
    sources = [tmp_path / "sources" / name for name in sorted(set(listed))]
    built = tmp_path / "plant.so"
    run(cc(), *FLAGS, "-pedantic", "-fPIC", "-shared", "-o", built, *sources, "-lm")
    exported = run("nm", "-D", "--defined-only", built).stdout
    assert {line.split()[-1] for line in exported.splitlines()} >= {"fmi2DoStep", "fmi2SetTime"}
    prefixed = tmp_path / "prefixed.o"
    run(cc(), *FLAGS, "-DFMI2_FUNCTION_PREFIX=plant_", "-c", "-o", prefixed, *sources)
    names = {
        line.split()[-1] for line in run("nm", "-g", "--defined-only", prefixed).stdout.splitlines()
    }
    assert names
    assert all(n.startswith("plant_fmi2") for n in names)


def wine():
    found = shutil.which("wine64") or shutil.which("wine") or shutil.which(WINE)
    if not found:
        pytest.skip("needs Wine, such as Debian's wine64, to run the Windows binary")
    return found


@pytest.mark.xdist_group("ziglang")  # which compiles a C library for each platform once
@pytest.mark.parametrize("controller", ["nctf", "pid_sampled"])
def test_a_windows_host_under_wine_gets_the_linux_numbers(native, tmp_path, controller):
    program = wine()
    if not importlib.util.find_spec("ziglang"):
        pytest.skip("needs the package ziglang, which compiles for Windows")
    windows = tmp_path / "host.exe"
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"]
    run(*zig, "-std=c99", "-O1", "-ffp-contract=off", "-o", windows, HOST)

    def library(name):
        path = tmp_path / f"{name}.fmu"
        written = write_native(catalogued_model(name), path, 2, ["linux64", "win64"])
        unpacked = Path(fmpy.extract(str(written.path), unzipdir=str(tmp_path / name)))
        return unpacked / "binaries" / "win64" / f"{name}.dll"

    names, steps = ["plant", controller], 500
    host = tmp_path / "host"
    run(cc(), *FLAGS, "-o", host, HOST, "-ldl")
    (tmp_path / "linux").mkdir()
    here = numbers(run(host, *arguments(tmp_path / "linux", native, names, steps)).stdout)
    quiet = {"WINEPREFIX": str(tmp_path / "prefix"), "WINEDEBUG": "-all"}
    given = [str(a) for a in arguments(tmp_path, native, names, steps, library)]
    done = subprocess.run(
        [program, str(windows), *given],
        capture_output=True,
        text=True,
        env=os.environ | quiet,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    there = numbers(done.stdout)
    assert there.shape == here.shape == (steps, 4)
    assert (np.abs(there - here).max(axis=0) <= 1e-9 * np.ptp(here, axis=0)).all()
