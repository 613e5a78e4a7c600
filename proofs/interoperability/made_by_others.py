"""Proof: FMUs made by other programs run here as controllers, next to the built-in one.

Makes an environment for each program under ``out/tools`` (with pip), in which the program makes an
FMU of the equations of `pid` with the nominal gains (``makers.py``). All run in one ``ballscrew
swap``. Each position is compared with the complete loop of `pid` in SciPy's Radau solver. Writes
``docs/proof/made_by_others.json``, of which ``docs/systems.md`` has the table. It fails if an FMU
does not run, is not trusted, or has twice the allowed error. A program whose environment cannot be
made is listed at the end. ``--quick`` leaves out jaxonomy, which is large, and writes nothing.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ballscrew.cli import main as ballscrew
from ballscrew.controllers.pid import simc

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from provenance import FOLDER, provenance, stored

from interoperability.environments import HERE, NotMade, called, python_of
from interoperability.tools import GRID, PACKAGES, reference

ENVIRONMENTS = {
    "pythonfmu": ["pythonfmu==0.7.0"],
    "component_model": ["component-model==0.4.0"],
    "qfmu": ["qfmu==0.2.9"],
    "pythonfmu3": ["pythonfmu3==0.3.4"],
    "unifmu": ["unifmu==0.0.3", "pyzmq==27.3.0", "setuptools<81"],  # it imports pkg_resources
    "casadi": PACKAGES["casadi"],
    "jaxonomy": PACKAGES["jaxonomy"],
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


def made(name: str, folder: Path) -> Path:
    """Make the FMU with a program; `NotMade` if that fails."""
    target = folder / f"{name}.fmu"
    python = python_of(name, ENVIRONMENTS[name])
    called([python, HERE / "makers.py", name, folder / "gains.json", target])
    return target


def swapped(fmus: Mapping[str, Path], folder: Path) -> list[dict[str, Any]]:
    """A row for `pid` and for each FMU: verdict, steps, and largest error of the position [m]."""
    options = ["--controllers", "pid", *map(str, fmus.values())]
    for name, ports in MAPS.items():
        if name in fmus:
            options += [part for a, b in ports.items() for part in ("--map", f"{name}.{a}={b}")]
    options += ["--stop", str(STOP), "--step", str(STEP), "--out", str(folder / "swap")]
    code = ballscrew(["swap", *options])
    results = json.loads((folder / "swap" / "comparison.json").read_text(encoding="utf-8"))
    rows = []
    for result in results:
        name = result["controller"]
        with (folder / "swap" / f"trajectory_{name}.csv").open(encoding="utf-8") as file:
            columns = list(csv.DictReader(file))
        time, x = (np.array([float(row[n]) for row in columns]) for n in ("time", "x"))
        known = reference("pid")[np.rint(time / GRID).astype(int)]
        rows.append(
            {
                "made_by": name,
                "verdict": result["verdict"],
                "estimate": result["error_estimate"].get("x"),
                "error": float(np.abs(x - known).max()),
                "coupling": result["coupling_reason"],
                "end": float(time[-1]),
                "exit_code": code,
            }
        )
    return rows


def good(row: Mapping[str, Any]) -> bool:
    """Whether it reached the end, is trusted, and has not more than twice the allowed error."""
    whole = row["verdict"] == "trusted" and row["end"] > STOP - 0.5 * STEP
    return bool(whole and row["error"] <= 2.0 * ALLOWED.get(row["made_by"], HELD))


def table() -> str:
    """The stored rows as a table of a page."""
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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", default=[*ENVIRONMENTS], choices=list(ENVIRONMENTS))
    parser.add_argument("--quick", action="store_true", help="what CI runs: not jaxonomy")
    options = parser.parse_args()
    names = [n for n in options.only if not (options.quick and n == "jaxonomy")]
    fmus, not_made = {}, {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        gains = dict(zip(("Kp", "Ki", "Kd"), asdict(simc()).values(), strict=True))
        (folder / "gains.json").write_text(json.dumps(gains), encoding="utf-8")
        for name in names:
            try:
                fmus[name] = made(name, folder)
            except NotMade as error:
                not_made[name] = str(error)
        rows = swapped(fmus, folder)
    missing = set(fmus) - {row["made_by"] for row in rows}
    wrong = [row for row in rows if not good(row)]
    if names == list(ENVIRONMENTS):
        report = {**provenance("made_by_others"), "packages": ENVIRONMENTS, "wrong": len(wrong)}
        report |= {"not_made": not_made, "rows": rows}
        target = FOLDER / "made_by_others.json"
        target.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    for row in rows:
        print(json.dumps(row))
    print(f"{len(rows)} controllers, {len(wrong) + len(missing)} wrong", file=sys.stderr)
    for row in wrong:
        print(f"wrong: {json.dumps(row)}", file=sys.stderr)
    for name, why in not_made.items():
        print(f"not made: {name}: {why}", file=sys.stderr)
    return 1 if wrong or missing or (not_made and not options.quick) else 0


if __name__ == "__main__":
    raise SystemExit(main())
