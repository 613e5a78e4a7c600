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

import numpy as np
import sympy as sp
from runner import ROOT, Row

from ballscrew.fmus.modelica import modelica
from ballscrew.orchestration.loop.catalogue import NAMES, component, fmu_kernel
from ballscrew.plant import PLANTS
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import TIME, Component, symbol
from ballscrew.solver.kernel import Model
from interoperability.tools import NotMade, by_host, judged, python_of

SHARED = ROOT.parent / "shared" / "modelica" / "loops.mo"
BY_HAND = Path(os.environ.get("BALLSCREW_MODELICA", SHARED))
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


def compared(
    compiler: str, python: Path, job: Row, known: Row, allowed: float, share: bool
) -> list[Row]:
    """A row for each model of a job; of each, `known` has a title, times, and signals by name.

    The error is the largest of a signal, or with `share` over the signal's largest value.
    """
    job["columns"] = {name: list(signals) for name, (*_, signals) in known.items()}
    rows = []
    for name, result in by_host(compiler, python, job).items():
        title, times, signals = known[name]
        row = {"compiler": compiler, "model": title, "allowed": allowed, "error": None}
        if "columns" in result:
            found = result["columns"]
            off = {n: np.interp(times, result["time"], found[n]) - y for n, y in signals.items()}
            sizes = {n: np.abs(y).max() if share else 1.0 for n, y in signals.items()}
            errors = [np.abs(off[n]).max() / max(sizes[n], 1e-300) for n in signals]
            row["error"] = float(np.max(errors, initial=0.0))
        rows.append(row | {k: result[k] for k in ("why",) if k in result})
    return rows


def of_components(compiler: str, python: Path, names: Sequence[str]) -> list[Row]:
    parts = {n: part for n in names if (part := driven(n)) is not None}
    known = {}
    for name, part in parts.items():
        course = Model(generate(part), tolerance=0.1 * TOLERANCE).simulate(grid(100))
        known[name] = name, grid(100), {**course.states, **course.outputs}
    job = {"tolerance": TOLERANCE, "step": STEP, "steps": 100}
    job["models"] = {name: modelica(part) for name, part in parts.items()}
    return compared(compiler, python, job, known, ALLOWED, share=True)


def by_hand(compiler: str, python: Path) -> list[Row]:
    """The loops not written by this program."""
    known = {}
    for name, controller in LOOPS.items():
        model = Model(fmu_kernel(controller, "plant"), tolerance=0.1 * TOLERANCE)
        x = model.simulate(grid(2000)).outputs["x"]
        known[name] = f"by another hand: {controller}", grid(2000), {"x": x}
    job = {"tolerance": TOLERANCE, "step": STEP, "steps": 2000}
    job["models"] = dict.fromkeys(LOOPS, BY_HAND.read_text(encoding="utf-8"))
    return compared(compiler, python, job, known, ALLOWED_BY_HAND, share=False)


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
    job = {"tolerance": 1e-8, "step": 5e-3, "steps": 400, "models": {"Axis": text}}
    table = np.genfromtxt(HOWTO / "iol_step.csv", delimiter=",", names=True)
    known = {"Axis": ("how-to of OpenModelica: Axis", table["time"], {"x": table["x"]})}
    return compared(compiler, python, job, known, ALLOWED_OF_HOWTO, share=False)


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
