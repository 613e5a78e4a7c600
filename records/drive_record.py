"""Read what a drive recorded: command, position and what else there is, from anybody's file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .bad_record import BadRecord
from .resolution import encoder_count
from .sampling import even_out
from .table import in_si, read_table, rename
from .velocity import INTEGRATED, VELOCITY, columns_wanted, with_position
from .velocity import QUANTITIES as VELOCITIES

Vector = npt.NDArray[np.float64]

VOLTAGE, CURRENT, FORCE = "voltage", "current", "force"
QUANTITIES: dict[str, tuple[str, ...]] = {
    "time": ("time",),
    "u": (VOLTAGE, CURRENT, FORCE, "torque"),
    "x": ("length", "angle"),
    VELOCITY: VELOCITIES,
    "i": (CURRENT,),
    "force": (FORCE, "torque"),
    "x_ref": ("length", "angle"),
    "temperature": ("temperature",),
}
"""What each column may measure; the first is meant where nothing is said."""
_SHORTEST = 1.0  # [s]
_FEWEST = 200  # samples
_LARGEST_WAY = 50.0  # [m]; more of it is taken for another unit
_LARGEST = {VOLTAGE: 1e4, CURRENT: 1e3, FORCE: 1e7}
_HOLES = 0.1  # share of the samples that may be empty
_SLOWEST = 0.05  # sampling interval from which on nothing of friction is seen [s]


@dataclass(frozen=True)
class DriveRecord:
    """Signals of one run at even instants.

    Attributes
    ----------
    name : str
    signals : mapping of str to ndarray, shape (n,)
        Columns by name, SI; ``time``, ``x`` and one of ``u`` and ``i`` are always there, and ``v``
        where `x` is its integral. What was recorded at a lower rate is NaN in between.
    step : float
        Sampling interval [s].
    command : {"voltage", "current", "force"}
        What `u` is, in V, A or N; "current" where there is no `u`.
    notes : tuple of str
        What was done to the record on reading.
    """

    name: str
    signals: Mapping[str, Vector]
    step: float
    command: str = VOLTAGE
    notes: tuple[str, ...] = ()

    @property
    def time(self) -> Vector:
        return self.signals["time"]

    @property
    def current_alone(self) -> bool:
        """Whether the current `i` is all that is known of the command: there is no `u`."""
        return "u" not in self.signals

    @property
    def u(self) -> Vector:
        """The command; there is none where `current_alone`."""
        return self.signals["u"]

    @property
    def x(self) -> Vector:
        return self.signals["x"]

    @property
    def velocity_alone(self) -> bool:
        """Whether the velocity was recorded and no position."""
        return VELOCITY in self.signals

    @cached_property
    def resolution(self) -> float:
        """Step of a counted position [m]; 0 if it is not counted."""
        return 0.0 if self.velocity_alone else encoder_count(self.x)


def read_drive_records(
    paths: Sequence[Path | str],
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
) -> list[DriveRecord]:
    """Read the records of one study, each at its own rate.

    Parameters
    ----------
    paths : sequence of Path or str
        CSV, MAT or Parquet files, or rig folders with ``record.csv``.
    mapping : mapping of str to str, optional
        ``theirs -> ours`` names of columns.
    units : mapping of str to str, optional
        Unit of a column (our name), see `Conversion`; default what the file says, else SI.
    lead : float, optional
        Way of the screw per turn [m], which makes ways and forces of angles and torques.

    Raises
    ------
    BadRecord
        If a file is no record, with one line that says why.
    """
    return [_read(Path(path), dict(mapping or {}), dict(units or {}), lead) for path in paths]


def _read(
    path: Path, mapping: Mapping[str, str], units: Mapping[str, str], lead: float | None
) -> DriveRecord:
    file = path / "record.csv" if path.is_dir() else path
    found = read_table(file)
    table = rename(
        found,
        mapping,
        columns_wanted(found, mapping, QUANTITIES),
        [("time",), ("u", "i"), ("x", VELOCITY)],
        "; leave cells empty where a slower instrument has no value",
    )
    signals, measured = in_si(table, units, QUANTITIES, lead)
    command = measured.get("u", CURRENT)
    command = FORCE if command == "torque" else command
    return check_record(str(path), signals, command, table.row)


def check_record(
    name: str,
    signals: Mapping[str, Vector],
    command: str = VOLTAGE,
    row: Callable[[int], int] = lambda k: k + 1,
) -> DriveRecord:
    """A record of columns in SI units, checked and at even instants.

    Parameters
    ----------
    name : str
    signals : mapping of str to ndarray, shape (n,)
        ``time``, ``x`` or ``v``, and ``u`` or ``i``; perhaps others.
    command : {"voltage", "current", "force"}, optional
        What `u` is.
    row : function of int, optional
        What the user calls a sample.

    Raises
    ------
    BadRecord
        If they cannot be a drive's record.
    """
    signals = {n: np.asarray(v, dtype=float) for n, v in signals.items()}
    motion = "x" if "x" in signals else VELOCITY
    needed = ("time", "u" if "u" in signals else "i", motion)
    samples = len(signals["time"])
    known = np.ones(samples, dtype=bool)
    for column in needed:
        there = np.isfinite(signals[column])
        bad = np.flatnonzero(~there)
        if len(bad) > _HOLES * samples:
            raise BadRecord(
                f"{name}: {column} is empty or not a number in {len(bad)} of {samples} samples, "
                f"the first in row {row(int(bad[0]))}; cut these samples out at an end, or repair "
                "the record"
            )
        known &= there
    for column, values in signals.items():
        if np.any(np.isinf(values[known])):
            raise BadRecord(f"{name}: {column} has infinite values")
    rows = np.flatnonzero(known)
    signals = {n: v[known] for n, v in signals.items() if np.any(np.isfinite(v[known]))}
    if len(rows) < _FEWEST:
        raise BadRecord(f"{name}: is too short: {len(rows)} samples, expected at least {_FEWEST}")
    signals, step, said = even_out(name, signals, lambda k: row(int(rows[k])))
    if step >= _SLOWEST:
        raise BadRecord(
            f"{name}: sampled every {step:.4g} s, at {1 / step:.3g} Hz: too slow to see friction, "
            "expected at least 100 Hz; if time is in milliseconds or microseconds, say "
            "--unit time=ms or time=us"
        )
    lasts = float(signals["time"][-1] - signals["time"][0])
    if lasts < _SHORTEST:
        raise BadRecord(f"{name}: lasts {lasts:.3g} s, expected at least {_SHORTEST:g} s")
    signals = with_position(signals, step)
    notes = [said] if said else []
    if motion == VELOCITY:
        notes.append(INTEGRATED)
    unit, other = ("m", "mm") if motion == "x" else ("m/s", "rpm")
    _check_size(name, motion, float(np.ptp(signals["x"])), _LARGEST_WAY, unit, other)
    if "u" in signals:
        unit, other = {VOLTAGE: ("V", "mV"), CURRENT: ("A", "mA"), FORCE: ("N", "mN")}[command]
        _check_size(name, "u", float(np.abs(signals["u"]).max()), _LARGEST[command], unit, other)
    if "i" in signals:
        _check_size(name, "i", float(np.nanmax(np.abs(signals["i"]))), _LARGEST[CURRENT], "A", "mA")
    return DriveRecord(name, signals, step, command, tuple(f"{name}: {n}" for n in notes))


def _check_size(name: str, column: str, size: float, largest: float, unit: str, other: str) -> None:
    if size > largest:
        raise BadRecord(
            f"{name}: {column} covers {size:.4g}{' m' if column == VELOCITY else ''}, too much for "
            f"{unit}; if it is in another unit, say so, as --unit {column}={other}"
        )
