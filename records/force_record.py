"""Read what instruments recorded: a rig's folder, a CSV or a MAT file, anybody's.

Columns are mapped by name and units are said, never guessed: numbers that look like another unit
are refused with the two ways to say what is meant.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from .bad_record import BadRecord
from .sampling import JITTER, check_forwards
from .table import Table, in_si, read_table, rename
from .velocity import INTEGRATED, VELOCITY, columns_wanted, with_position
from .velocity import QUANTITIES as VELOCITIES

Vector = npt.NDArray[np.float64]

QUANTITIES = {
    "time": ("time",),
    "x": ("length", "angle"),
    "x_fine": ("length",),
    VELOCITY: VELOCITIES,
    "force": ("force", "torque"),
    "u": ("voltage",),
    "v_ref": ("velocity", "angular velocity"),
    "force_ref": ("force", "torque"),
}
"""What each column may measure; the first is meant where nothing is said."""
LEAST_SAMPLES = 20
FINE_RANGE = 1e-4  # of a fine position beside a coarse one; calibrated over 70 um [m]
# Beyond these a column is refused unless its unit is said: range, and the unit it looks like. The
# thread of the screw is 0.262 m long.
_LARGEST = {
    "x": (0.3, "mm"),
    "x_fine": (0.02, "um"),
    VELOCITY: (0.3, "mm/s"),  # of its integral
    "force": (2e3, "mN"),
}
_SMALLEST = {"force": (2e-3, "kN")}
_UNSAID_GAIN_STD = 0.01  # of a fine position whose calibration is not told
_LONGEST_STEP = 0.5  # [s]
_SI = {"x": "m", "x_fine": "m", VELOCITY: "m/s", "force": "N"}


@dataclass(frozen=True)
class Record:
    """What the instruments of one trial recorded.

    Attributes
    ----------
    name : str
    signals : mapping of str to ndarray, shape (n,)
        Columns by name, SI units: ``time``, ``force`` and ``x`` or ``x_fine`` are always there, and
        ``v`` where `x` is its integral.
    step : float
        Sampling interval [s].
    mass : float
        Mass between load cell and friction [kg].
    lags : mapping of str to float
        How much later than the truth each column is, by its filter or sensor [s]; 0 if not named.
    delay_std : float
        Standard deviation of the delay between force and motion that nobody knows [s].
    gain_std : float
        Standard deviation of the scale of `position`, as its calibration leaves it [1].
    about : mapping
        The rig's ``trial.json``, if there is one.
    notes : tuple of str
        What a reader should know.
    """

    name: str
    signals: Mapping[str, Vector]
    step: float
    mass: float = 1.0
    lags: Mapping[str, float] = field(default_factory=dict)
    delay_std: float = 0.0
    gain_std: float = 0.0
    about: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def time(self) -> Vector:
        return self.signals["time"]

    @property
    def force(self) -> Vector:
        return self.signals["force"]

    @property
    def velocity_alone(self) -> bool:
        """Whether the velocity was recorded and no position."""
        return VELOCITY in self.signals

    @property
    def position_name(self) -> str:
        """The finer of the two position columns, within its range, that the record has."""
        if "x_fine" not in self.signals:
            return "x"
        within = "x" not in self.signals or float(np.ptp(self.signals["x"])) < FINE_RANGE
        return "x_fine" if within else "x"

    @property
    def position(self) -> Vector:
        return self.signals[self.position_name]


def read_records(
    paths: Sequence[Path | str],
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    mass: float | None = None,
    lead: float | None = None,
) -> list[Record]:
    """Read several records; a folder of trial folders gives all of them.

    Parameters
    ----------
    paths : sequence of Path or str
        CSV or MAT files, rig folders (with ``record.csv``), or folders of such.
    mapping : mapping of str to str, optional
        ``theirs -> ours`` names of columns.
    units : mapping of str to str, optional
        Unit of a column (our name), see `Conversion`; default what the file says, else SI.
    mass : float, optional
        Mass between load cell and friction [kg]; default the rig's, or 1 kg.
    lead : float, optional
        Way of the screw per turn [m], which makes ways and forces of angles and torques.

    Raises
    ------
    BadRecord
        If a file is no record, with one line that says why.
    """
    found: list[Path] = []
    for path in map(Path, paths):
        if path.is_dir() and not (path / "record.csv").is_file():
            inner = sorted(p.parent for p in path.glob("*/record.csv"))
            if not inner:
                raise BadRecord(
                    f"{path}: holds no record.csv, nor does a folder in it; expected a folder that "
                    "`ballscrew rig` wrote, or a CSV or MAT file"
                )
            found += inner
        else:
            found.append(path)
    return [read_record(path, mapping, units, mass, lead) for path in found]


def read_record(
    path: Path | str,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    mass: float | None = None,
    lead: float | None = None,
) -> Record:
    """Read one record and check it; see `read_records`."""
    path = Path(path)
    mapping, units = dict(mapping or {}), dict(units or {})
    about: dict[str, Any] = {}
    file = path
    if path.is_dir():
        file = path / "record.csv"
        about = _read_about(path / "trial.json")
    found = read_table(file)
    table = rename(
        found,
        mapping,
        columns_wanted(found, mapping, QUANTITIES),
        (("time",), ("force",), ("x", "x_fine", VELOCITY)),
        ": recorded at different rates? Bring them to one rate first",
    )
    _check_numbers(path, table)
    said = {*units, *table.units}
    signals, _ = in_si(table, units, QUANTITIES, lead)
    step = _check_time(path, signals["time"], "time" in said, table)
    signals = with_position(signals, step)
    for name in signals.keys() - {VELOCITY}:
        theirs = VELOCITY if name == "x" and VELOCITY in signals else name
        _check_unit(path, theirs, signals[name], theirs in said)
    if mass is None:
        mass = _rig_mass(about)
    if not (math.isfinite(mass) and mass >= 0):
        raise BadRecord(f"the mass is {mass} kg, expected a number of at least 0")
    record = with_description(str(path), signals, step, mass, about)
    _check_motion(path, record)
    return record


def with_description(
    name: str,
    signals: Mapping[str, Vector],
    step: float,
    mass: float,
    about: Mapping[str, Any],
) -> Record:
    """The record of signals in SI units, with what its ``trial.json`` says of lags and scale.

    Raises
    ------
    BadRecord
        If `about` is not what a rig writes.
    """
    notes = [] if about else ["no trial.json: all columns are taken to have the same lag"]
    if VELOCITY in signals:
        notes.append(INTEGRATED)
    record = Record(
        name,
        signals,
        step,
        mass,
        _lags(about),
        delay_std=step / math.sqrt(12),
        about=about,
        notes=tuple(notes),
    )
    if record.position_name != "x_fine":
        return record
    fine, gain_std = _by_eq_2_1(about, signals["x_fine"])
    return replace(record, signals={**signals, "x_fine": fine}, gain_std=gain_std)


def _read_about(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise BadRecord(f"{path}: is no JSON: {error}") from error
    if not isinstance(data, dict):
        raise BadRecord(f"{path}: expected a JSON object with the trial's description")
    return data


def _lags(about: Mapping[str, Any]) -> dict[str, float]:
    lags = about.get("lags", {})
    if not isinstance(lags, Mapping):
        raise BadRecord("trial.json: expected `lags` to give a number of seconds by column")
    try:
        return {str(k): float(v) for k, v in lags.items()}
    except (TypeError, ValueError, OverflowError):
        raise BadRecord(
            "trial.json: expected `lags` to give a number of seconds by column"
        ) from None


def _by_eq_2_1(about: Mapping[str, Any], x_fine: Vector) -> tuple[Vector, float]:
    """Fine position by Eq. 2.1 through the trial's own calibration, and its scale's deviation.

    The instrument's polynomial bends away from the hyperbola that the plates follow: at small
    displacements its slope is wrong by several percent, in every trial in the same way. The
    polynomial is undone, and displacement fitted to the calibration's points as a + b/C.
    """
    calibration = about.get("calibration")
    if not isinstance(calibration, Mapping):
        return x_fine, _UNSAID_GAIN_STD
    try:
        c0, c1, c2 = (float(c) for c in calibration["polynomial_m_per_pF"])
        points = np.array(calibration["displacement_m"], dtype=float)
        capacitances = 1e12 * np.array(calibration["capacitance_F"], dtype=float)
        inverse = np.column_stack([np.ones(len(points)), 1 / capacitances])
        (a, b), (rest,), rank, _ = np.linalg.lstsq(inverse, points, rcond=None)
        if rank < 2 or b <= 0 or c2 == 0:
            raise ValueError
    except (ArithmeticError, LookupError, TypeError, ValueError, np.linalg.LinAlgError):
        raise BadRecord(
            "trial.json: expected `calibration` with `polynomial_m_per_pF` (three numbers), "
            "`displacement_m` and `capacitance_F` (as many as were taken, all different)"
        ) from None
    freedom = len(points) - 2
    error = math.sqrt(rest / freedom / float(np.sum((inverse[:, 1] - inverse[:, 1].mean()) ** 2)))
    top = -c1 / (2 * c2)  # of the parabola; the sensor is on the side of the calibration
    side = 1.0 if float(capacitances.mean()) > top else -1.0
    root = np.sqrt(np.maximum(top**2 - (c0 - x_fine) / c2, 0.0))
    # as wide as Student's t with so few points
    wider = float(student.ppf(0.975, freedom)) / 1.96
    return a + b / (top + side * root), wider * error / b


def _rig_mass(about: Mapping[str, Any]) -> float:
    parameters = about.get("parameters")
    if isinstance(parameters, Mapping) and isinstance(parameters.get("plant.m"), int | float):
        mass = parameters["plant.m"]
        if not 0 < mass <= sys.float_info.max:
            raise BadRecord("trial.json: expected `plant.m` to be a finite mass above 0 kg")
        return float(mass)
    return 1.0


def _check_numbers(path: Path, table: Table) -> None:
    for name, values in table.columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if not len(bad):
            continue
        period = int(np.diff(bad).max()) if len(bad) > 1 else 0
        hint = (
            "; a column recorded at a lower rate? Bring all to one rate first"
            if len(bad) > len(values) / 3 and period <= 3
            else "; cut these samples out at an end, or repair the record"
        )
        raise BadRecord(
            f"{path}: {name} is empty or not a number in {len(bad)} of {len(values)} samples, "
            f"the first in row {table.row(int(bad[0]))}{hint}"
        )


def _check_time(path: Path, time: Vector, said: bool, table: Table) -> float:
    if len(time) < LEAST_SAMPLES:
        raise BadRecord(
            f"{path}: is too short: {len(time)} samples, expected at least {LEAST_SAMPLES}"
        )
    steps = check_forwards(path, time, table.row)
    step = float(np.median(steps))
    if step > _LONGEST_STEP and not said:
        raise BadRecord(
            f"{path}: time goes in steps of {step:.4g}; if these are milliseconds say "
            "--unit time=ms, if they are seconds say --unit time=s"
        )
    gap = np.flatnonzero(steps > 1.6 * step)
    if len(gap):
        k = int(gap[0])
        raise BadRecord(
            f"{path}: a gap of {steps[k]:.4g} s after {time[k]:.6g} s, where the sampling interval "
            f"is {step:.4g} s ({len(gap)} such); cut the record into pieces without gaps"
        )
    uneven = np.flatnonzero(np.abs(steps - step) > JITTER * step)
    if len(uneven):
        k = int(uneven[0])
        raise BadRecord(
            f"{path}: uneven sampling: {steps[k]:.4g} s after {time[k]:.6g} s, elsewhere "
            f"{step:.4g} s; resample the record evenly"
        )
    return float((time[-1] - time[0]) / (len(time) - 1))


def _check_unit(path: Path, name: str, values: Vector, said: bool) -> None:
    if said or name not in _LARGEST:
        return
    unit = _SI[name]
    span = float(np.ptp(values)) if name != "force" else float(np.abs(values).max())
    way = " m" if name == VELOCITY else ""
    limit, other = _LARGEST[name]
    if span > limit:
        raise BadRecord(
            f"{path}: {name} covers {span:.4g}{way}, too much for {unit}; if it is in {other} say "
            f"--unit {name}={other}, if it is in {unit} say --unit {name}={unit}"
        )
    limit, other = _SMALLEST.get(name, (0.0, ""))
    if 0 < span < limit:
        raise BadRecord(
            f"{path}: {name} reaches only {span:.4g}, too little for {unit}; if it is in {other} "
            f"say --unit {name}={other}, if it is in {unit} say --unit {name}={unit}"
        )


def _check_motion(path: Path, record: Record) -> None:
    for name in (record.position_name, "force"):
        values = record.signals[name]
        if np.ptp(values) == 0:
            raise BadRecord(
                f"{path}: {name} is constant ({values[0]:.6g} {_SI[name]}) over all "
                f"{len(values)} samples; a record needs motion and force"
            )
