"""Proof: two Modelica compilers solve our exported components with the results of our solver.

Tested are every component of the catalogue without events, with sines as inputs, for one second;
the loops of an axis and controllers written in Modelica independently, if that file is given
(``BALLSCREW_MODELICA``); and the model of the OpenModelica how-to, with Modelica instead of its two
FMUs, compared with the table next to it. Writes ``docs/proof/modelica.json``. It fails if a
compiler does not accept a file, or an error is larger than allowed. ``--quick`` runs four
components and that model, and writes no file.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

from ballscrew.fmus.modelica import modelica
from ballscrew.orchestration.loop.catalogue import NAMES, component, fmu_kernel
from ballscrew.plant import PLANTS
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import TIME, Component, symbol
from ballscrew.solver.files import write_json
from ballscrew.solver.kernel import Model

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from provenance import provenance

from interoperability.environments import ROOT, NotMade, by_host, python_of

TARGET = ROOT / "docs" / "proof" / "modelica.json"
BY_HAND = Path(
    os.environ.get("BALLSCREW_MODELICA", ROOT.parent / "shared" / "modelica" / "loops.mo")
)
COMPILERS = {
    "rumoca": ["rumoca==0.10.2", "numpy"],
    "pymoca": ["pymoca==0.12", "casadi==3.6.7", "numpy"],
}
TOLERANCE, STEP, STOP = 1e-10, 1e-2, 1.0
ALLOWED = 1e-6  # share of a signal's largest value
ALLOWED_BY_HAND = 1e-9  # [m]
ALLOWED_OF_HOWTO = 1e-8  # [m]
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


def ours(part: Component) -> dict[str, Any]:
    """States and outputs on the grid of `STEP`."""
    course = Model(generate(part), tolerance=0.1 * TOLERANCE).simulate(_grid(STOP))
    return {**course.states, **course.outputs}


def _grid(stop: float) -> np.ndarray:
    return STEP * np.arange(round(stop / STEP) + 1)


def error_of(found: dict[str, Any], known: dict[str, Any], stop: float) -> tuple[float, str]:
    """Largest error of any signal as a share of its largest value, and the signal's name."""
    worst = 0.0, ""
    for name, values in known.items():
        theirs = np.interp(_grid(stop), found["time"], found["columns"][name])
        size = max(float(np.abs(values).max()), 1e-300)
        worst = max(worst, (float(np.abs(theirs - values).max()) / size, name))
    return worst


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="what CI runs: four components")
    options = parser.parse_args()
    names = QUICK if options.quick else NAMES
    parts = {n: part for n in names if (part := driven(n)) is not None}
    known = {n: ours(part) for n, part in parts.items()}
    job = {"tolerance": TOLERANCE, "step": STEP, "stop": STOP}
    job |= {"models": {n: modelica(part) for n, part in parts.items()}}
    job |= {"columns": {n: list(columns) for n, columns in known.items()}}
    rows: list[dict[str, Any]] = []
    not_made = {}
    for compiler, packages in COMPILERS.items():
        try:
            python = python_of(compiler, packages)
        except NotMade as error:
            not_made[compiler] = str(error)
            continue
        found = by_host(compiler, python, job)
        for name, result in found.items():
            row = {"compiler": compiler, "model": name, "allowed": ALLOWED, "error": None}
            if "why" in result:
                row["why"] = result["why"]
            else:
                row["error"], row["signal"] = error_of(result, known[name], STOP)
            rows.append(row)
        rows += by_hand(python, compiler) + of_howto(python, compiler)
        print(f"{compiler}: {len(found)} models", file=sys.stderr)
    wrong = [r for r in rows if r["error"] is None or not r["error"] <= r["allowed"]]
    report = {
        **provenance("modelica"),
        "packages": COMPILERS,
        "tolerance": TOLERANCE,
        "wrong": len(wrong),
        "rows": rows,
    }
    if not options.quick:
        write_json(TARGET, report)
    print(json.dumps({"runs": len(rows), "wrong": wrong}))
    for compiler, why in not_made.items():
        print(f"no environment: {compiler}: {why}", file=sys.stderr)
    return 1 if wrong or (not_made and not options.quick) else 0  # a package index may be down


def by_hand(python: Path, compiler: str) -> list[dict[str, Any]]:
    """The loops not written by this program; none without their file."""
    if compiler != "rumoca" or not BY_HAND.is_file():  # pymoca's host takes one flat model
        print(f"{compiler}: no loops by another hand", file=sys.stderr)
        return []
    text = BY_HAND.read_text(encoding="utf-8")
    job = {"tolerance": TOLERANCE, "step": STEP, "stop": 20.0}
    job |= {"models": dict.fromkeys(LOOPS, text), "columns": {n: ["x"] for n in LOOPS}}
    rows = []
    for name, result in by_host(compiler, python, job).items():
        row = {"compiler": compiler, "model": f"by another hand: {LOOPS[name]}"}
        row |= {"allowed": ALLOWED_BY_HAND, "signal": "x", "error": None}
        if "why" in result:
            row["why"] = result["why"]
        else:
            kernel = fmu_kernel(LOOPS[name], "plant")
            model = Model(kernel, tolerance=0.1 * TOLERANCE)
            (goal,) = (i.name for i in kernel.inputs if i.role == "reference")
            model.set_input(goal, 0.08)
            x = model.simulate(_grid(20.0)).outputs["x"]
            theirs = np.interp(_grid(20.0), result["time"], result["columns"]["x"])
            row["error"] = float(np.abs(theirs - x).max())
        rows.append(row)
    return rows


def of_howto(python: Path, compiler: str) -> list[dict[str, Any]]:
    """The how-to's model with Modelica instead of its FMUs; the law ports have no effect."""
    if compiler != "rumoca":  # pymoca's host takes one flat model
        return []
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
    job = {"tolerance": 1e-8, "step": 5e-3, "stop": 2.0}
    job |= {"models": {"Axis": text}, "columns": {"Axis": ["x"]}}
    (result,) = by_host(compiler, python, job).values()
    row = {"compiler": compiler, "model": "how-to of OpenModelica: Axis"}
    row |= {"allowed": ALLOWED_OF_HOWTO, "signal": "x", "error": None}
    if "why" in result:
        return [row | {"why": result["why"]}]
    known = np.genfromtxt(HOWTO / "iol_step.csv", delimiter=",", names=True)
    theirs = np.interp(known["time"], result["time"], result["columns"]["x"])
    return [row | {"error": float(np.abs(theirs - known["x"]).max())}]


if __name__ == "__main__":
    raise SystemExit(main())
