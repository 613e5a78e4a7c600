"""Friction of two measured screw drives by direction, tested on held-out speeds and runs.

A lead screw and a worm drive were recorded by their motor controller at constant speeds and in
start and stop (A. Mablekos-Alexiou, L. da Cruz, C. Bergeles, "Friction-Inclusive Modeling of
Sliding Contact Transmission Systems in Robotics", IEEE Transactions on Robotics 37(4), 2021;
repository RViMLab/TRO2021-Dynamic-Modelling). The data are not included: ``BALLSCREW_TRO2021`` is
their folder. A picture of each drive is drawn beside the stored result.
"""

from __future__ import annotations

import math
import os
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from runner import FOLDER, ROOT, Row
from scipy.stats import t as student

from ballscrew.measurement.identification.fit import fit_along
from ballscrew.measurement.identification.fitted_law import OFFSET
from ballscrew.measurement.identification.identification import Identification
from ballscrew.measurement.identification.identify import identify
from ballscrew.measurement.identification.intervals import Fit
from ballscrew.measurement.records.reading import read_force_records
from ballscrew.measurement.records.record import Record
from ballscrew.orchestration.loop.pictures import COLOURS, styled_figure, write_figure
from ballscrew.solver.arrays import Vector
from ballscrew.solver.errors import BadRecord, UserError

DATA = Path(os.environ.get("BALLSCREW_TRO2021", ROOT.parent / "shared" / "data" / "TRO2021"))
AVERAGED = "actual value averaged"
COLUMNS = {"1": "time", f"Velocity {AVERAGED}": "v", f"Torque {AVERAGED}": "force"}
UNITS = {"v": "-1 rpm", "force": "-9.84e-5 N*m"}
PER_CENT = 9.84e-5  # one percent of the motor's nominal torque [N*m]
# for the worm drive, a metre is a thousand radians of the motor, a newton a mN*m at its shaft
DRIVES = {"lead_screw": ("driveNo1", 0.002), "worm_drive": ("driveNo3", 0.006283185307)}
LAW, STEADY = "classical", "steady_state/0.096kg"
FOLDS, CONFIDENCE = 4, 0.95
MODELS: dict[str, dict[str, Any]] = {
    "one friction": {"tied": True},
    "one friction and an offset": {"tied": True, "beside": (OFFSET,)},
    "a friction for each direction": {"tied": False},
}
STEP = 1e-4  # of finite differences in the coordinates
PLATEAU = 0.9  # share of a profile's speed at which it counts as reached
FEWEST_TURNS = 5.0  # needed to distinguish one to three periods per turn from a slow course


@dataclass(frozen=True)
class Point:
    """Mean velocity [m/s] and mean force [N] of a steady run."""

    name: str
    velocity: float
    force: float


@dataclass(frozen=True)
class Forecast(Point):
    """The same, with the prediction of a fit to other runs, and its 95 % interval [N]."""

    foretold: float
    half_width: float

    @property
    def holds(self) -> bool:
        return bool(abs(self.force - self.foretold) <= self.half_width)


def speed_of(path: Path | str) -> int:
    """The motor's speed in the name of a file [rpm], negative for the other direction."""
    return int(Path(path).stem.replace("n", "-"))


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
    return [
        Point(Path(r.name).name, float(v.mean()), float(r.force.mean()))
        for r in records
        if (v := r.signals["v"]).std() < abs(v.mean())
    ]


def curve(fit: Fit, coordinates: Vector, v: float) -> float:
    """Force of the fitted law at a constant velocity, Eq. 1.8, with its offset [N]."""
    values = dict(zip(fit.names, fit.law.values_at(coordinates), strict=True))
    end = "" if not fit.law.directional else "_pos" if v > 0 else "_neg"
    fc, fs, vs, viscous = (values[n + end] for n in ("Fc", "Fs", "Vs", "sigma2"))
    size = fc + (fs - fc) * math.exp(-((v / vs) ** 2)) + viscous * abs(v)
    return math.copysign(size, v) + values.get(OFFSET, 0.0)


def forecasts(fit: Fit, seen: Sequence[Point], new: Sequence[Point]) -> list[Forecast]:
    """Means of new runs; intervals by the fit's covariance and the scatter of the seen runs."""
    left = np.array([p.force - curve(fit, fit.coordinates, p.velocity) for p in seen])
    freedom = len(left) - len(fit.names)
    scatter = float(left @ left) / freedom
    quantile = float(student.ppf(0.5 + CONFIDENCE / 2, freedom))
    moved = fit.coordinates + STEP * np.eye(len(fit.coordinates))
    found = []
    for p in new:
        foretold = curve(fit, fit.coordinates, p.velocity)
        g = np.array([(curve(fit, c, p.velocity) - foretold) / STEP for c in moved])
        half = quantile * math.sqrt(float(g @ fit.covariance @ g) + scatter)
        found.append(Forecast(**asdict(p), foretold=foretold, half_width=half))
    return found


def speeds_left_out(records: Sequence[Record], per_cent: float) -> Row:
    """Predictions for each speed from the records of the other speeds, for each model."""
    speeds = sorted({abs(speed_of(r.name)) for r in records})
    rows: dict[str, list[Forecast]] = {name: [] for name in MODELS}
    for fold in range(FOLDS):
        out = {s for k, s in enumerate(speeds) if k % FOLDS == fold and 0 < k < len(speeds) - 1}
        new = [r for r in records if abs(speed_of(r.name)) in out]
        rest = [r for r in records if abs(speed_of(r.name)) not in out]
        for name, how in MODELS.items():
            fit = fit_along(rest, LAW, **how)
            rows[name] += forecasts(fit, steady_points(rest), steady_points(new))
    return {name: summary(found, per_cent) for name, found in rows.items()}


