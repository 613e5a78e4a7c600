"""How many effects added to a real record are found beside those of the machine.

An additional friction D(x, v, t) on the machine would need the voltage ``u + D/gain`` for the same
motion. This is added to the recorded voltage of the EMPS drive; everything else is measured. We may
not distribute the data: ``BALLSCREW_EMPS`` is the folder of ``DATA_EMPS.mat`` (A. Janot, M.
Gautier, M. Brunot, "Data set and reference models of EMPS", 2019 Workshop on Nonlinear System
Identification Benchmarks; nonlinearbenchmark.org).
"""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from runner import ROOT, Row
from scipy.signal import savgol_filter

from ballscrew import read_drive_records, read_parameters
from ballscrew.measurement.diagnosis.diagnosis import diagnose_records
from ballscrew.measurement.diagnosis.model import drive_of
from ballscrew.solver.arrays import Vector
from ballscrew.solver.errors import UserError

COLUMNS = {"qm": "x", "vir": "u", "t": "time", "qg": "x_ref"}
UNITS = {"x": "m", "u": "V", "time": "s", "x_ref": "m"}
DATA = Path(os.environ.get("BALLSCREW_EMPS", ROOT.parent / "shared" / "data" / "EMPS"))
STORED = ("verdict", "floor", "baseline_residual", "adjusted_residual", "final_residual")
STORED += ("gain_interval", "held_out", "unnamed")
OF_CAUSE = ("name", "parameters", "intervals", "gain_heldout", "gain_interval")


def effects(x: Vector, v: Vector, friction: Vector, t: Vector) -> dict[str, tuple[str, Vector]]:
    """The name to be found, and the force [N], along a motion [m, m/s, N, share of the time]."""
    sign, turns = np.tanh(v / 2e-3), 2 * np.pi * x
    at = (x - 0.5 * (x.min() + x.max())) / (0.5 * np.ptp(x))
    return {
        "load of 4 N": ("load_bias", 4.0 + 0 * x),
        "friction 10 % larger in one direction": ("direction_asymmetry", 0.10 * friction),
        "friction 12 % larger at one end": ("position_trend_friction", 0.12 * friction * sign * at),
        "friction varies by 1 N, 100 periods per metre":
            ("position_periodic_friction", sign * np.cos(100 * turns + 1.0)),
        "ripple of 1 N, 60 periods per metre": ("torque_ripple", np.cos(60 * turns + 2.0)),
        "quadratic viscous friction": ("nonlinear_viscous", 400.0 * v * np.abs(v)),
        "friction 4 N larger at low speed":
            ("stribeck_mismatch", 4.0 * sign * np.exp(-((v / 0.03) ** 2))),
        "friction grows by 10 %": ("friction_drift", 0.10 * friction * sign * t),
    }  # fmt: skip


def tasks(asked: Namespace) -> dict[str, tuple[str]]:
    if not (DATA / "DATA_EMPS.mat").exists():
        raise UserError("DATA_EMPS.mat is not here; see docs/measured-drives.md")
    names = effects(*np.array([[0.0, 1.0]] * 4))
    return {effect or "the record itself": (effect,) for effect in ("", *names)}


def trial(effect: str) -> Row:
    """The answer for the record with an effect, or with none."""
    model = drive_of(read_parameters(ROOT / "docs" / "emps.toml"))
    (record,) = read_drive_records([DATA / "DATA_EMPS.mat"], COLUMNS, UNITS)
    x, t, gain = record.x, record.time - record.time[0], model.values["gain"]
    row: Row = {"drive_force_rms_N": float(np.sqrt(np.mean((gain * record.u) ** 2)))}
    if effect:
        v = savgol_filter(x, 31, 3, deriv=1, delta=record.step)
        friction = model.values["Fc"] + model.values["sigma2"] * np.abs(v)
        cause, extra = effects(x, v, friction, t / t[-1])[effect]
        record = replace(record, signals={**record.signals, "u": record.u + extra / gain})
        row = {"effect": effect, "cause": cause}
        row["force_rms_N"] = float(np.sqrt(np.mean(extra**2)))
    return row | told(diagnose_records([replace(record, name="DATA_EMPS.mat")], model))


def told(found: Any) -> Row:
    said = found.to_dict()
    causes = [{k: c[k] for k in OF_CAUSE} for c in said["causes"]]
    return {k: said[k] for k in STORED} | {"causes": causes, "seconds": round(said["seconds"], 1)}


def report(rows: Sequence[Row]) -> Row:
    alone = [row for row in rows if "effect" not in row]
    had = {c["name"] for row in alone for c in row["causes"]}
    hidden = [row for row in rows if "effect" in row]
    for row in hidden:
        row["found"] = row["cause"] in {c["name"] for c in row["causes"]}
        row["had_it_already"] = row["cause"] in had
    return {"published_model": alone[0] if alone else None, "hidden": hidden}


def says(report: Row) -> str:
    found = [row["found"] for row in report["hidden"]]
    return f"{sum(found)} of {len(found)} added effects are in the answer"
