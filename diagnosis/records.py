"""Read what instruments recorded: a rig's folder, a CSV or a MAT file, anybody's.

Columns are mapped by name and units are said, never guessed: numbers that look like another unit
are refused with the two ways to say what is meant.
"""

from __future__ import annotations

import csv
import difflib
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

Vector = npt.NDArray[np.float64]

UNITS = {
    "time": "s",
    "x": "m",
    "x_fine": "m",
    "force": "N",
    "u": "V",
    "v_ref": "m/s",
    "force_ref": "N",
}
_FACTORS = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "V": {"V": 1.0, "mV": 1e-3},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6},
}
LEAST_SAMPLES = 20
FINE_RANGE = 1e-4  # of a fine position beside a coarse one; calibrated over 70 um [m]
JITTER = 0.2  # of a sampling interval; a missing sample makes a whole one
# Beyond these a column is refused unless its unit is said: range, and the unit it looks like. The
# thread of the screw is 0.262 m long.
_LARGEST = {"x": (0.3, "mm"), "x_fine": (0.02, "um"), "force": (2e3, "mN")}
_SMALLEST = {"force": (2e-3, "kN")}
_UNSAID_GAIN_DOUBT = 0.01  # of a fine position whose calibration is not told
_LONGEST_STEP = 0.5  # [s]


class BadRecord(ValueError):
    """The file cannot be used as a record; the message says where, why and what to do."""


@dataclass(frozen=True)
class Record:
    """What the instruments of one trial recorded.

    Attributes
    ----------
    name : str
    signals : mapping of str to ndarray, shape (n,)
        Columns by name, SI units: ``time``, ``force`` and ``x`` or ``x_fine`` are always there.
    step : float
        Sampling interval [s].
    mass : float
        Mass between load cell and friction [kg].
    lags : mapping of str to float
        How much later than the truth each column is, by its filter or sensor [s]; 0 if not named.
    delay_doubt : float
        Standard deviation of the delay between force and motion that nobody knows [s].
    gain_doubt : float
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
    delay_doubt: float = 0.0
    gain_doubt: float = 0.0
    about: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def time(self) -> Vector:
        return self.signals["time"]

    @property
    def force(self) -> Vector:
        return self.signals["force"]

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
) -> list[Record]:
    """Read several records; a folder of trial folders gives all of them.

    Parameters
    ----------
    paths : sequence of Path or str
        CSV or MAT files, rig folders (with ``record.csv``), or folders of such.
    mapping : mapping of str to str, optional
        ``theirs -> ours`` names of columns.
    units : mapping of str to str, optional
        Unit of a column (our name) where it is not SI.
    mass : float, optional
        Mass between load cell and friction [kg]; default the rig's, or 1 kg.

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
    return [read_record(path, mapping, units, mass) for path in found]


def read_record(
    path: Path | str,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    mass: float | None = None,
) -> Record:
    """Read one record and check it; see `read_records`."""
    path = Path(path)
    mapping, units = dict(mapping or {}), dict(units or {})
    for name, unit in units.items():
        if name not in UNITS:
            raise BadRecord(f"--unit {name}={unit}: columns are {', '.join(UNITS)}")
        if unit not in _FACTORS[UNITS[name]]:
            raise BadRecord(
                f"--unit {name}={unit}: expected one of {', '.join(_FACTORS[UNITS[name]])}"
            )
    about: dict[str, Any] = {}
    file = path
    if path.is_dir():
        file = path / "record.csv"
        about = _read_about(path / "trial.json")
    signals = renamed(
        path,
        read_columns(file),
        mapping,
        list(UNITS),
        (("time",), ("force",), ("x", "x_fine")),
        ": recorded at different rates? Bring them to one rate first",
    )
    _check_numbers(path, signals)
    for name, values in signals.items():
        signals[name] = values * _FACTORS[UNITS[name]][units.get(name, UNITS[name])]
    step = _check_time(path, signals["time"], "time" in units)
    for name, values in signals.items():
        _check_unit(path, name, values, name in units)
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
    notes = () if about else ("no trial.json: all columns are taken to have the same lag",)
    record = Record(
        name,
        signals,
        step,
        mass,
        _lags(about),
        delay_doubt=step / math.sqrt(12),
        about=about,
        notes=notes,
    )
    if record.position_name != "x_fine":
        return record
    fine, gain_doubt = _by_eq_2_1(about, signals["x_fine"])
    return replace(record, signals={**signals, "x_fine": fine}, gain_doubt=gain_doubt)


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
    """Fine position by Eq. 2.1 through the trial's own calibration, and the doubt of its scale.

    The instrument's polynomial bends away from the hyperbola that the plates follow: at small
    displacements its slope is wrong by several percent, in every trial in the same way. The
    polynomial is undone, and displacement fitted to the calibration's points as a + b/C.
    """
    calibration = about.get("calibration")
    if not isinstance(calibration, Mapping):
        return x_fine, _UNSAID_GAIN_DOUBT
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


def read_columns(path: Path) -> dict[str, Vector]:
    """All columns of a CSV, MAT or Parquet file by the names they have there.

    Raises
    ------
    BadRecord
        If the file is not there or no table of numbers.
    """
    readers = {".mat": _read_mat, ".parquet": _read_parquet}
    try:
        return readers.get(path.suffix.lower(), _read_csv)(path)
    except FileNotFoundError:
        raise BadRecord(f"{path}: there is no such file") from None
    except OSError as error:
        raise BadRecord(f"{path}: cannot be read: {error.strerror or error}") from error


