"""FMUs made by other programs run here as controllers, next to the built-in one.

In an environment of its own, each program makes an FMU of the equations of `pid` with the nominal
gains (``makers.py``). All run in one ``ballscrew swap``. Each position is compared with the
complete loop of `pid` in SciPy's Radau solver. A row is wrong if its FMU does not reach the end, is
not trusted, or has twice the allowed error. ``--quick`` leaves out jaxonomy, which is large.
"""

from __future__ import annotations

import json
import tempfile
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from runner import Row, stored

from ballscrew import component, swap
from interoperability import tools

ENVIRONMENTS = {
    "pythonfmu": ["pythonfmu==0.7.0"],
    "component_model": ["component-model==0.4.0"],
    "qfmu": ["qfmu==0.2.9"],
    "pythonfmu3": ["pythonfmu3==0.3.4"],
    "unifmu": ["unifmu==0.0.3", "pyzmq==27.3.0", "setuptools<81"],  # it imports pkg_resources
    "casadi": tools.PACKAGES["casadi"],
    "jaxonomy": tools.PACKAGES["jaxonomy"],
}
KINDS = {
    "pid": "`pid` as a component",
    "pythonfmu": "FMI 2.0 co-simulation, Python",
    "component_model": "FMI 2.0 co-simulation, Python",
    "qfmu": "FMI 2.0 co-simulation, C, Euler's steps of 1e-5 s",
    "pythonfmu3": "FMI 3.0 co-simulation, Python",
    "unifmu": "FMI 2.0 co-simulation, Python in a process of its own",
    "casadi": "FMI 3.0 model exchange, C",
    "jaxonomy": "FMI 2.0 co-simulation, a block diagram",
}
MAPS = {"qfmu": {"u1": "x_d", "u2": "x", "u3": "v", "y1": "u"}}
STEP, STOP = 1e-3, 0.3  # [s]
ALLOWED = {"pid": 1.5e-9, "pythonfmu": 9.8e-6, "qfmu": 5e-6, "casadi": 5e-6}
HELD = 2.8e-5  # error of the others: their inputs are held over a step


def tasks(asked: Namespace) -> dict[str, tuple[list[str]]]:
    return {"swap": ([n for n in ENVIRONMENTS if n != "jaxonomy" or not asked.quick],)}


def trial(programs: Sequence[str]) -> list[Row]:
    gains = json.dumps({p.name: p.default for p in component("pid").parameters})
    fmus, rows = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for name in programs:
            fmus[name] = Path(folder) / f"{name}.fmu"
            try:
                python = tools.python_of(name, ENVIRONMENTS[name])
                tools.called([python, tools.HERE / "makers.py", name, gains, fmus[name]])
            except tools.NotMade as error:
                rows.append({"tool": name, "not_made": str(error)})
                del fmus[name]
        return swapped(fmus) + rows


def swapped(fmus: Mapping[str, Path]) -> list[Row]:
    """A row for `pid` and for each FMU: verdict, and largest error of the position [m]."""
    maps = {name: MAPS[name] for name in MAPS if name in fmus}
    found = swap(["pid", *fmus.values()], stop=STOP, step=STEP, mapping=maps)
    rows: list[Row] = [{"made_by": n, "error": None, "why": why} for n, why in found.failures]
    for result in found.results:
        run = result.run
        known = tools.reference("pid")[np.rint(run.time / tools.GRID).astype(int)]
        row = {"made_by": result.loop.label, "verdict": run.verdict.word}
        row["sampled"] = run.sampling_period or None  # then the error is that of holding, too
        row |= {"coupling": run.coupling_reason, "estimate": run.verdict.error_estimate.get("x")}
        error = float(np.abs(run.outputs["x"] - known).max())
        rows.append(row | {"end": float(run.time[-1]), "error": error})
    return rows


def good(row: Row) -> bool:
    whole = row["verdict"] == "trusted" and row["end"] > STOP - 0.5 * STEP
    return bool(whole and row["error"] <= 2.0 * ALLOWED.get(row["made_by"], HELD))


def report(found: Sequence[list[Row]]) -> Row:
    return tools.judged(ENVIRONMENTS, found, good)


def says(report: Row) -> str:
    return f"{len(report['rows'])} controllers in one swap, {report['wrong']} wrong"


def table() -> str:
    report = stored("made_by_others")
    lines = ["| made by | what it is | verdict | error of `x` [m] | its estimate [m] |"]
    lines.append("|---|---|---|---|---|")
    for row in report["rows"]:
        name = row["made_by"]
        package = report["packages"][name][0].replace("==", " ") if name != "pid" else "built in"
        figures = f"{row['error']:.1e} | {row['estimate']:.1e}"
        lines.append(f"| {package} | {KINDS[name]} | {row['verdict']} | {figures} |")
    lines += [f"| {name} | not made: {why} | | | |" for name, why in report["not_made"].items()]
    return "\n".join(lines)
