"""Proof: effects added to a real record are found in addition to those of the machine.

An additional friction D(x, v, t) on the machine would need the voltage ``u + D/gain`` for the same
motion. This is added to the recorded voltage of the EMPS drive; everything else is measured. Writes
``docs/proof/emps.json``. We may not distribute the data: the first argument is the file, or
``BALLSCREW_EMPS`` is the folder of ``DATA_EMPS.mat`` (A. Janot, M. Gautier, M. Brunot, "Data set
and reference models of EMPS", 2019 Workshop on Nonlinear System Identification Benchmarks;
nonlinearbenchmark.org).
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from provenance import provenance
from scipy.signal import savgol_filter

from ballscrew import read_drive_records, read_parameters
from ballscrew.measurement.diagnosis.diagnose import diagnose_records
from ballscrew.measurement.diagnosis.drive import Drive, drive_of
from ballscrew.solver.files import write_atomically

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "emps.json"
COLUMNS = {"qm": "x", "vir": "u", "t": "time", "qg": "x_ref"}
UNITS = {"x": "m", "u": "V", "time": "s", "x_ref": "m"}
DATA = Path(os.environ.get("BALLSCREW_EMPS", ROOT.parent / "shared" / "data" / "EMPS"))


def effects(model: Drive, x: Any, v: Any, t: Any) -> dict[str, tuple[str, Any]]:
    """Hidden forces by label: the name to be found, and the force [N]."""
    sign = np.tanh(v / 2e-3)
    middle, half = 0.5 * (x.min() + x.max()), 0.5 * np.ptp(x)
    friction = model.values["Fc"] + model.values["sigma2"] * np.abs(v)
    turn = 2 * np.pi * x
    return {
        "load of 4 N": ("load_bias", 4.0 + 0 * x),
        "friction 10 % larger one way": ("direction_asymmetry", 0.10 * friction),
        "friction 12 % larger at one end": (
            "position_trend_friction",
            0.12 * friction * sign * (x - middle) / half,
        ),
        "friction swings by 1 N, 100 times a metre": (
            "position_periodic_friction",
            sign * np.cos(100 * turn + 1.0),
        ),
        "ripple of 1 N, 60 times a metre": ("torque_ripple", np.cos(60 * turn + 2.0)),
        "quadratic viscous friction": ("nonlinear_viscous", 400.0 * v * np.abs(v)),
        "friction 4 N larger at low speed": (
            "stribeck_mismatch",
            4.0 * sign * np.exp(-((v / 0.03) ** 2)),
        ),
        "friction grows by 10 %": ("friction_drift", 0.10 * friction * sign * t / t[-1]),
    }


def summary(found: Any) -> dict[str, Any]:
    said = found.to_dict()
    keep = (
        "verdict",
        "floor",
        "baseline_residual",
        "adjusted_residual",
        "final_residual",
        "gain_interval",
        "held_out",
        "unnamed",
    )
    of_cause = (
        "name",
        "parameters",
        "intervals",
        "gain_heldout",
        "gain_interval",
    )
    return {k: said[k] for k in keep} | {
        "causes": [{k: c[k] for k in of_cause} for c in said["causes"]],
        "seconds": round(said["seconds"], 1),
    }


def main() -> int:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else DATA / "DATA_EMPS.mat"
    if not path.exists():
        print(f"{path.name} is not here; see docs/measured-drives.md", file=sys.stderr)
        return 2
    prior_model = drive_of(read_parameters(ROOT / "docs" / "emps.toml"))
    (record,) = read_drive_records([path], COLUMNS, UNITS)
    record = replace(record, name="DATA_EMPS.mat")
    x, t = record.x, record.time - record.time[0]
    v = savgol_filter(x, 31, 3, deriv=1, delta=record.step)
    gain = prior_model.values["gain"]
    force = gain * record.u
    alone = diagnose_records([record], prior_model)
    report: dict[str, Any] = {
        **provenance("emps"),
        "drive_force_rms_N": float(np.sqrt(np.mean(force**2))),
        "published_model": summary(alone),
        "hidden": [],
    }
    had = {c.name for c in alone.causes}
    for label, (name, extra) in effects(prior_model, x, v, t).items():
        hidden = replace(
            record,
            signals={**record.signals, "u": record.u + extra / gain},
        )
        found = diagnose_records([hidden], prior_model)
        named = [c.name for c in found.causes]
        report["hidden"].append(
            {
                "effect": label,
                "cause": name,
                "force_rms_N": float(np.sqrt(np.mean(extra**2))),
                "found": name in named,
                "had_it_already": name in had,
                **summary(found),
            }
        )
        print(
            f"{label}: {name} {'found' if name in named else 'NOT found'}: {named}", file=sys.stderr
        )
        write_atomically(TARGET, (json.dumps(report, indent=1) + "\n").encode())
    hits = sum(r["found"] for r in report["hidden"])
    print(json.dumps({"effects": len(report["hidden"]), "found": hits}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