def _read_parquet(path: Path) -> dict[str, Vector]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.is_file():
        raise FileNotFoundError
    try:
        table = pq.read_table(path)
    except pa.ArrowInvalid as error:
        raise BadRecord(f"{path}: is no Parquet file: {str(error).splitlines()[0]}") from error
    columns = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        try:
            columns[name] = np.asarray(column.cast(pa.float64()).to_numpy(), dtype=float)
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            continue  # words and dates are nobody's signal
    return columns


def _read_csv(path: Path) -> dict[str, Vector]:
    try:
        with open(path, newline="", encoding="utf-8-sig") as stream:
            sample = stream.read(4096)
            stream.seek(0)
            line = sample.splitlines()[0] if sample.strip() else ""
            separator = max(",;\t", key=line.count)
            rows = [r for r in csv.reader(stream, delimiter=separator) if any(c.strip() for c in r)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadRecord(f"{path}: is no text table: {error}") from error
    if not rows:
        raise BadRecord(f"{path}: is empty, expected a header row of names and rows of numbers")
    header = [name.strip() for name in rows[0]]
    if len(set(header)) < len(header):
        twice = next(n for n in header if header.count(n) > 1)
        raise BadRecord(f"{path}: the column {twice!r} is there twice")
    table = np.empty((len(rows) - 1, len(header)))
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise BadRecord(f"{path}, row {number}: {len(row)} cells, expected {len(header)}")
        for k, cell in enumerate(row):
            try:
                table[number - 2, k] = float(cell) if cell.strip() else math.nan
            except ValueError:
                raise BadRecord(
                    f"{path}, row {number}, column {header[k]!r}: {cell!r} is no number"
                ) from None
    return {name: table[:, k].copy() for k, name in enumerate(header)}


def _read_mat(path: Path) -> dict[str, Vector]:
    from scipy.io import loadmat

    try:
        data = loadmat(path)
    except NotImplementedError:
        raise BadRecord(
            f"{path}: is a MAT file of version 7.3; save it with `-v7` or as CSV"
        ) from None
    except FileNotFoundError:
        raise
    except Exception as error:  # the reader raises many kinds on damaged files
        raise BadRecord(f"{path}: is no MAT file: {error}") from error
    columns = {}
    for name, values in data.items():
        array = np.asarray(values)
        if (
            not name.startswith("__")
            and array.dtype.kind in "fiu"
            and array.size == max(array.shape, default=0)
        ):
            columns[name] = array.astype(float).ravel()
    return columns


def renamed(
    path: Path,
    columns: Mapping[str, Vector],
    mapping: Mapping[str, str],
    known: Sequence[str],
    needed: Sequence[Sequence[str]],
    if_unequal: str,
) -> dict[str, Vector]:
    """Columns under our names, in the order of ours, all of one length.

    Parameters
    ----------
    mapping : mapping of str to str
        ``theirs -> ours``.
    known : sequence of str
        Our names.
    needed : sequence of sequences of str
        One name at least of each has to be there.
    if_unequal : str
        What to say where lengths differ.

    Raises
    ------
    BadRecord
    """
    there = ", ".join(columns) or "none"
    for theirs, ours in mapping.items():
        if ours not in known:
            raise BadRecord(
                f"--map {theirs}={ours}: there is no {ours!r} here; columns are {', '.join(known)}"
            )
        if theirs not in columns:
            raise BadRecord(
                f"{path}: --map {theirs}={ours}: there is no column {theirs!r}"
                f"{near(theirs, columns)}; there are {there}"
            )
    taken = set(mapping.values())
    named = {n: v for n, v in columns.items() if n not in mapping and n not in taken}
    named |= {ours: columns[theirs] for theirs, ours in mapping.items()}
    named = {n: named[n] for n in known if n in named}
    for wanted, *others in needed:
        if not {wanted, *others} & named.keys():
            raise BadRecord(
                f"{path}: has no column {wanted!r}{near(wanted, columns)}; there are "
                f"{there}; use --map theirs={wanted}"
            )
    lengths = {n: len(v) for n, v in named.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{n} {k}" for n, k in lengths.items())
        raise BadRecord(f"{path}: columns of different length ({said} samples){if_unequal}")
    return named


def _check_numbers(path: Path, signals: Mapping[str, Vector]) -> None:
    for name, values in signals.items():
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
            f"the first in row {bad[0] + 2}{hint}"
        )


def check_forwards(name: Path | str, time: Vector) -> Vector:
    """The steps of a time that only grows [s], shape (n - 1,).

    Raises
    ------
    BadRecord
        If it does not.
    """
    steps = np.diff(time)
    back = np.flatnonzero(steps <= 0)
    if len(back):
        k = int(back[0])
        what = "stands still" if steps[k] == 0 else "goes backwards"
        raise BadRecord(
            f"{name}: time {what} in row {k + 3}: {time[k + 1]:.6g} s after {time[k]:.6g} s"
        )
    return steps


def _check_time(path: Path, time: Vector, said: bool) -> float:
    if len(time) < LEAST_SAMPLES:
        raise BadRecord(
            f"{path}: is too short: {len(time)} samples, expected at least {LEAST_SAMPLES}"
        )
    steps = check_forwards(path, time)
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
    unit = UNITS[name]
    span = float(np.ptp(values)) if name != "force" else float(np.abs(values).max())
    limit, other = _LARGEST[name]
    if span > limit:
        raise BadRecord(
            f"{path}: {name} covers {span:.4g}, too much for {unit}; if it is in {other} say "
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
                f"{path}: {name} is constant ({values[0]:.6g} {UNITS[name]}) over all "
                f"{len(values)} samples; a record needs motion and force"
            )


def near(name: str, names: object) -> str:
    """The names that look like `name`, in brackets, for a complaint."""
    close = difflib.get_close_matches(name, list(names), n=3, cutoff=0.4)  # type: ignore[call-overload]
    return f" (nearest: {', '.join(close)})" if close else ""
