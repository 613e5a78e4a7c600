"""Proof: friction of two measured screw drives by direction, tested on held-out speeds and runs.

A lead screw and a worm drive were recorded by their motor controller at constant speeds and in
start and stop (A. Mablekos-Alexiou, L. da Cruz, C. Bergeles, "Friction-Inclusive Modeling of
Sliding Contact Transmission Systems in Robotics", IEEE Transactions on Robotics 37(4), 2021;
repository RViMLab/TRO2021-Dynamic-Modelling). Writes ``docs/proof/tro2021.json`` and a picture of
each drive. The data are not included: the first argument, or ``BALLSCREW_TRO2021``, is their
folder.
"""

from __future__ import annotations

import os

from ballscrew.solver.errors import BadRecord

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from provenance import provenance
from scipy.stats import t as student

from ballscrew.measurement.identification.fit import fit_along
from ballscrew.measurement.identification.fitted_law import OFFSET
from ballscrew.measurement.identification.identification import Identification
from ballscrew.measurement.identification.identify import identify
from ballscrew.measurement.identification.intervals import Fit
from ballscrew.measurement.records.reading import read_force_records
from ballscrew.measurement.records.record import Record
from ballscrew.orchestration.loop.pictures import COLOURS, STYLE, new_figure, write_figure
from ballscrew.solver.files import write_atomically

Vector = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "tro2021.json"
DATA = Path(os.environ.get("BALLSCREW_TRO2021", ROOT.parent / "shared" / "data" / "TRO2021"))
COLUMNS = {
    "1": "time",
    "Velocity actual value averaged": "v",
    "Torque actual value averaged": "force",
}
UNITS = {"v": "-1 rpm", "force": "-9.84e-5 N*m"}
PER_CENT = 9.84e-5  # one percent of the motor's nominal torque [N*m]
# for the worm drive, a metre means a thousand radians of the motor, and a newton a mN*m at its
# shaft
DRIVES = {"lead_screw": ("driveNo1", 0.002), "worm_drive": ("driveNo3", 0.006283185307)}
LAW = "classical"
FOLDS = 4
MODELS = {
    "one friction": {"tied": True},
    "one friction and an offset": {"tied": True, "beside": (OFFSET,)},
    "a friction for each direction": {"tied": False},
}
STEADY = "steady_state/0.096kg"
_STEP = 1e-4  # step of finite differences in the coordinates
_PLATEAU = 0.9  # share of a profile's speed at which it counts as reached
_CONFIDENCE = 0.95
_FEWEST_TURNS = 5.0  # needed to distinguish one to three periods per turn from a slow course


@dataclass(frozen=True)
class Point:
    """Mean velocity [m/s] and mean force [N] of a steady run."""

    name: str
    velocity: float
    force: float


def speed_of(path: Path) -> int:
    """The motor's speed in the name of a file [rpm], negative for the other direction."""
    return int(path.stem.replace("n", "-"))


def read_folder(folder: Path, lead: float) -> tuple[list[Record], dict[str, str]]:
    """Records in the order of their speeds, and reasons why others were rejected."""
    records, refused = [], {}
    for path in sorted(folder.glob("*.csv"), key=speed_of):
        try:
            records += read_force_records([path], COLUMNS, UNITS, 0.0, lead)
        except BadRecord as error:
            refused[path.name] = str(error).replace(f"{path}, ", "")
    return records, refused


def steady_points(records: Sequence[Record]) -> list[Point]:
    """Means of the records whose velocity varies by less than its mean: others stick and slip."""
    points = []
    for r in records:
        v = r.signals["v"]
        if v.std() < abs(v.mean()):
            points.append(Point(Path(r.name).name, float(v.mean()), float(r.force.mean())))
    return points


def curve(fit: Fit, coordinates: Vector, v: float) -> float:
    """Force of the fitted law at a constant velocity, Eq. 1.8, with its offset [N]."""
    values = dict(zip(fit.names, fit.law.values_at(coordinates), strict=True))
    end = "" if not fit.law.directional else "_pos" if v > 0 else "_neg"
    fc, fs, vs, viscous = (values[n + end] for n in ("Fc", "Fs", "Vs", "sigma2"))
    size = fc + (fs - fc) * math.exp(-((v / vs) ** 2)) + viscous * abs(v)
    return math.copysign(size, v) + values.get(OFFSET, 0.0)


def slope(fit: Fit, v: float) -> Vector:
    """Derivatives of `curve` by the coordinates, shape (p,)."""
    here = curve(fit, fit.coordinates, v)
    moved = fit.coordinates + _STEP * np.eye(len(fit.coordinates))
    return np.array([(curve(fit, c, v) - here) / _STEP for c in moved])


