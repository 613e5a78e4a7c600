"""Dates and times of day, as written by loggers, as seconds from the first one."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import date

import numpy as np

from ...solver.arrays import Vector

_DATE = r"(?P<date>\d{1,4}[-./]\d{1,2}[-./]\d{1,4})"
_OF_DAY = r"(?P<h>\d{1,2}):(?P<m>\d\d)(?::(?P<s>\d\d(?:[.,]\d+)?))?(?P<half> ?[AaPp][Mm])?"
_STAMP = re.compile(rf"(?:{_DATE}[T ] *)?{_OF_DAY}(?: ?(?:Z|[A-Z]{{3,4}}|[-+]\d\d:?\d\d))?")
_MINUTES = re.compile(r"(?P<m>\d{1,3}):(?P<s>\d\d[.,]\d+)")  # 03:12.250, as spreadsheets show it
_DAY = 86400.0


def is_stamp(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date."""
    return ":" in cell and bool(_STAMP.fullmatch(cell) or _MINUTES.fullmatch(cell))


def seconds(cells: Sequence[str]) -> Vector | None:
    """Seconds from the first stamp, shape (n,), NaN for empty cells; None if dates are ambiguous.

    Times of day without a date continue after midnight. An ambiguous order of day and month is
    accepted if the date is the same in all cells.
    """
    found = [_DAY * day + s for day, s in _read(cells)]
    times = np.array(found)
    known = times[np.isfinite(times)]
    if not len(known):
        return None
    if not any(_date(c) for c in cells):
        nights = np.zeros(len(times))
        nights[np.isfinite(times)] = np.cumsum(np.diff(known, prepend=known[0]) < -_DAY / 2)
        times = times + _DAY * nights
    return np.asarray(times - known[0])


def _read(cells: Sequence[str]) -> list[tuple[float, float]]:
    """Day of each stamp, and second of the day."""
    texts = {_date(c) for c in cells if c}
    days = {text: _day(text) for text in texts}
    if len(texts) == 1:
        days = dict.fromkeys(texts, 0.0)
    return [(days[_date(c)], _second(c)) if c else (0.0, math.nan) for c in cells]


def _date(cell: str) -> str:
    found = _STAMP.fullmatch(cell)
    return (found["date"] or "") if found else ""


def _day(text: str) -> float:
    parts = re.split("[-./]", text)
    if len(parts[0]) == 4:
        year, month, day = parts
    elif "." in text:
        day, month, year = parts
    else:
        return math.nan if text else 0.0  # 3/4/2024: April, or March?
    try:
        return float(date(int(year), int(month), int(day)).toordinal())
    except ValueError:
        return math.nan


def _second(cell: str) -> float:
    found = _STAMP.fullmatch(cell)
    if not found:
        short = _MINUTES.fullmatch(cell)
        return 60.0 * int(short["m"]) + _float(short["s"]) if short else math.nan
    hour = int(found["h"])
    if found["half"]:
        hour = hour % 12 + (12 if found["half"].strip().lower() == "pm" else 0)
    return 3600.0 * hour + 60.0 * int(found["m"]) + _float(found["s"] or "0")


def _float(text: str) -> float:
    return float(text.replace(",", "."))
