"""Data of a record from the rig's ``trial.json``: mass, lags, and the fine position's scale."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from .record import Record

_UNSAID_GAIN_STD = 0.01  # for a fine position without a known calibration


def read_about(folder: Path) -> dict[str, Any]:
    """Description of the trial in a rig's folder; empty for other folders and for files."""
    path = folder / "trial.json"
    if not path.is_file():
        return {}
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")).items())
    except (AttributeError, OSError, ValueError, RecursionError) as error:
        what = "is not JSON of an object with the trial's description"
        raise BadRecord(f"{path}: {what}: {error}") from error


def described(record: Record, about: Mapping[str, Any], mass: float | None = None) -> Record:
    """A force record with mass, lags and scale from its ``trial.json``, empty without one.

    `mass` is that between load cell and friction [kg]; default the rig's, or 1 kg.
    """
    unsaid = () if about else ("no trial.json: all columns are assumed to have the same lag",)
    signals, gain_std = record.signals, 0.0
    try:
        own = about.get("parameters", {})
        rig_mass = float(own.get("plant.m", own.get("plant.J", 1.0)))
        lags = {str(k): float(v) for k, v in about.get("lags", {}).items()}
        if not 0 < rig_mass <= sys.float_info.max:
            raise ValueError
        if record.position_name == "x_fine":
            fine, gain_std = record.position, _UNSAID_GAIN_STD
            if calibration := about.get("calibration"):
                fine, gain_std = _by_eq_2_1(calibration, fine)
            signals = {**signals, "x_fine": fine}
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        raise BadRecord(
            "trial.json: expected `parameters` with a finite `plant.m` above 0 kg, `lags` in "
            "seconds by column and `calibration`, as `ballscrew rig` writes them"
        ) from None
    return replace(
        record,
        signals=signals,
        gain_std=gain_std,
        mass=rig_mass if mass is None else mass,
        lags=lags,
        delay_std=record.step / math.sqrt(12),
        about=about,
        notes=(*unsaid, *record.notes),
    )


def _by_eq_2_1(calibration: Mapping[str, Any], x_fine: Vector) -> tuple[Vector, float]:
    """Fine position by Eq. 2.1 with the trial's calibration, and its scale's standard deviation."""
    # the slope of the polynomial is wrong at small displacements: displacement is a + b/C
    c0, c1, c2 = (float(c) for c in calibration["polynomial_m_per_pF"])
    points = np.array(calibration["displacement_m"], dtype=float)
    capacitances = 1e12 * np.array(calibration["capacitance_F"], dtype=float)
    inverse = np.column_stack([np.ones(len(points)), 1 / capacitances])
    (a, b), (rest,), rank, _ = np.linalg.lstsq(inverse, points, rcond=None)
    if rank < 2 or b <= 0 or c2 == 0:
        raise ValueError
    freedom = len(points) - 2
    error = math.sqrt(rest / freedom / float(np.sum((inverse[:, 1] - inverse[:, 1].mean()) ** 2)))
    top = -c1 / (2 * c2)  # vertex of the parabola; the sensor is on the side of the calibration
    side = 1.0 if float(capacitances.mean()) > top else -1.0
    root = np.sqrt(np.maximum(top**2 - (c0 - x_fine) / c2, 0.0))
    # widened as Student's t with so few points
    wider = float(stdtrit(freedom, 0.975)) / 1.96
    return a + b / (top + side * root), wider * error / b