def summary(found: Sequence[Forecast], per_cent: float) -> Row:
    """Errors of forecasts, and number of intervals that contain the measured value."""
    error = np.array([f.force - f.foretold for f in found])
    return {
        "runs": len(found),
        "held": sum(f.holds for f in found),
        "rms_error_percent_of_nominal": float(np.sqrt(np.mean(error**2))) / per_cent,
        "missed": [asdict(f) for f in found if not f.holds],
    }


def plateaus(record: Record) -> list[Point]:
    """Both directions of a start and stop at full speed; accelerations are left out."""
    v, points = record.signals["v"], []
    for sign, way in ((1.0, "forwards"), (-1.0, "backwards")):
        usual = float(np.median(v[sign * v > 0.5 * np.max(sign * v)]))
        at = sign * v > PLATEAU * abs(usual)
        # the first and last sample may be in an acceleration
        inner = at & np.roll(at, 1) & np.roll(at, -1)
        means = float(v[inner].mean()), float(record.force[inner].mean())
        points.append(Point(f"{Path(record.name).name} {way}", *means))
    return points


def with_the_turn(record: Record, lead: float) -> float:
    """Share of a steady run's force variance that varies with the angle of the shaft.

    It has one to three periods per turn, after subtracting a straight line in time. The phase is
    free, because the start position of the run is not known.
    """

    def left_by(*columns: Vector) -> float:
        table = np.column_stack(columns)
        found, *_ = np.linalg.lstsq(table, record.force, rcond=None)
        return float(np.sum((record.force - table @ found) ** 2))

    time = record.time - record.time.mean()
    angle = 2 * math.pi * record.position / lead
    line = np.ones_like(time), time
    waves = (f(k * angle) for k in (1, 2, 3) for f in (np.sin, np.cos))
    return 1.0 - left_by(*line, *waves) / left_by(*line)


def told(result: Identification) -> Row:
    said = result.to_dict()
    kept = {k: said[k] for k in ("parameters", "per_direction")}
    return kept | {"unexplained_N": result.unexplained, "trusted": result.trusted}


def draw(name: str, fit: Fit, points: Sequence[Point], runs: Sequence[Point]) -> None:
    """Draw mean torque over speed, the fit with its band for another run, and start and stop."""
    rpm, per_cent = 60 / DRIVES[name][1], percent_of(DRIVES[name][1])
    top = max(abs(p.velocity) for p in points)
    with styled_figure(1, 1, (7.5, 4.2)) as (figure, ((axes,),)):
        for sign, label, colour in ((1, "forwards", COLOURS[0]), (-1, "backwards", COLOURS[1])):
            speeds = np.geomspace(0.005 * top, top, 120)
            said = forecasts(fit, points, [Point("", float(sign * v), 0.0) for v in speeds])
            middle, half = np.array([(abs(f.foretold), f.half_width) for f in said]).T / per_cent
            axes.plot(rpm * speeds, middle, color=colour, label=f"{label}, fitted")
            band = rpm * speeds, middle - half, middle + half
            axes.fill_between(*band, color=colour, alpha=0.2, lw=0)
            marks = (
                (points, "o", "steady runs", 4, colour),
                (runs, "D", "start and stop", 8, "none"),
            )
            for kind, marker, words, size, inside in marks:
                side = [(p.velocity, p.force) for p in kind if p.velocity * sign > 0]
                v, force = np.abs(side).T
                style = {"color": colour, "mfc": inside, "ms": size, "ls": "none"}
                axes.plot(rpm * v, force / per_cent, marker, label=f"{label}, {words}", **style)
        axes.set_xlabel("speed of the motor [rpm]")
        axes.set_ylabel("torque [% of nominal]")
        axes.legend(fontsize=8)
        write_figure(figure, FOLDER, f"tro2021_{name}")


def percent_of(lead: float) -> float:
    """Newtons of one percent of the nominal torque."""
    return PER_CENT * 2 * math.pi / lead


def tasks(asked: Namespace) -> dict[str, tuple[str]]:
    if not DATA.is_dir():
        raise UserError("the data are not here; see docs/measured-drives.md")
    return {name: (name,) for name in DRIVES}


def trial(name: str) -> Row:
    folder, lead = DATA / DRIVES[name][0], DRIVES[name][1]
    per_cent = percent_of(lead)
    records, refused = read_folder(folder / STEADY, lead)
    profiles, _ = read_folder(folder / "start_stop", lead)
    points = steady_points(records)
    fit = fit_along(records, LAW, tied=False)
    runs = [p for record in profiles for p in plateaus(record)]
    draw(name, fit, points, runs)
    turning = [r for r in records if float(np.ptp(r.position)) / lead > FEWEST_TURNS]
    return {
        "drive": name,
        "newtons_per_percent_of_nominal": per_cent,
        "steady_runs": len(records),
        "refused": refused,
        "sticks_and_slips": sorted({Path(r.name).name for r in records} - {p.name for p in points}),
        "by_direction": told(identify(records, LAW)),
        "with_an_offset": told(identify(records, LAW, offset=True)),
        "share_of_it_with_the_turn": float(np.median([with_the_turn(r, lead) for r in turning])),
        "speeds_left_out": speeds_left_out(records, per_cent),
        "start_stop": summary(forecasts(fit, points, runs), per_cent),
    }


def report(rows: Sequence[Row]) -> Row:
    return {row["drive"]: row for row in rows}


def says(report: Row) -> str:
    drives = [report[d]["speeds_left_out"] for d in DRIVES if d in report]
    left_out = [models["a friction for each direction"] for models in drives]
    held = " and ".join(f"{found['held']} of {found['runs']}" for found in left_out)
    return f"by direction, {held} means of speeds left out are in their intervals"
