"""Installs the wheel under every other Python that is found, runs it there, and exchanges FMUs.

Interpreters are those that ``PYTHONS`` names (paths, separated as in ``PATH``), those on ``PATH``
by their usual names, and those that pyenv lists. Each gets an empty environment with the wheel.
What it computes is compared with what the Python that runs this script computes, in whose
environment this package is installed. Prints a table; exit code 1 if anything failed.
"""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
OWN = f"{sys.version_info.major}.{sys.version_info.minor}"
LONGEST = 400.0  # s, for one step
CLOSE = 1e-9  # of the range of each signal
SIMULATE = """
import sys, fmpy
r = fmpy.simulate_fmu(sys.argv[1], stop_time=0.02, output_interval=1e-3, start_values={"u": 20.0})
print(",".join(r.dtype.names))
for row in r:
    print(",".join(repr(float(value)) for value in row))
"""
RUNS = {"run": ("0.2", "trajectory.csv"), "lyapunov": ("2", "lyapunov.csv")}
FMUS = {"readable": [], "native": ["--native"]}
COLUMNS = ["install", *RUNS]
COLUMNS += [f"{kind} FMU {way}" for kind in FMUS for way in ("from", "to")]

Rows = list[dict[str, str]]


def words(*command: str | Path, cwd: Path | None = None) -> str:
    """What a command prints; raises RuntimeError with the end of it where it fails."""
    done = subprocess.run(
        [*map(str, command)],
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        timeout=LONGEST,
        cwd=cwd,
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
    )
    if done.returncode:
        raise RuntimeError((done.stderr or done.stdout).strip()[-600:] or "no word")
    return done.stdout


def found() -> dict[str, str]:
    """An interpreter for each version that is there."""
    listed = [p for p in os.environ.get("PYTHONS", "").split(os.pathsep) if p]
    listed += [path for v in VERSIONS if (path := shutil.which(f"python{v}"))]
    if pyenv := shutil.which("pyenv"):
        for name in words(pyenv, "versions", "--bare").split():
            listed.append(str(Path(words(pyenv, "prefix", name).strip(), "bin", "python")))
    known: dict[str, str] = {}
    ask = "import sys; print('%d.%d' % sys.version_info[:2])"
    for path in listed:
        try:
            version = words(path, "-c", ask).strip()
        except (OSError, RuntimeError, subprocess.TimeoutExpired):
            continue  # such as a name of pyenv's for a version that is not in use
        if version in VERSIONS:
            known.setdefault(version, path)
    return known


def rows_of(text: str) -> Rows:
    return list(csv.DictReader(text.splitlines()))


def compared(ours: Rows, theirs: Rows) -> str:
    """``same`` to the last bit, or how far apart; raises RuntimeError if that is too far."""
    if len(ours) != len(theirs) or not ours or ours[0].keys() != theirs[0].keys():
        raise RuntimeError(f"{len(theirs)} rows, expected {len(ours)} of the same signals")
    worst = 0.0
    for name in ours[0]:
        a, b = ([float(row[name]) for row in rows] for rows in (ours, theirs))
        size = max(a) - min(a) or max(map(abs, a)) or 1.0
        worst = max(worst, *(abs(x - y) / size for x, y in zip(a, b, strict=True)))
    if not worst <= CLOSE:
        raise RuntimeError(f"{worst:.1e} of a signal's range away")
    return "same" if worst == 0 else f"{worst:.0e}"


def computed(python: str | Path, name: str, folder: Path) -> Rows:
    """What the installed package of an interpreter computes by a command."""
    stop, table = RUNS[name]
    command = [name, "--controller", "nctf", "--stop", stop, "--out", folder / name]
    words(python, "-P", "-m", "ballscrew", *command, cwd=folder)
    return rows_of((folder / name / table).read_text("utf-8"))


def exported(python: str | Path, kind: str, folder: Path) -> Path:
    command = ["export", "--only", "plant", *FMUS[kind], "--out", folder / kind]
    words(python, "-P", "-m", "ballscrew", *command)
    return folder / kind / "plant.fmu"


def simulated(python: str | Path, fmu: Path) -> Rows:
    """By fmpy alone, so that a readable FMU runs in Python."""
    return rows_of(words(python, "-P", "-c", SIMULATE, fmu, cwd=fmu.parent))


def answer(column: str, path: str, folder: Path, ours: dict[str, Rows]) -> str:
    """What a column says of an interpreter; `folder` is beside ``own`` and the wheel."""
    python = folder / "env" / "bin" / "python"
    kind, _, way = column.partition(" FMU ")
    if column == "install":
        words(path, "-m", "venv", python.parents[1])
        pins = ["--constraint", TOP / "constraints.txt"]
        words(python, "-m", "pip", "install", "--quiet", *pins, *folder.parent.glob("*.whl"))
        return "yes"
    if column in RUNS:
        return compared(ours[column], computed(python, column, folder))
    if way == "from":
        fmu = folder.parent / "own" / kind / "plant.fmu"
        return compared(ours[kind], simulated(python, fmu))
    return compared(ours[kind], simulated(sys.executable, exported(python, kind, folder)))


def row_of(version: str, path: str, folder: Path, ours: dict[str, Rows]) -> tuple[list[str], str]:
    """The columns of an interpreter, and its faults, one a line."""
    row, faults = {}, ""
    for column in COLUMNS:
        try:
            row[column] = (
                "-" if row.get("install") == "FAILED" else answer(column, path, folder, ours)
            )
        except (RuntimeError, OSError, KeyError, ValueError, subprocess.TimeoutExpired) as fault:
            row[column] = "FAILED"
            faults += f"{version} {column}: {fault}\n"
    return [version, *row.values()], faults


def main() -> int:
    interpreters = found()
    interpreters.pop(OWN, None)
    table, faults = [], ""
    with tempfile.TemporaryDirectory() as scratch:
        top = Path(scratch)
        own = top / "own"
        own.mkdir()
        words(sys.executable, "-m", "build", "--wheel", "--outdir", top, TOP)
        ours = {name: computed(sys.executable, name, own) for name in RUNS}
        for kind in FMUS:
            ours[kind] = simulated(sys.executable, exported(sys.executable, kind, own))
        for version, path in sorted(interpreters.items()):
            print(f"Python {version} ...", file=sys.stderr, flush=True)
            (top / version).mkdir()
            row, failed = row_of(version, path, top / version, ours)
            table.append(row)
            faults += failed
    head = ["Python", *(c.replace("from", f"of {OWN}").replace("to", f"to {OWN}") for c in COLUMNS)]
    for line in (head, ["-"] * len(head), *table):
        print("|", " | ".join(line), "|")
    missing = [v for v in VERSIONS if v != OWN and v not in interpreters]
    print(f"not found: {', '.join(missing) or 'none'}\n{faults}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