@dataclass(frozen=True)
class Forecast:
    """Prediction of a fit for the mean force of another run, with its 95 % interval [N]."""

    name: str
    velocity: float
    measured: float
    foretold: float
    half_width: float

    @property
    def holds(self) -> bool:
        return bool(abs(self.measured - self.foretold) <= self.half_width)


def forecasts(fit: Fit, seen: Sequence[Point], new: Sequence[Point]) -> list[Forecast]:
    """Means of new runs; intervals by the fit's covariance and the scatter of the seen runs."""
    left = np.array([p.force - curve(fit, fit.coordinates, p.velocity) for p in seen])
    freedom = len(left) - len(fit.names)
    scatter = float(left @ left) / freedom
    quantile = float(student.ppf(0.5 + _CONFIDENCE / 2, freedom))
    found = []
    for p in new:
        g = slope(fit, p.velocity)
        half = quantile * math.sqrt(float(g @ fit.covariance @ g) + scatter)
        foretold = curve(fit, fit.coordinates, p.velocity)
        found.append(Forecast(p.name, p.velocity, p.force, foretold, half))
    return found


def speeds_left_out(records: Sequence[Record], per_cent: float) -> dict[str, Any]:
    """Predictions for each speed from the records of the other speeds, for each model."""
    speeds = sorted({abs(speed_of(Path(r.name))) for r in records})
    rows: dict[str, list[Forecast]] = {name: [] for name in MODELS}
    for fold in range(FOLDS):
        out = {s for k, s in enumerate(speeds) if k % FOLDS == fold and 0 < k < len(speeds) - 1}
        new = [r for r in records if abs(speed_of(Path(r.name))) in out]
        rest = [r for r in records if abs(speed_of(Path(r.name))) not in out]
        for name, how in MODELS.items():
            fit = fit_along(rest, LAW, **how)
            rows[name] += forecasts(fit, steady_points(rest), steady_points(new))
        print(f"fold {fold + 1} of {FOLDS}", file=sys.stderr)
    return {name: summary(found, per_cent) for name, found in rows.items()}


def summary(found: Sequence[Forecast], per_cent: float) -> dict[str, Any]:
    """Errors of forecasts, and number of intervals that contain the measured value."""
    error = np.array([f.measured - f.foretold for f in found])
    measured = np.array([f.measured for f in found])
    return {
        "runs": len(found),
        "held": sum(f.holds for f in found),
        "rms_error_percent_of_nominal": float(np.sqrt(np.mean(error**2))) / per_cent,
        "rms_error_share": float(np.sqrt(np.mean((error / measured) ** 2))),
        "half_width_percent_of_nominal": float(np.median([f.half_width for f in found])) / per_cent,
        "missed": [asdict(f) for f in found if not f.holds],
    }


def plateaus(record: Record) -> list[Point]:
    """Both directions of a start and stop at full speed; accelerations are left out."""
    name = Path(record.name)
    v, points = record.signals["v"], []
    for sign in (1.0, -1.0):
        usual = float(np.median(v[sign * v > 0.5 * np.max(sign * v)]))
        at = sign * v > _PLATEAU * abs(usual)
        # the first and last sample may be in an acceleration
        inner = at & np.roll(at, 1) & np.roll(at, -1)
        words = f"{name.name} {'forwards' if sign > 0 else 'backwards'}"
        points.append(Point(words, float(v[inner].mean()), float(record.force[inner].mean())))
    return points


def turns(record: Record, lead: float) -> float:
    """Turns of the motor's shaft in a record."""
    return float(np.ptp(record.position)) / lead


def with_the_turn(record: Record, lead: float) -> float:
    """Share of a steady run's force variance that varies with the angle of the shaft.

    It has one to three periods per turn, after subtracting a straight line in time. The phase is
    free, because the start position of the run is not known.
    """
    time = record.time - record.time.mean()
    angle = 2 * math.pi * record.position / lead
    line = np.column_stack([np.ones_like(time), time])
    waves = [f(k * angle) for k in (1, 2, 3) for f in (np.sin, np.cos)]
    rest = [left_by(columns, record.force) for columns in (line, np.column_stack([line, *waves]))]
    return 1.0 - rest[1] / rest[0]


def left_by(columns: Vector, values: Vector) -> float:
    """Residual sum of squares of a linear fit."""
    found, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return float(np.sum((values - columns @ found) ** 2))


