"""Two Modelica compilers solve our exported components with the results of our solver.

Tested are every component of the catalogue without events, with sines as inputs, for one second;
the loops of an axis and controllers written in Modelica independently, if that file is given
(``BALLSCREW_MODELICA``); and the model of the OpenModelica how-to, with Modelica instead of its two
FMUs, compared with the table next to it. ``--quick`` runs four components and the other models.
"""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp
from runner import ROOT, Row

from ballscrew.fmus.modelica import modelica
from ballscrew.orchestration.loop.catalogue import NAMES, component, fmu_kernel
from ballscrew.plant import PLANTS
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import TIME, Component, symbol
from ballscrew.solver.kernel import Model
from interoperability.tools import GOAL, NotMade, by_host, judged, python_of

BY_HAND = Path(
    os.environ.get("BALLSCREW_MODELICA", ROOT.parent / "shared" / "modelica" / "loops.mo")
)
COMPILERS = {
    "rumoca": ["rumoca==0.10.2", "numpy"],
    "pymoca": ["pymoca==0.12", "casadi==3.6.7", "numpy"],
}
TOLERANCE, STEP = 1e-10, 1e-2
ALLOWED = 1e-6  # share of a signal's largest value
ALLOWED_BY_HAND, ALLOWED_OF_HOWTO = 1e-9, 1e-8  # [m]
LOOPS = {"Loop": "pid", "NLoop": "nctf", "ILoop": "iol"}
QUICK = ("plant", "iol", "nctf", "pid")
HOWTO = ROOT / "docs" / "howto" / "scripts"
# share of the nominal size of each input; the rules of fuzzy_pd_i change in such a short time that
# a solver that controls only the integral's error steps over the change
SIZE, OF = 0.2, {"fuzzy_pd_i": 0.02}

Columns = dict[str, Any]


def driven(name: str) -> Component | None:
    """A component with sines for its inputs; None for one with events, samples or delays."""
    part = component(name)
    if part.modes or part.discrete or part.delays:
        return None
    size = 0.5 if name in PLANTS else OF.get(name, SIZE)
    sines = {
        symbol(i.name): size * i.nominal * sp.sin((2 + k) * TIME) for k, i in enumerate(part.inputs)
    }
    return part.substituted(sines, inputs=())


def grid(steps: int) -> np.ndarray:
    return STEP * np.arange(steps + 1)


def off(found: Row, known: Columns, times: np.ndarray) -> dict[str, float]:
    """Largest error of each signal."""
    return {
        name: float(np.abs(np.interp(times, found["time"], found["columns"][name]) - y).max())
        for name, y in known.items()
    }


def of_components(compiler: str, python: Path, names: Sequence[str]) -> list[Row]:
    """Every component: the largest error as a share of a signal's largest value."""
    parts = {n: part for n in names if (part := driven(n)) is not None}
    models, known = {}, {}
    for name, part in parts.items():
        course = Model(generate(part), tolerance=0.1 * TOLERANCE).simulate(grid(100))
        models[name], known[name] = modelica(part), {**course.states, **course.outputs}
    job = {"tolerance": TOLERANCE, "step": STEP, "steps": 100, "models": models}
    found = by_host(compiler, python, job | {"columns": {n: list(k) for n, k in known.items()}})
    rows = []
    for name, result in found.items():
        row = {"compiler": compiler, "model": name, "allowed": ALLOWED, "error": None}
        if "columns" in result:
            errors = off(result, known[name], grid(100))
            sizes = {n: max(float(np.abs(y).max()), 1e-300) for n, y in known[name].items()}
            row["error"] = max((errors[n] / sizes[n] for n in errors), default=0.0)
        rows.append(row | {k: result[k] for k in ("why",) if k in result})
    return rows


def position_row(compiler: str, model: str, allowed: float, result: Row, known: Any) -> Row:
    """A row for the position of a loop: `known` are times and positions."""
    row = {"compiler": compiler, "model": model, "allowed": allowed, "error": None}
    if "why" in result:
        return row | {"why": result["why"]}
    times, x = known
    return row | {"error": off(result, {"x": x}, times)["x"]}


def by_hand(compiler: str, python: Path) -> list[Row]:
    """The loops not written by this program; none without their file."""
    text = BY_HAND.read_text(encoding="utf-8")
    job = {"tolerance": TOLERANCE, "step": STEP, "steps": 2000}
    job |= {"models": dict.fromkeys(LOOPS, text), "columns": {n: ["x"] for n in LOOPS}}
    rows = []
    for name, result in by_host(compiler, python, job).items():
        kernel = fmu_kernel(LOOPS[name], "plant")
        model = Model(kernel, tolerance=0.1 * TOLERANCE)
        (goal,) = (i.name for i in kernel.inputs if i.role == "reference")
        model.set_input(goal, GOAL)
        known = grid(2000), model.simulate(grid(2000)).outputs["x"]
        words = f"by another hand: {LOOPS[name]}"
        rows.append(position_row(compiler, words, ALLOWED_BY_HAND, result, known))
    return rows


def of_howto(compiler: str, python: Path) -> list[Row]:
    """The how-to's model with Modelica instead of its FMUs; the law ports have no effect."""
    ports = [i.name for i in fmu_kernel("plant").inputs if i.name.startswith("u_")]
    text = (HOWTO / "axis_openmodelica.mo").read_text(encoding="utf-8")
    for name in ("plant", "iol"):
        whole = modelica(component(name))
        whole = whole.replace(f"model {name} ", f"model {name}_me_FMU ")
        whole = whole.replace(f"end {name};", f"end {name}_me_FMU;")
        if name == "plant":
            unused = "".join(f"  input Real {port};\n" for port in ports)
            whole = whole.replace("  input Real u(", f"{unused}  input Real u(", 1)
        text = f"{whole}\n{text}"
    job = {"tolerance": 1e-8, "step": 5e-3, "steps": 400}
    job |= {"models": {"Axis": text}, "columns": {"Axis": ["x"]}}
    (result,) = by_host(compiler, python, job).values()
    known = np.genfromtxt(HOWTO / "iol_step.csv", delimiter=",", names=True)
    words, table = "how-to of OpenModelica: Axis", (known["time"], known["x"])
    return [position_row(compiler, words, ALLOWED_OF_HOWTO, result, table)]


def tasks(asked: Namespace) -> dict[str, tuple[str, Sequence[str]]]:
    return {compiler: (compiler, QUICK if asked.quick else NAMES) for compiler in COMPILERS}


def trial(compiler: str, names: Sequence[str]) -> list[Row]:
    try:
        python = python_of(compiler, COMPILERS[compiler])
    except NotMade as error:
        return [{"tool": compiler, "not_made": str(error)}]
    rows = of_components(compiler, python, names)
    if compiler == "rumoca":  # pymoca's host takes one flat model
        rows += by_hand(compiler, python) if BY_HAND.is_file() else []
        rows += of_howto(compiler, python)
    return rows


def report(found: Sequence[list[Row]]) -> Row:
    return {"tolerance": TOLERANCE} | judged(COMPILERS, found, lambda r: r["error"] <= r["allowed"])


def says(report: Row) -> str:
    return f"{len(report['rows'])} models by {len(COMPILERS)} compilers, {report['wrong']} wrong"
