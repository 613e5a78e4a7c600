"""Estimates by the formulas of the thesis, and their known errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from ..records.record import Record
from .bliman_sorine_map import NoSolution, map_points, read_points
from .dahl_fit import fit_dahl
from .fitted_law import BRISTLES, LAWS
from .friction_estimation import FrictionEstimate
from .intervals import Interval, average, spread
from .lugre_dynamics import assumed_damping, held_stiffness, secant_bias
from .stribeck_fit import STUCK, StribeckPoints, fit_stribeck

Vector = npt.NDArray[np.float64]

TOGETHER = {  # parameters that are not separate coordinates of the fit
    "bliman_sorine": ("f1", "f2", "eta"),
    "maxwell_slip": tuple(n for n in LAWS["maxwell_slip"].parameters if n.startswith("alpha")),
}


def thesis_estimates(
    records: Sequence[Record],
    estimates: Sequence[FrictionEstimate],
    points: StribeckPoints,
    law: str,
) -> dict[str, Any]:
    """Estimates by the formulas of the thesis, and their known errors."""
    if law == "dahl":
        return _thesis_dahl(records, estimates)
    if law == "bliman_sorine":
        return _thesis_bliman_sorine(records, estimates)
    found = _thesis_lugre(records, estimates, points)
    if law not in BRISTLES:  # for the others the thesis has only the static curve
        return {"stribeck_eq_1_8": found["stribeck_eq_1_8"]}
    return found


def _thesis_lugre(
    records: Sequence[Record], estimates: Sequence[FrictionEstimate], points: StribeckPoints
) -> dict[str, Any]:
    result: dict[str, Any] = {"stribeck_eq_1_8": {}}
    sides: dict[str, dict[str, Interval]] = {}
    for side, sign in (("forwards", 1), ("backwards", -1)):
        try:
            sides[side] = fit_stribeck(points, sign)
            result["stribeck_eq_1_8"][side] = {n: asdict(i) for n, i in sides[side].items()}
        except ValueError as error:
            result["stribeck_eq_1_8"][side] = f"no fit: {error}"
    static = sides.get("forwards") or sides.get("backwards")
    if len(sides) == 2:
        static = {
            n: average(sides["forwards"][n], sides["backwards"][n])
            for n in ("Fc", "Fs", "Vs", "sigma2")
        }
        result["stribeck_eq_1_8"]["averaged"] = {n: asdict(i) for n, i in static.items()}
    trials = []
    fine = any(r.position_name == "x_fine" for r in records)
    for record, estimate in zip(records, estimates, strict=True):
        if fine and record.position_name != "x_fine":
            continue
        found = held_stiffness(record, estimate)
        if found is None:
            continue
        row: dict[str, Any] = {"record": record.name, "sigma0": found[0], "force": found[1]}
        if static and abs(found[1]) < static["Fs"].value:
            row["true_sigma0_share"] = secant_bias(abs(found[1]), static["Fs"].value)
        trials.append(row)
    if trials:
        values = [row["sigma0"] for row in trials]
        eq: dict[str, Any] = {"trials": trials, "mean": float(np.mean(values))}
        if len(values) > 1:
            eq["spread"] = asdict(spread(values))
        eq["bias"] = (
            "Eq. 2.14 assumes that presliding is a spring; for a true LuGre surface it gives "
            "only the share `true_sigma0_share` of sigma0, which decreases as the force "
            "approaches Fs"
        )
        result["sigma0_eq_2_14"] = eq
        if static:
            result["sigma1_eq_2_17"] = {
                "value": assumed_damping(
                    max(eq["mean"], 0.0), static["sigma2"].value, records[0].mass
                ),
                "note": "critical damping is assumed, not identified",
            }
    return result


def _thesis_dahl(
    records: Sequence[Record], estimates: Sequence[FrictionEstimate]
) -> dict[str, Any]:
    trials: list[dict[str, Any]] = []
    for record, estimate in zip(records, estimates, strict=True):
        x = estimate.motion.x - estimate.motion.x[0]
        end = int(np.argmax(np.abs(x))) + 1  # up to the first reversal
        if abs(x[end - 1]) < STUCK:
            continue
        try:
            found = fit_dahl(x[:end], estimate.friction[:end])
        except (ValueError, RuntimeError) as error:
            trials.append({"record": record.name, "no_fit": str(error)})
            continue
        trials.append(
            {
                "record": record.name,
                "direction": int(np.sign(x[end - 1])),
                **{n: asdict(i) for n, i in found.items()},
            }
        )
    result: dict[str, Any] = {"eqs_2_5_to_2_7": trials}
    for name in ("sigma", "Fc"):
        values = [t[name]["value"] for t in trials if name in t]
        table: dict[str, Any] = {}
        for side, sign in (("forwards", 1), ("backwards", -1)):
            own = [t[name]["value"] for t in trials if name in t and t["direction"] == sign]
            if own:
                table[side] = float(np.mean(own))
        if len(values) > 1:
            table["averaged"] = asdict(spread(values))
        result[name] = table
    return result


def _thesis_bliman_sorine(
    records: Sequence[Record], estimates: Sequence[FrictionEstimate]
) -> dict[str, Any]:
    trials = []
    for record, estimate in zip(records, estimates, strict=True):
        row: dict[str, Any] = {"record": record.name}
        branch = last_branch(estimate.motion.x)
        if branch is None:
            row["no_solution"] = "the motion has no complete branch of a second cycle"
        else:
            way = estimate.motion.x[branch] - estimate.motion.x[branch.start]
            sign = float(np.sign(way[-1]))
            try:
                row.update(
                    asdict(map_points(read_points(sign * way, sign * estimate.friction[branch])))
                )
            except NoSolution as error:
                row["no_solution"] = str(error)
        trials.append(row)
    return {"eqs_2_8_to_2_11": trials}


def last_branch(x: Vector) -> slice | None:
    """The last complete motion between two reversals, after the first two; None without one.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Position [m].
    """
    least = max(2 * STUCK, 0.1 * float(np.ptp(x)))
    turns: list[int] = []
    extreme, direction = 0, 0
    for k in range(1, len(x)):
        if direction == 0:
            if abs(x[k] - x[0]) > least:
                direction, extreme = (1 if x[k] > x[0] else -1), k
        elif direction * (x[k] - x[extreme]) > 0:
            extreme = k
        elif direction * (x[extreme] - x[k]) > least:
            turns.append(extreme)
            direction, extreme = -direction, k
    if len(turns) < 3:
        return None
    return slice(turns[-2], turns[-1] + 1)
