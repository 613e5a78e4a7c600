"""Proof: FMUs made by other programs run here as controllers, next to the built-in one.

Makes an environment for each program under ``out/tools`` (with pip), in which the program makes an
FMU of the equations of `pid` with the nominal gains (``makers/``). All run in one ``ballscrew
swap``. Each position is compared with the complete loop of `pid` in SciPy's Radau solver. Writes
``docs/proof/made_by_others.json`` and the table in ``docs/systems.md``. It fails if an FMU does not
run, is not trusted, or has twice the allowed error. A program whose environment cannot be made is
listed at the end. ``--quick`` leaves out jaxonomy, which is large, and writes nothing.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from provenance import FOLDER, provenance
from tools import GRID, PACKAGES, ROOT, NotMade, python_of, reference

from ballscrew.cli import main as ballscrew
from ballscrew.controllers.pid import simc

TARGET = FOLDER / "made_by_others.json"
PAGE = ROOT / "docs" / "systems.md"
BEGIN, END = "<!-- of proofs/made_by_others.py -->\n", "<!-- end -->\n"
MAKERS = Path(__file__).resolve().parent / "makers"
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


def made(name: str, folder: Path, environments: Path) -> Path:
    """Make the FMU with a program.

    Raises
    ------
    NotMade
        If pip cannot fill its environment, or the program fails.
    """
    python = python_of(name, environments, ENVIRONMENTS[name])
    target = folder / f"{name}.fmu"
    done = subprocess.run(
        [python, MAKERS / f"{name}_maker.py", folder / "gains.json", target],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode or not target.is_file():
        raise NotMade((done.stderr.strip().splitlines() or ["no word"])[-1])
    return target


def swapped(fmus: Mapping[str, Path], folder: Path) -> list[dict[str, Any]]:
    """A row for `pid` and for each FMU: verdict, steps, and largest error of the position [m]."""
    told = ["--controllers", "pid", *map(str, fmus.values())]
    for name, ports in MAPS.items():
        if name in fmus:
            told += [part for a, b in ports.items() for part in ("--map", f"{name}.{a}={b}")]
    told += ["--stop", str(STOP), "--step", str(STEP), "--out", str(folder / "swap")]
    code = ballscrew(["swap", *told])
    results = json.loads((folder / "swap" / "comparison.json").read_text(encoding="utf-8"))
    rows = []
    for result in results:
        name = result["controller"]
        with (folder / "swap" / f"trajectory_{name}.csv").open(encoding="utf-8") as file:
            table = list(csv.DictReader(file))
        time, x = (np.array([float(row[n]) for row in table]) for n in ("time", "x"))
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


def table(rows: list[dict[str, Any]], not_made: Mapping[str, str]) -> str:
    """The rows as a table of the page."""
    lines = ["| made by | what it is | verdict | error of `x` [m] | its estimate [m] |"]
    lines.append("|---|---|---|---|---|")
    for row in rows:
        name = row["made_by"]
        package = ENVIRONMENTS[name][0].replace("==", " ") if name in ENVIRONMENTS else "built in"
        what = KINDS.get(name, "`pid` as a component")
        figures = f"{row['error']:.1e} | {row['estimate']:.1e}"
        lines.append(f"| {package} | {what} | {row['verdict']} | {figures} |")
    lines += [f"| {name} | not made: {why} | | | |" for name, why in not_made.items()]
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", default=[*KINDS], choices=list(KINDS))
    parser.add_argument("--environments", type=Path, default=ROOT / "out" / "tools")
    parser.add_argument("--quick", action="store_true", help="what CI runs: not jaxonomy")
    options = parser.parse_args()
    if options.quick:
        options.only.remove("jaxonomy")
    fmus, not_made = {}, {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        gains = dict(zip(("Kp", "Ki", "Kd"), asdict(simc()).values(), strict=True))
        (folder / "gains.json").write_text(json.dumps(gains), encoding="utf-8")
        for name in options.only:
            try:
                fmus[name] = made(name, folder, options.environments.resolve())
            except NotMade as error:
                not_made[name] = str(error)
        rows = swapped(fmus, folder)
    missing = set(fmus) - {row["made_by"] for row in rows}
    wrong = [row for row in rows if not good(row)]
    for row in rows:
        print(json.dumps(row))
    if options.only == list(KINDS):
        report = {**provenance("made_by_others"), "packages": ENVIRONMENTS, "wrong": len(wrong)}
        report |= {"not_made": not_made, "rows": rows}
        TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
        tail = rest.split(END)[1]
        PAGE.write_text(f"{head}{BEGIN}\n{table(rows, not_made)}\n{END}{tail}", encoding="utf-8")
    print(f"{len(rows)} controllers, {len(wrong) + len(missing)} wrong", file=sys.stderr)
    for row in wrong:
        print(f"wrong: {json.dumps(row)}", file=sys.stderr)
    for name, why in not_made.items():
        print(f"not made: {name}: {why}", file=sys.stderr)
    if options.quick:
        print("not asked for by --quick: jaxonomy", file=sys.stderr)
    return 1 if wrong or missing or (not_made and not options.quick) else 0


def good(row: Mapping[str, Any]) -> bool:
    """Whether it reached the end, is trusted, and has not more than twice the allowed error."""
    whole = row["verdict"] == "trusted" and row["end"] > STOP - 0.5 * STEP
    return bool(whole and row["error"] <= 2.0 * ALLOWED.get(row["made_by"], HELD))


if __name__ == "__main__":
    raise SystemExit(main())
