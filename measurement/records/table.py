"""Tables of numbers with columns of any name: choose the requested one, with our names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...solver.arrays import Vector
from ...solver.errors import BadRecord, nearest
from .columns import Table, name_and_unit
from .formats import tables_in
from .sampling import unrounded, unwrapped
from .units import NO_UNIT, UNITS, conversion, quantity_of, spell

Map = Mapping[str, str]
Names = Sequence[str]
Needed = Sequence[Names]

_LISTED = 12  # names in a message
_POSITIONS = ("x", "x_fine", "x_ref", "time")  # columns that may wrap


def read_tables(path: Path) -> list[Table]:
    """All tables of numbers in a file; the format is detected by its first bytes."""
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise BadRecord(f"{path}: there is no such file") from error
    except OSError as error:
        raise BadRecord(f"{path}: cannot be read: {error.strerror or error}") from error
    tables = tables_in(path, data)
    again = Counter(t.group for t in tables)
    return [
        replace(t, group=f"{t.group} ({k})") if again[t.group] > 1 else t
        for k, t in enumerate(tables, 1)
    ]


def choose(tables: Sequence[Table], mapping: Map, known: Names, needed: Needed) -> Table:
    """The table of a file with the requested columns, or a table from columns of several.

    A column of a table is also ``TABLE/COLUMN``; for the arguments see `rename`.
    """
    if len(tables) == 1:
        return rename(tables[0], mapping, known, needed)
    whole = []
    for table in tables:
        with suppress(BadRecord):
            whole.append(rename(table, mapping, known, needed))
    if len(whole) == 1:
        return whole[0]
    path = tables[0].path
    theirs = {n: next((t for t, o in mapping.items() if o == n), n) for n in known}
    if whole:
        names = [t.group for t in whole]
        one = f"choose one, such as map {names[0]}/{theirs['time']}=time"
        raise BadRecord(
            f"{path}: has {len(whole)} tables with these columns: {listed(names)}; {one}"
        )
    found: dict[str, list[Table]] = {}
    for table in tables:
        for ours in (n for n in known if _column(table, theirs[n])):
            part = rename(table, {theirs[ours]: ours}, [ours], [])
            found.setdefault(ours, []).append(part)
    for ours, parts in found.items():
        if ours != "time" and len(parts) > 1:
            one = f"choose one, such as map {parts[0].group}/{theirs[ours]}={ours}"
            there = listed(t.group for t in parts)
            raise BadRecord(f"{path}: has {theirs[ours]!r} in {there}; {one}")
    lost = [t for t, ours in mapping.items() if ours in known and ours not in found]
    if lost or any(not {*names} & found.keys() for names in needed):
        asked = ", ".join(" or ".join(theirs[n] for n in names) for names in needed)
        what = f"a column {lost[0]!r}" if lost else f"the columns {asked}"
        there = listed(f"{t.group} ({listed(t.columns)})" for t in tables)
        assign = f"assign them, such as map TABLE/COLUMN={needed[-1][0]}"
        raise BadRecord(f"{path}: none of its tables has {what}; there are {there}; {assign}")
    first = {next(n for n in names if n in found) for names in needed}
    times = {t.group: t for t in found.pop("time")}
    called = {"time", *(_column(t, theirs["time"]) for t in tables)}
    for table in tables:  # use the table's own time, if the mapped time is in another table
        own = next((n for n in table.columns if n in called), "")
        if table.group not in times and own:
            times[table.group] = rename(table, {own: "time"}, ["time"], [])
    return _joined(path, {n: parts[0] for n, parts in found.items()}, times, first)


def _joined(
    path: Path, parts: Mapping[str, Table], times: Mapping[str, Table], needed: Collection[str]
) -> Table:
    """One table at the stamps of the slowest needed one of `parts`; `times` are by group."""
    first = {parts[n].group for n in parts if n in needed}
    main = max(times.values(), key=lambda t: _step(t) if t.group in first else -1.0)
    unit, time = main.units.get("time", ""), main.columns["time"]
    inside, of_main = np.isfinite(time), float(np.nanmedian(np.diff(time)))
    columns = {"time": time}
    sources = [main, *parts.values()]
    notes = list(dict.fromkeys(n for p in sources for n in p.notes))
    for name, part in parts.items():
        values, own, what = part.columns[name], times.get(part.group), f"{name} of {part.group}"
        stamps = (own or main).columns["time"]
        if len(stamps) != len(values):
            many = f"{len(values)} samples and its time {len(stamps)}"
            give = "give its time column, such as map TABLE/COLUMN=time"
            raise BadRecord(f"{path}: {what} has {many}; {give}")
        if own and own.start != main.start:
            dates = f"different dates ({main.start or 'none'}, {own.start or 'none'})"
            both = f"times of {main.group} and {part.group} start at {dates}"
            raise BadRecord(f"{path}: {both}; write both in seconds from the same start")
        if own:
            stamps = stamps * _scale(path, own.units.get("time", ""), unit)
        else:  # a file may have one time for all
            notes.append(f"{what} has no time column: the time of the other columns is used")
        if own is None or np.array_equal(stamps, time):
            columns[name] = values
            continue
        known = np.isfinite(stamps) & np.isfinite(values)
        stamps, values = stamps[known], values[known]
        if len(stamps) < 2 or np.any(np.diff(stamps) < 0):
            raise BadRecord(f"{path}: time of {part.group} does not increase")
        step = float(np.median(np.diff(stamps)))
        if name not in needed and step > 1.5 * of_main:  # no samples are invented
            columns[name] = np.full(len(time), np.nan)
            columns[name][np.searchsorted(0.5 * (time[1:] + time[:-1]), stamps)] = values
            continue
        inside &= (time >= stamps[0]) & (time <= stamps[-1])
        columns[name] = np.interp(time, stamps, values)
        share = "" if step > 0.95 * of_main else f", 1 in {of_main / step:.3g} of its samples"
        every, at = f"every {step:.4g}{unit and ' ' + unit}", f"every {of_main:.4g}{share}"
        how = f"is interpolated linearly at the time stamps of {main.group}"
        notes.append(f"{what}, recorded {every}, {how}, {at}")
    if not inside.any():
        raise BadRecord(f"{path}: {', '.join(parts)} do not overlap in time")
    units = {"time": unit} | {n: p.units.get(n, "") for n, p in parts.items()}
    within = {n: v[inside] for n, v in columns.items()}
    given = {n: u for n, u in units.items() if u}
    renamed = {n: t for p in sources for n, t in p.renamed.items()}
    return Table(path, within, given, notes=tuple(notes), renamed=renamed)


def _step(table: Table) -> float:
    """Sampling interval of a table with a time, in seconds if its unit is known."""
    stamps, unit = table.columns["time"], spell(table.units.get("time", ""))
    median = float(np.nanmedian(np.diff(stamps))) if len(stamps) > 1 else 0.0
    return UNITS["time"].get(unit, 1.0) * median


def _scale(path: Path, unit: str, other: str) -> float:
    sizes = [UNITS["time"].get(spell(u), 0.0) for u in (unit, other)]
    if unit != other and not all(sizes):
        raise BadRecord(f"{path}: its times are in {unit!r} and {other!r}")
    return sizes[0] / sizes[1] if unit != other else 1.0


def listed(names: Iterable[str]) -> str:
    """Names for a message; only the first if there are many."""
    every = list(names)
    if len(every) > _LISTED + 1:
        every[_LISTED:] = [f"{len(every) - _LISTED} more"]
    return ", ".join(every) or "none"


def _column(table: Table, theirs: str) -> str:
    """The table's name for the user's name of a column; empty if there is none."""
    theirs = theirs.removeprefix(f"{table.group}/") if table.group else theirs
    if theirs in table.columns or theirs in table.faults:
        return theirs
    bare, unit = name_and_unit(theirs)
    if unit and table.units.get(bare) == unit and bare in table.columns:
        return bare
    return table.numbers.get(theirs, "")


def rename(table: Table, mapping: Map, known: Names, needed: Needed) -> Table:
    """Columns under our names, in the order of ours, of constant length.

    `mapping` is ``theirs -> ours``, `known` has our names, and of each in `needed` at least one
    name must be present.
    """
    path, columns = table.path, table.columns
    there = f"there are {listed(columns)}"
    theirs_of: dict[str, str] = {}
    for theirs, ours in mapping.items():
        asked = f"map {theirs}={ours}: there is no"
        if ours not in known:
            raise BadRecord(f"{asked} {ours!r} here; columns are {', '.join(known)}")
        theirs_of[ours] = _column(table, theirs)
        if not theirs_of[ours]:
            near = nearest(theirs, columns)
            raise BadRecord(f"{path}: {asked} column {theirs!r}{near}; {there}")
    for name in (*columns, *table.faults):
        if name in known and name not in theirs_of.values():
            theirs_of.setdefault(name, name)
    for name in theirs_of.values():
        if name in table.faults:
            raise BadRecord(f"{path}{table.faults[name]}")
    for name in known:
        if name not in theirs_of and f"{name} #1" in columns:
            such = f"such as map '{name} #1={name}'"
            raise BadRecord(f"{path}: the column {name!r} occurs twice; choose one, {such}")
    for names in needed:
        if not {*names} & theirs_of.keys():
            lost = " nor ".join(map(repr, names)) + nearest(names[0], columns)
            raise BadRecord(f"{path}: has no column {lost}; {there}; use map theirs={names[0]}")
    named = {n: columns[theirs_of[n]] for n in known if n in theirs_of}
    lengths = {n: len(v) for n, v in named.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{n} {k}" for n, k in lengths.items())
        why = "recorded at different rates? Resample them to one rate first"
        raise BadRecord(f"{path}: columns of different length ({said} samples): {why}")
    units = {n: table.units[t] for n, t in theirs_of.items() if t in table.units}
    renamed = {n: t for n, t in theirs_of.items() if n != t}
    return replace(table, columns=named, units=units, numbers={}, renamed=renamed)


def in_si(
    table: Table, units: Map, quantities: Mapping[str, Names], lead: float | None
) -> tuple[dict[str, Vector], dict[str, str], list[str]]:
    """A table's columns in SI units of a linear motion, their quantities, and notes.

    Positions, and times, that restart after a turn or the counter's range are made continuous.
    Units by the user, `units`, go before those of the file. Without either a column with our name
    is in SI units, and a column that was renamed needs one. `quantities` has those that are
    possible for each of our columns, the usual one first; `lead` is that of the screw [m].
    """
    for name, text in units.items():
        if name not in quantities:
            raise BadRecord(f"unit {name}={text}: columns are {', '.join(quantities)}")
    signals, measured, notes = {}, {}, []
    for name, values in table.columns.items():
        may_be = quantities[name]
        said = units.get(name, table.units.get(name, ""))
        known = ", ".join(u for q in may_be for u in UNITS[q])
        use = f"use unit {name}= with one of {known}, or with a number of them"
        if name == "time":
            values, said_of_it = unrounded(values)
            notes += said_of_it
        if said in NO_UNIT and name not in table.renamed:
            signals[name], measured[name] = values, may_be[0]
            continue
        lacks = ""
        if said in NO_UNIT:
            lacks = f"gives no unit of {table.renamed[name]!r}, which is {name} by map"
        elif name not in units and quantity_of(said) not in may_be:
            lacks = f"the file says that {name} is in {said!r}"
        if lacks:
            raise BadRecord(f"{table.path}: {lacks}; {use}")
        factor, measured[name] = conversion(name, said, may_be, lead)
        if name in _POSITIONS:
            turn = measured[name] == "angle" and lead
            values, said_of_it = unwrapped(name, values, turn / factor if turn else None)
            notes += said_of_it
        signals[name] = factor * values
    return signals, measured, notes
