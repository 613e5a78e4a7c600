"""Identification and diagnosis of a measured record: the EMPS drive, see docs/emps.md.

The record is read from the folder ``BALLSCREW_EMPS``.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from report import OURS, Cost, Program, Works, missing, timed
from scipy.io import loadmat
from scipy.signal import butter, filtfilt

import ballscrew

ROOT = Path(__file__).resolve().parent.parent
EMPS = Path(os.environ.get("BALLSCREW_EMPS", ROOT.parent / "shared" / "data" / "EMPS"))
RECORD = EMPS / "DATA_EMPS.mat"
ABSENT = {"EMPS": {OURS: f"{RECORD.name} is not here; set BALLSCREW_EMPS to its folder"}}
FORCE = 35.1506518790  # N/V

Vector = npt.NDArray[np.float64]
Fitted = tuple[float, Callable[[Vector], Vector], float]  # mass, friction, offset


def moving(v: Vector) -> npt.NDArray[np.bool_]:
    """Where it moves: at rest friction is undetermined."""
    return np.abs(v) > 2e-3


def by_least_squares(v: Vector, a: Vector, force: Vector) -> Fitted:
    columns = np.column_stack([a, v, np.sign(v), np.ones_like(v)])[moving(v)]
    m, viscous, coulomb, offset = np.linalg.lstsq(columns, force[moving(v)], rcond=None)[0]
    return m, lambda w: viscous * w + coulomb * np.sign(w), offset


def by_lmfit(v: Vector, a: Vector, force: Vector) -> Fitted:
    import lmfit

    def friction(w: Vector, q: dict[str, float]) -> Vector:
        level = q["coulomb"] + q["peak"] * np.exp(-((w / q["vs"]) ** 2))
        return q["viscous"] * w + level * np.tanh(w / 1e-3)

    def left(values: Any) -> Vector:
        q = values.valuesdict()
        return force - (q["m"] * a + friction(v, q) + q["b"])

    starts = {"m": 90.0, "viscous": 100.0, "coulomb": 20.0, "peak": 1.0, "b": 0.0}
    values = lmfit.create_params(**starts, vs={"value": 0.02, "min": 1e-3})
    q = lmfit.minimize(left, values).params.valuesdict()
    return q["m"], lambda w: friction(w, q), q["b"]


def by_pysindy(v: Vector, a: Vector, force: Vector) -> Fitted:
    import pysindy

    columns = np.column_stack([v, a, np.sign(v), v * np.abs(v), np.ones_like(v)])
    optimizer = pysindy.STLSQ(threshold=0.5)
    optimizer.fit(columns, force[:, None])
    viscous, m, coulomb, square, offset = np.ravel(optimizer.coef_)
    return m, lambda w: viscous * w + coulomb * np.sign(w) + square * w * np.abs(w), offset


def by_identify(path: Path) -> Fitted:
    found = ballscrew.identify(path, "classical", offset=True, mass=True)
    q = {name: p.value for name, p in found.parameters.items()}

    def friction(w: Vector) -> Vector:
        level = q["Fc"] + (q["Fs"] - q["Fc"]) * np.exp(-((w / q["Vs"]) ** 2))
        return q["sigma2"] * w + level * np.sign(w)

    return q["m"], friction, q["offset"]


def fits(folder: Path) -> Works:
    """Identification of a drive

    Three laps to fit, judged on the fourth: force minus model while it moves, the same filter of
    100 Hz for all. Only `ballscrew identify` gives intervals, says what the record does not tell,
    and finds the time between force and motion. Published: 95.11 kg and -3.16 N.
    """
    if not RECORD.is_file():
        return ABSENT
    data = loadmat(RECORD)
    t, x, u = (np.ravel(data[n]).astype(float) for n in ("t", "qm", "vir"))
    train, h = t < 0.75 * t[-1], t[1] - t[0]
    rows, path = np.column_stack([t, FORCE * u, x])[train], folder / "emps.csv"
    np.savetxt(path, rows, delimiter=",", header="time,force,x", comments="")
    position, force = (filtfilt(*butter(4, 100.0 * 2 * h), c) for c in (x, FORCE * u))
    v = np.gradient(position, h)
    a, judged = np.gradient(v, h), ~train & moving(v)

    def cost(fit: Callable[[], Fitted], lines: int) -> Cost:
        took, (m, friction, offset) = timed(fit)
        left = (force - (m * a + friction(v) + offset))[judged]
        rms = np.sqrt(np.mean(left**2))
        what = f"m {m:.2f} kg, offset {offset:.2f} N, left {rms:.3f} N"
        return Cost(took, f"{what}, lines: {lines}")

    def other(fit: Callable[..., Fitted]) -> Program:
        lines = len(inspect.getsource(fit).splitlines())
        return partial(cost, partial(fit, v[train], a[train], force[train]), lines)

    programs: dict[str, Program] = {
        OURS: partial(cost, partial(by_identify, path), 1),
        "NumPy, least squares": other(by_least_squares),
        "lmfit, Stribeck curve": missing("lmfit") or other(by_lmfit),
        "pysindy, sparse regression": missing("pysindy") or other(by_pysindy),
    }
    return {"EMPS": programs}


def diagnosis(_: Path) -> Works:
    """Diagnosis of the same record

    All four laps against the published model, without pictures.
    """
    if not RECORD.is_file():
        return ABSENT
    mapping, units = {"vir": "u", "qm": "x", "t": "time"}, {"time": "s", "x": "m", "u": "V"}
    model = ROOT / "docs" / "emps.toml"

    def diagnose() -> Cost:
        took, found = timed(lambda: ballscrew.diagnose(RECORD, model, mapping=mapping, units=units))
        return Cost(took, f"{found.verdict}: {', '.join(c.name for c in found.causes)}")

    return {"EMPS": {OURS: diagnose}}


TABLES = fits, diagnosis
