"""Read what a drive recorded: command, position and what else there is, from anybody's file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .resolution import count_size
from .table import BadRecord, check_forwards, read_columns, renamed

Vector = npt.NDArray[np.float64]

COLUMNS = {
    "time": "s",
    "u": "V",
    "x": "m",
    "i": "A",
    "force": "N",
    "x_ref": "m",
    "temperature": "degC",
}
_NEEDED = ("time", "u", "x")
_SHORTEST = 1.0  # [s]
_FEWEST = 200  # samples
_LARGEST_WAY = 50.0  # [m]; more of it is taken for another unit
_LARGEST_COMMAND = 1e4
_LARGEST_CURRENT = 1e3
_JITTER = 0.2


@dataclass(frozen=True)
class DriveRecord:
    """Signals of one run at even instants.

    Attributes
    ----------
    name : str
    signals : mapping of str to ndarray, shape (n,)
        Columns by name, SI; ``time``, ``u`` and ``x`` are always there. What was recorded at a
        lower rate is NaN in between.
    step : float
        Sampling interval [s].
    """

    name: str
    signals: Mapping[str, Vector]
    step: float

    @property
    def time(self) -> Vector:
        return self.signals["time"]

    @property
    def u(self) -> Vector:
        return self.signals["u"]

    @property
    def x(self) -> Vector:
        return self.signals["x"]

    @cached_property
    def count(self) -> float:
        """Step of a counted position [m]; 0 if it is not counted."""
        return count_size(self.x)


def read_drive_records(
    paths: Sequence[Path | str], mapping: Mapping[str, str] | None = None
) -> list[DriveRecord]:
    """Read the records of one study, each at its own rate.

    Parameters
    ----------
    paths : sequence of Path or str
        CSV, MAT or Parquet files, or rig folders with ``record.csv``.
    mapping : mapping of str to str, optional
        ``theirs -> ours`` names of columns.

    Raises
    ------
    BadRecord
        If a file is no record, with one line that says why.
    """
    return [_read(Path(path), dict(mapping or {})) for path in paths]


def _read(path: Path, mapping: Mapping[str, str]) -> DriveRecord:
    file = path / "record.csv" if path.is_dir() else path
    signals = renamed(
        path,
        read_columns(file),
        mapping,
        list(COLUMNS),
        [(name,) for name in _NEEDED],
        "; leave cells empty where a slower instrument has no value",
    )
    return checked(str(path), signals)


def checked(name: str, signals: Mapping[str, Vector]) -> DriveRecord:
    """A record of columns in SI units, checked.

    Raises
    ------
    BadRecord
        If they cannot be a drive's record.
    """
    signals = {n: np.asarray(v, dtype=float) for n, v in signals.items()}
    time = signals["time"]
    for column in _NEEDED:
        bad = np.flatnonzero(~np.isfinite(signals[column]))
        if len(bad):
            raise BadRecord(
                f"{name}: {column} is empty or not a number in {len(bad)} of {len(time)} samples, "
                f"the first in row {bad[0] + 2}; cut these samples out at an end, or repair the "
                "record"
            )
    kept = {}
    for column, values in signals.items():
        if np.any(np.isinf(values)):
            raise BadRecord(f"{name}: {column} has infinite values")
        if np.any(np.isfinite(values)):
            kept[column] = values
    signals = kept
    if len(time) < _FEWEST:
        raise BadRecord(f"{name}: is too short: {len(time)} samples, expected at least {_FEWEST}")
    steps = check_forwards(name, time)
    step = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - step) > _JITTER * step)
    if len(uneven):
        k = int(uneven[0])
        raise BadRecord(
            f"{name}: uneven sampling: {steps[k]:.4g} s after {time[k]:.6g} s, elsewhere "
            f"{step:.4g} s ({len(uneven)} such); resample evenly, or cut the record into pieces "
            "without gaps"
        )
    lasts = float(time[-1] - time[0])
    if lasts < _SHORTEST:
        raise BadRecord(f"{name}: lasts {lasts:.3g} s, expected at least {_SHORTEST:g} s")
    for column, largest, hint in (
        ("x", _LARGEST_WAY, "m"),
        ("u", _LARGEST_COMMAND, "V"),
        ("i", _LARGEST_CURRENT, "A"),
    ):
        span = float(np.nanmax(np.abs(signals[column]))) if column in signals else 0.0
        if column == "x":
            span = float(np.ptp(signals["x"]))
        if span > largest:
            raise BadRecord(
                f"{name}: {column} covers {span:.4g}, too much for {hint}; bring the column to SI "
                "units"
            )
    if not math.isfinite(step):
        raise BadRecord(f"{name}: time is no number")
    return DriveRecord(name, signals, float(lasts / (len(time) - 1)))
