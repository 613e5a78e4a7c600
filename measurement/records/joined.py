"""Columns of tables with separate times, combined at the time stamps of one of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from ...solver.errors import BadRecord
from .columns import Table, Vector
from .units import UNITS, spell


def joined(
    path: Path, parts: Mapping[str, Table], times: Mapping[str, Table], needed: Collection[str]
) -> Table:
    """One table from columns of several tables.

    Its stamps are those of the slowest table with a needed column, so that no samples are invented.
    Other columns are interpolated linearly. A slower column that is not needed is placed at the
    nearest stamps and is unknown at others. `parts` has a table with one column by our name,
    `times` a table with its ``time`` by group.
    """
    first = [n for n in parts if n in needed and parts[n].group in times]
    main = max(times.values(), key=lambda t: _step(t, first, parts))
    unit = main.units.get("time", "")
    time = main.columns["time"]
    inside = np.isfinite(time)
    out: dict[str, Vector] = {}
    notes = list(dict.fromkeys(n for p in [main, *parts.values()] for n in p.notes))
    for name, part in parts.items():
        values = part.columns[name]
        own = times.get(part.group)
        if own is None:  # a file may have one time for all
            if len(values) != len(time):
                raise BadRecord(
                    f"{path}: {part.group} has no column of time and {name} has {len(values)} "
                    f"samples, but time has {len(time)}"
                )
            out[name] = values
            notes.append(
                f"{name} of {part.group} has no time column: the time of the other columns is used"
            )
            continue
        if own.start != main.start:
            raise BadRecord(
                f"{path}: times of {main.group} and {part.group} start at different dates "
                f"({main.start or 'none'}, {own.start or 'none'}); write both in seconds from the "
                "same start"
            )
        if len(own.columns["time"]) != len(values):
            raise BadRecord(
                f"{path}: {name} of {part.group} has {len(values)} samples and its time "
                f"{len(own.columns['time'])}; give its time column, such as --map TABLE/COLUMN=time"
            )
        stamps = own.columns["time"] * _scale(path, own.units.get("time", ""), unit)
        if np.array_equal(stamps, time):
            out[name] = values
            continue
        known = np.isfinite(stamps) & np.isfinite(values)
        stamps, values = stamps[known], values[known]
        if len(stamps) < 2 or np.any(np.diff(stamps) < 0):
            raise BadRecord(f"{path}: time of {part.group} does not increase")
        step, of_main = float(np.median(np.diff(stamps))), float(np.nanmedian(np.diff(time)))
        if name in needed or step <= 1.5 * of_main:
            inside &= (time >= stamps[0]) & (time <= stamps[-1])
            out[name] = np.interp(time, stamps, values)
            share = "" if step > 0.95 * of_main else f", 1 in {of_main / step:.3g} of its samples"
            notes.append(
                f"{name} of {part.group}, recorded every {step:.4g}{unit and ' ' + unit}, is "
                f"interpolated linearly at the time stamps of {main.group}, every "
                f"{of_main:.4g}{share}"
            )
        else:
            out[name] = np.full(len(time), np.nan)
            out[name][np.searchsorted(0.5 * (time[1:] + time[:-1]), stamps)] = values
    if not inside.any():
        raise BadRecord(f"{path}: {', '.join(parts)} do not overlap in time")
    units = {"time": unit} | {n: p.units[n] for n, p in parts.items() if n in p.units}
    columns = {n: v[inside] for n, v in {"time": time, **out}.items()}
    renamed = {n: t for p in [main, *parts.values()] for n, t in p.renamed.items()}
    told = {n: u for n, u in units.items() if u}
    return Table(path, columns, told, notes=tuple(notes), renamed=renamed)


def _step(time: Table, first: Collection[str], parts: Mapping[str, Table]) -> float:
    """Sampling interval of a table with a needed column; -1 for others."""
    if time.group not in {parts[n].group for n in first}:
        return -1.0
    stamps = time.columns["time"]
    size = UNITS["time"].get(spell(time.units.get("time", "")), 1.0)
    return size * float(np.nanmedian(np.diff(stamps))) if len(stamps) > 1 else 0.0


def _scale(path: Path, unit: str, other: str) -> float:
    if unit == other:
        return 1.0
    try:
        return UNITS["time"][spell(unit)] / UNITS["time"][spell(other)]
    except KeyError:
        raise BadRecord(f"{path}: its times are in {unit!r} and {other!r}") from None
