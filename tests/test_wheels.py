"""Wheels for all platforms: what each is named and what it holds."""

import importlib.util
import os
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from ballscrew.solver.compilers import PLATFORMS

ROOT = Path(__file__).resolve().parents[1]
MACHINES = {  # format and machine, as in the headers that the formats' specifications give
    "linux64": ("ELF", 62),
    "aarch64-linux": ("ELF", 183),
    "win64": ("PE", 0x8664),
    "aarch64-windows": ("PE", 0xAA64),
    "darwin64": ("Mach-O", 0x01000007),
    "aarch64-darwin": ("Mach-O", 0x0100000C),
}
TAGS = {
    "linux64": "manylinux_2_17_x86_64",
    "aarch64-linux": "manylinux_2_17_aarch64",
    "win64": "win_amd64",
    "aarch64-windows": "win_arm64",
    "darwin64": "macosx_11_0_x86_64",
    "aarch64-darwin": "macosx_11_0_arm64",
}
pytestmark = pytest.mark.ci
SUFFIXES = {"ELF": ".so", "PE": ".dll", "Mach-O": ".dylib"}
OWN = (
    "solver/c/libcore",
    "orchestration/master/c/libmaster",
    "measurement/identification/c/libidentification",
)


def run(*command, **how):
    done = subprocess.run(
        [*map(str, command)], capture_output=True, encoding="utf-8", errors="replace", **how
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """``wheel(target)`` is the path of a wheel, built once from a copy of the sources."""
    if not importlib.util.find_spec("ziglang"):
        pytest.skip("needs the package ziglang, which compiles for all platforms")
    folder = tmp_path_factory.mktemp("wheels")
    source = folder / "source"
    leave = shutil.ignore_patterns(
        ".*", "__pycache__", "lib*.so", "out", "build", "*.egg-info", "tests", "proofs", "docs"
    )
    shutil.copytree(ROOT, source, ignore=leave)

    def get(target):
        out = folder / target
        if not out.exists():
            build = [sys.executable, "-P", "-m", "build", "--wheel", "--no-isolation"]
            run(*build, "-C", f"target={target}", "--outdir", out, source)
        (made,) = out.glob("*.whl")
        return made

    return get


def format_of(data):
    """Format and machine of a library."""
    if data[:4] == b"\x7fELF":
        return "ELF", struct.unpack_from("<H", data, 18)[0]
    if data[:2] == b"MZ":
        (start,) = struct.unpack_from("<I", data, 0x3C)
        assert data[start : start + 4] == b"PE\0\0"
        return "PE", struct.unpack_from("<H", data, start + 4)[0]
    assert data[:4] == b"\xcf\xfa\xed\xfe"
    return "Mach-O", struct.unpack_from("<I", data, 4)[0]


@pytest.mark.xdist_group("ziglang")  # which compiles a C library for each platform once
@pytest.mark.parametrize(
    "target",  # others than the first are compiled anew for a minute each
    ["linux64", *(pytest.param(t, marks=pytest.mark.prove) for t in PLATFORMS if t != "linux64")],
)
def test_a_wheel_has_its_tag_and_libraries_for_its_platform(wheel, target):
    made = wheel(target)
    assert made.name.endswith(f"-py3-none-{TAGS[target]}.whl")
    suffix = SUFFIXES[MACHINES[target][0]]
    with zipfile.ZipFile(made) as archive:
        libraries = {n: archive.read(n) for n in archive.namelist() if "/c/lib" in n}
        (about,) = (n for n in archive.namelist() if n.endswith(".dist-info/WHEEL"))
        assert f"Tag: py3-none-{TAGS[target]}" in archive.read(about).decode()
    own = {f"ballscrew/{name}{suffix}": MACHINES[target] for name in OWN}
    carried = {
        f"ballscrew/solver/c/libcore-{other}{SUFFIXES[MACHINES[other][0]]}": MACHINES[other]
        for other in ("linux64", "win64")  # where pythonfmu's FMUs run
        if other != target
    }
    assert {name: format_of(data) for name, data in libraries.items()} == own | carried
    for name, data in libraries.items():
        if "libcore" in name:
            assert b"core_integrate\0" in data
        if data[:4] == b"\x7fELF":  # the tag promises a C library of 2012
            versions = {int(v) for v in re.findall(rb"GLIBC_2\.(\d+)", data)}
            assert versions
            assert max(versions) <= 17


@pytest.mark.xdist_group("ziglang")
def test_a_wheel_holds_every_module_and_every_file_that_they_read(wheel):
    with zipfile.ZipFile(wheel("linux64")) as archive:
        held = {n.removeprefix("ballscrew/") for n in archive.namelist() if "/c/lib" not in n}
    held = {n for n in held if "dist-info/" not in n}
    parts = {p.parent.name for p in ROOT.glob("*/__init__.py")} - {"tests", "proofs"}
    kinds = ("py", "c", "h", "jinja", "json", "csv", "typed", "md")
    files = [p for part in parts for kind in kinds for p in (ROOT / part).rglob(f"*.{kind}")]
    assert held == {str(p.relative_to(ROOT)).removeprefix("ballscrew/") for p in files}


def unpacked(wheel, target, folder):
    with zipfile.ZipFile(wheel(target)) as archive:
        archive.extractall(folder)
    return folder / "ballscrew" / "solver" / "c"


@pytest.mark.xdist_group("ziglang")
def test_a_readable_fmu_takes_the_core_along_for_the_platforms_that_it_runs_on(wheel, tmp_path):
    """Made by the wheel for Linux, which also finds its own core among several."""
    if not sys.platform.startswith("linux") or os.uname().machine != "x86_64":
        pytest.skip("needs Linux on x86-64, where the wheel for it is used")
    folder = unpacked(wheel, "linux64", tmp_path)
    # beside ours, one that cannot be loaded here, which comes first by its name
    (folder / "libcore-aarch64.so").write_bytes(b"\x7fELF of another processor")
    (folder / "libcore.so").rename(folder / "libcore-linux64.so")
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "-m", "ballscrew", "export", "--only", "pid"]
    run(*command, "--out", tmp_path / "fmus", env=environment)
    with zipfile.ZipFile(tmp_path / "fmus" / "pid.fmu") as archive:
        cores = sorted(n for n in archive.namelist() if "/c/libcore" in n)
        archive.extractall(tmp_path / "pid")
    names = ["libcore-aarch64.so", "libcore-linux64.so", "libcore-win64.dll"]
    assert [n.rpartition("/")[2] for n in cores] == names
    package = Path(cores[0]).parts[1]
    code = f"from {package}.solver.core import library; print(library()._name)"
    there = os.environ | {"PYTHONPATH": str(tmp_path / "pid" / "resources"), "PYTHONSAFEPATH": "1"}
    said = run(sys.executable, "-c", code, env=there)
    assert Path(said.strip()).name == "libcore-linux64.so"