def told(result: Identification) -> dict[str, Any]:
    said = result.to_dict()
    brief = ("value", "unit", "low", "high", "identified")
    return {
        "parameters": {n: {k: i[k] for k in brief} for n, i in said["parameters"].items()},
        "per_direction": {
            side: {n: {k: i[k] for k in brief} for n, i in table.items()}
            for side, table in said["per_direction"].items()
        },
        "unexplained_N": result.unexplained,
        "trusted": result.trusted,
        "warnings": said["warnings"],
    }


def draw(
    name: str,
    fit: Fit,
    points: Sequence[Point],
    runs: Sequence[Point],
    per_cent: float,
    lead: float,
) -> None:
    """Draw mean torque over speed, the fit with its band for another run, and start and stop."""
    rpm = 60 / lead
    with mpl.rc_context(STYLE):
        figure, ((axes,),) = new_figure(1, 1, (7.5, 4.2))
        top = max(abs(p.velocity) for p in points)
        for sign in (1.0, -1.0):
            speeds = sign * np.geomspace(0.005 * top, top, 120)
            asked = [Point("", float(v), 0.0) for v in speeds]
            said = forecasts(fit, points, asked)
            middle = np.array([abs(f.foretold) for f in said]) / per_cent
            half = np.array([f.half_width for f in said]) / per_cent
            colour = COLOURS[0 if sign > 0 else 1]
            label = "forwards" if sign > 0 else "backwards"
            axes.plot(rpm * np.abs(speeds), middle, color=colour, label=f"{label}, fitted")
            axes.fill_between(
                rpm * np.abs(speeds), middle - half, middle + half, color=colour, alpha=0.2, lw=0
            )
            for kind, marker in ((points, "o"), (runs, "D")):
                side = [p for p in kind if p.velocity * sign > 0]
                axes.plot(
                    [rpm * abs(p.velocity) for p in side],
                    [abs(p.force) / per_cent for p in side],
                    marker,
                    color=colour,
                    mfc=colour if marker == "o" else "none",
                    ms=4 if marker == "o" else 8,
                    ls="none",
                    label=f"{label}, {'steady runs' if marker == 'o' else 'start and stop'}",
                )
        axes.set_xlabel("speed of the motor [rpm]")
        axes.set_ylabel("torque [% of nominal]")
        axes.legend(fontsize=8)
        write_figure(figure, TARGET.parent, f"tro2021_{name}")


def examine_drive(name: str, folder: Path, lead: float) -> dict[str, Any]:
    """All results for one drive."""
    per_cent = PER_CENT * 2 * math.pi / lead
    records, refused = read_folder(folder / STEADY, lead)
    profiles, _ = read_folder(folder / "start_stop", lead)
    points = steady_points(records)
    fit = fit_along(records, LAW, tied=False)
    runs = [p for record in profiles for p in plateaus(record)]
    start_stop = forecasts(fit, points, runs)
    left = [p.force - curve(fit, fit.coordinates, p.velocity) for p in points]
    draw(name, fit, points, runs, per_cent, lead)
    within = [float(r.force.std()) for r in records]
    return {
        "newtons_per_percent_of_nominal": per_cent,
        "steady_runs": len(records),
        "refused": refused,
        "sticks_and_slips": sorted({Path(r.name).name for r in records} - {p.name for p in points}),
        "sampling_s": [min(r.step for r in records), max(r.step for r in records)],
        "by_direction": told(identify(records, LAW)),
        "with_an_offset": told(identify(records, LAW, offset=True)),
        "scatter_of_runs_percent_of_nominal": float(np.std(left)) / per_cent,
        "spread_within_a_run_percent_of_nominal": float(np.median(within)) / per_cent,
        "share_of_it_with_the_turn": float(
            np.median([with_the_turn(r, lead) for r in records if turns(r, lead) > _FEWEST_TURNS])
        ),
        "speeds_left_out": speeds_left_out(records, per_cent),
        "start_stop": {
            **summary(start_stop, per_cent),
            "rows": [asdict(f) | {"holds": f.holds} for f in start_stop],
        },
    }


def main() -> int:
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else DATA
    if not data.is_dir():
        print("the data are not here; see docs/measured-drives.md", file=sys.stderr)
        return 2
    report: dict[str, Any] = dict(provenance("tro2021"))
    for name, (folder, lead) in DRIVES.items():
        print(name, file=sys.stderr)
        report[name] = examine_drive(name, data / folder, lead)
        write_atomically(TARGET, (json.dumps(report, indent=1) + "\n").encode())
    for name in DRIVES:
        for what, found in report[name]["speeds_left_out"].items():
            print(f"{name}, speeds left out, {what}: {found['held']} of {found['runs']} hold")
        found = report[name]["start_stop"]
        print(f"{name}, start and stop: {found['held']} of {found['runs']} hold")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
