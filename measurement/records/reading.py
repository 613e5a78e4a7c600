"""Read records: a rig's folder, or a file of any known format.

Columns are mapped by name, and units must be given, they are never guessed. Numbers that look like
another unit are rejected, with advice.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from .record import CURRENT, FORCE, TORQUE, VELOCITY, VOLTAGE, Record
from .rig_trial import described, read_about
from .sampling import HOLES, even_out, pieces_between_gaps, recounted
from .table import choose, in_si, read_tables
from .units import UNITS

Integers = npt.NDArray[np.int64]
Names = Mapping[str, str] | None
Paths = Iterable[Path | str]
Size = float | None

QUANTITIES: dict[str, tuple[str, ...]] = {
    "time": ("time",),
    "x": ("length", "angle"),
    "x_fine": ("length",),
    VELOCITY: ("velocity", "angular velocity"),
    "force": (FORCE, TORQUE),
    "u": (VOLTAGE, CURRENT, FORCE, TORQUE),
    "i": (CURRENT,),
    "x_ref": ("length", "angle"),
    "v_ref": ("velocity", "angular velocity"),
    "force_ref": (FORCE, TORQUE),
    "temperature": ("temperature",),
}
"""Possible quantities of each column; the first is used if nothing is given."""
INTEGRATED = (
    "x is the integral of v: the start position is not known, and errors of v add up, so that "
    "effects of position cannot be identified"
)
_LOWER_RATE = "was the column recorded at a lower rate? Resample all columns to one rate first"
_POSITIONS = {"x", "x_fine"}


class _Use(NamedTuple):
    """Requirements of one use of records."""

    columns: tuple[str, ...]
    needed: tuple[tuple[str, ...], ...]  # at least one column of each
    samples: int  # least number
    believes: bool  # accept any number if its unit is given
    slowest: float  # largest accepted sampling interval [s]
    # largest value, and the unit that larger ones look like; the same of small ones
    limits: Mapping[str, tuple[float, str, float, str]]
    lasts: float = 0.0  # shortest [s]


FORCE_RECORD = _Use(
    columns=("time", "x", "x_fine", VELOCITY, "force", "u", "v_ref", "force_ref"),
    needed=(("time",), ("force",), ("x", "x_fine", VELOCITY)),
    samples=20,
    believes=True,
    slowest=0.5,
    limits={
        "x [m]": (0.3, "mm", 0.0, ""),  # the thread of the screw is 0.262 m long
        "x_fine [m]": (0.02, "um", 0.0, ""),
        "v [m/s]": (0.3, "mm/s", 0.0, ""),  # of its integral
        "force [N]": (2e3, "mN", 2e-3, "kN"),
    },
)
DRIVE_RECORD = _Use(
    columns=("time", "u", "x", VELOCITY, "i", "force", "x_ref", "temperature"),
    needed=(("time",), ("u", "i"), ("x", VELOCITY)),
    samples=200,
    believes=False,
    slowest=0.0499,  # at 20 Hz friction is not visible
    limits={
        "x [m]": (50.0, "mm", 0.0, ""),
        "v [m/s]": (50.0, "rpm", 0.0, ""),
        "u [V]": (1e4, "mV", 0.0, ""),
        "u [A]": (1e3, "mA", 0.0, ""),
        "u [N]": (1e7, "mN", 0.0, ""),
        "i [A]": (1e3, "mA", 0.0, ""),
    },
    lasts=1.0,
)
RESPONSE_RECORD = FORCE_RECORD._replace(
    columns=(*FORCE_RECORD.columns, "i"),
    needed=(("time",), ("force", "u", "i"), ("x", VELOCITY)),
)


def read_response_record(
    path: Path | str, mapping: Names = None, units: Names = None, lead: Size = None
) -> Record:
    """Read one record of a drive with an excitation; see `read_drive_records`."""
    records = _read(Path(path), RESPONSE_RECORD, mapping, units, lead)
    if len(records) > 1:
        raise BadRecord(f"{path}: has gaps; a frequency response needs a record without gaps")
    return records[0]


def read_force_records(
    paths: Paths, mapping: Names = None, units: Names = None, mass: Size = None, lead: Size = None
) -> list[Record]:
    """Read records of force and position, with the trial data of rigs; see `read_drive_records`.

    `mass` is that between load cell and friction [kg]; default the rig's, or 1 kg.
    """
    if mass is not None and not (math.isfinite(mass) and mass >= 0):
        raise BadRecord(f"the mass is {mass} kg, expected a number of at least 0")
    records = []
    for path in _expanded(paths):
        for recorded in _read(path, FORCE_RECORD, mapping, units, lead):
            record = described(recorded, read_about(path), mass)
            for name, unit in ((record.position_name, "m"), ("force", "N")):
                values, fault = record.signals[name], ""
                if empty := np.count_nonzero(~np.isfinite(values)):
                    fault = f"empty or not a number in {empty} of {len(values)} samples; "
                    fault += _LOWER_RATE
                elif np.ptp(values) == 0:
                    fault = f"constant ({values[0]:.6g} {unit}); a record needs motion and force"
                if fault:
                    raise BadRecord(f"{record.name}: {name} is {fault}")
            records.append(record)
    return records


def read_drive_records(
    paths: Paths, mapping: Names = None, units: Names = None, lead: Size = None
) -> list[Record]:
    """Read records of a drive, each at its own rate; `ballscrew.read_drive_records` has more.

    A path may also be a folder of rig folders; a unit may have a factor, such as ``2.5e-6*m``.
    """
    files = _expanded(paths)
    return [r for path in files for r in _read(path, DRIVE_RECORD, mapping, units, lead)]


def _expanded(paths: Paths) -> Iterator[Path]:
    """The paths; for a folder of rig folders, the rig folders in it."""
    for path in map(Path, paths):
        inner = [path]
        if path.is_dir() and not (path / "record.csv").is_file():
            inner = sorted(p.parent for p in path.glob("*/record.csv"))
        if not inner:
            expected = "expected a folder written by `ballscrew rig`, or a file of measured data"
            raise BadRecord(f"{path}: contains no record.csv, and no folder in it does; {expected}")
        yield from inner


def _read(path: Path, use: _Use, mapping: Names, units: Names, lead: Size) -> list[Record]:
    """The record in a file, or its pieces if it has gaps."""
    mapping, units = mapping or {}, units or {}
    tables = read_tables(path / "record.csv" if path.is_dir() else path)
    # a velocity is not read beside a position, unless it is mapped
    there = {*(n for t in tables for n in t.columns), *mapping.values()}
    needless = there & _POSITIONS and VELOCITY not in mapping.values()
    wanted = [n for n in use.columns if n != VELOCITY or not needless]
    table = choose(tables, mapping, wanted, use.needed)
    signals, measured, notes = in_si(table, units, {n: QUANTITIES[n] for n in use.columns}, lead)
    command = measured.get("u", CURRENT)
    command = FORCE if command == TORQUE else command
    screw = lead if TORQUE in measured.values() else None
    pieces, gaps = pieces_between_gaps(signals["time"], use.samples, use.lasts)
    notes = [*([gaps] if gaps else []), *table.notes, *notes]
    records: list[Record] = []
    for k, piece in enumerate(pieces, 1):
        name = f"{path} ({k} of {len(pieces)})" if len(pieces) > 1 else str(path)
        part = {n: v[piece] for n, v in signals.items()}
        rows = np.arange(1, len(signals["time"]) + 1) if table.lines is None else table.lines
        record = check_record(name, part, command, use, {*units, *table.units}, rows[piece])
        records.append(replace(record, lead=screw, notes=(*notes, *record.notes)))
    return records


def check_record(
    name: str,
    signals: Mapping[str, Vector],
    command: str = VOLTAGE,
    use: _Use = DRIVE_RECORD,
    said: Collection[str] = (),
    lines: Integers | None = None,
) -> Record:
    """Return a record from columns in SI units, checked and at equidistant instants.

    `said` are columns with a given unit, `lines` the numbers of the samples for messages.
    """
    signals = {n: np.asarray(v, dtype=float) for n, v in signals.items()}
    said = said if use.believes else ()
    lines = np.arange(1, len(signals["time"]) + 1) if lines is None else lines
    known = _known(name, signals, use, lines)
    samples = np.count_nonzero(known)
    if samples < use.samples:
        raise BadRecord(f"{name}: is too short: {samples} samples, expected at least {use.samples}")
    signals = {n: v[known] for n, v in signals.items() if np.any(np.isfinite(v[known]))}
    step = float(np.median(np.diff(signals["time"])))
    if step > use.slowest and "time" not in said:
        why = f"sampled every {step:.4g} s, at {1 / step:.3g} Hz: too slow for friction; if time"
        why += " is in milliseconds or microseconds, use unit time=ms or time=us"
        why += ", if it is in seconds time=s" if use.believes else ""
        raise BadRecord(f"{name}: {why}")
    position, lost = signals.get("x", signals.get("x_fine")), ""
    if position is not None and np.isfinite(position).all():
        signals["time"], lost = recounted(signals["time"], position)
    signals, step, mended = even_out(name, signals, lines[known])
    lasts = len(signals["time"]) * step
    if lasts < 0.999 * use.lasts:
        raise BadRecord(f"{name}: lasts {lasts:.3g} s, expected at least {use.lasts:g} s")
    if _POSITIONS & signals.keys():
        signals.pop(VELOCITY, None)
    else:
        v = signals[VELOCITY]
        signals["x"] = np.append(0.0, np.cumsum(step * (v[1:] + v[:-1]) / 2.0))
    _check_sizes(name, signals, command, use, said)
    notes = [lost, mended, INTEGRATED if VELOCITY in signals else ""]
    return Record(name, signals, step, command, notes=tuple(filter(None, notes)))


def _known(
    name: str, signals: Mapping[str, Vector], use: _Use, lines: Integers
) -> npt.NDArray[np.bool_]:
    """Whether all required columns have a number in a sample."""
    known = np.ones(len(signals["time"]), dtype=bool)
    for names in use.needed:
        column = next(n for n in names if n in signals)
        bad = np.flatnonzero(~np.isfinite(signals[column]))
        known[bad] = False
        if len(bad) > HOLES * len(known):
            every = len(bad) > max(len(known) / 3, 1) and np.diff(bad).max() <= 3
            repair = "remove these samples at an end of the record, or repair the record"
            of = f"{len(bad)} of {len(known)} samples, the first in row {lines[bad[0]]}"
            what = f"{column} is empty or not a number in {of}"
            raise BadRecord(f"{name}: {what}; {_LOWER_RATE if every else repair}")
    for column, values in signals.items():
        if np.any(np.isinf(values[known])):
            raise BadRecord(f"{name}: {column} has infinite values")
    return known


def _check_sizes(
    name: str, signals: Mapping[str, Vector], command: str, use: _Use, said: Collection[str]
) -> None:
    """Refuse numbers that look like another unit."""
    for column in (c for c in use.columns if c in signals and c not in said):
        unit = next(iter(UNITS[command if column == "u" else QUANTITIES[column][0]]))
        limits = use.limits.get(f"{column} [{unit}]")
        if limits is None or (column == "x" and VELOCITY in signals):
            continue
        most, other, least, less = limits
        values = signals["x" if column == VELOCITY else column]
        moves = column in (*_POSITIONS, VELOCITY)
        size = float(np.ptp(values) if moves else np.nanmax(np.abs(values)))
        fault = f"covers {size:.4g}{' m' if column == VELOCITY else ''}, too much"
        if 0 < size < least:
            fault, other = f"reaches only {size:.4g}, too little", less
        elif size <= most:
            continue
        what = f"if it is in another unit, such as {other}, use unit {column}={other}"
        what += f", if it is in {unit} use unit {column}={unit}" if use.believes else ""
        raise BadRecord(f"{name}: {column} {fault} for {unit}; {what}")
