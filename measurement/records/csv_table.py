"""Tables of numbers as text, as written by machines.

Separator, decimal sign, lines before the table, names and a line of units below them are detected.
The table is the part with rows of numbers.
"""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import date, timedelta
from itertools import pairwise, product
from pathlib import Path
from reprlib import repr as shortened
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from .columns import Column, Table, check_size, table_of
from .units import NO_UNIT, quantity_of

Rows = list[list[str]]
Integers = npt.NDArray[np.int64]

_SEPARATORS = ("\t", ";", ",", "|", " ")
_LOOKED_AT = 400  # lines of the file's second half used to detect its style
_DOTS = "the file has decimal commas: use commas only as decimal separators, and remove other dots"
_COMMAS = "the file has decimal points: remove the commas between thousands"
_LVM = "LabVIEW Measurement"
_LVM_END = "***End_of_Header***"
_MARK = "#"  # before remarks, and before names written as a remark
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?")  # 19.882 and 1.019.882,5
_THOUSANDS_OF_POINTS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?")  # 1,019,882.5
_BETWEEN_DIGITS = re.compile(r"(?<=\d)['\u2019\u00a0\u202f](?=\d{3})")  # 1'019'882
_DATE = r"(?P<date>\d{1,4}[-./]\d{1,2}[-./]\d{1,4})"
_OF_DAY = r"(?P<h>\d{1,2}):(?P<m>\d\d)(?::(?P<s>\d\d(?:[.,]\d+)?))?(?: ?(?P<half>[AaPp][Mm]))?"
_STAMP = re.compile(rf"(?:{_DATE}[T ] *)?{_OF_DAY}(?: ?(?:Z|[A-Z]{{3,4}}|[-+]\d\d:?\d\d))?")
# 03:12.250, as spreadsheets show it
_MINUTES = re.compile(r"(?P<date>)(?P<h>)(?P<half>)(?P<m>\d{1,3}):(?P<s>\d\d[.,]\d+)")
_DAY = timedelta(days=1).total_seconds()
_UNITS_TOO = (*NO_UNIT, "%", "counts", "count", "inc")  # occur in lines of units


class _Style(NamedTuple):
    """Separator and decimal sign of a file."""

    separator: str
    comma: bool  # in decimals

    def cells(self, line: str) -> list[str]:
        # a program that changed the file may have added separators at the ends of its lines
        line = line.rstrip("".join(s for s in ",; \t" if s != self.separator))
        if self.separator == " ":
            return line.split()
        if '"' in line:
            try:
                return [c.strip() for c in next(csv.reader([line], delimiter=self.separator))]
            except csv.Error:  # a quoted cell without a closing quote
                return [line]
        return [c.strip() for c in line.split(self.separator)]

    def number(self, cell: str) -> float | None:
        cell = _BETWEEN_DIGITS.sub("", cell)
        if not self.comma:
            return _float(cell.replace(",", "") if _THOUSANDS_OF_POINTS.fullmatch(cell) else cell)
        slips = "." in cell and not _THOUSANDS.fullmatch(cell)
        return None if slips else _float(cell.replace(".", "").replace(",", "."))

    def is_doubtful(self, cell: str) -> bool:
        """Whether a cell would be a different number with the other decimal sign."""
        if self.comma:
            return "." in cell and _float(cell) is not None
        return cell.count(",") == 1 and "." not in cell and self.number(cell) is not None

    def is_number(self, cell: str) -> bool:
        return self.number(cell) is not None or self.is_doubtful(cell) or bool(_stamp(cell))

    def is_row(self, cells: Sequence[str]) -> bool:
        """Whether more than half of the cells are numbers or empty, with at least one number."""
        count = sum(map(self.is_number, cells))
        return count > 0 and count + cells.count("") > len(cells) / 2


def _float(text: str) -> float | None:
    try:
        return float(text) if text.isascii() and "_" not in text else None  # 0.02_5 is a slip
    except ValueError:
        return None


def _stamp(cell: str) -> re.Match[str] | None:
    """A time of day, with or without a date."""
    return (_STAMP.fullmatch(cell) or _MINUTES.fullmatch(cell)) if ":" in cell else None


def _seconds(cells: Sequence[str]) -> Vector | None:
    """Seconds from the first stamp, shape (n,), NaN for empty cells; None if dates are ambiguous.

    Times of day without a date continue after midnight. An ambiguous order of day and month is
    accepted if the date is the same in all cells.
    """
    found = [_stamp(c) for c in cells]
    texts = {s["date"] or "" for s in found if s}
    days = {text: _day(text) if len(texts) > 1 else 0.0 for text in texts}
    times = np.full(len(cells), math.nan)
    for k, s in enumerate(found):
        if s:
            hour, half = int(s["h"] or 0), (s["half"] or "").lower()
            hour = hour % 12 + 12 * (half == "pm") if half else hour
            second = float((s["s"] or "0").replace(",", "."))
            times[k] = _DAY * days[s["date"] or ""] + 3600.0 * hour + 60.0 * int(s["m"]) + second
    known = np.isfinite(times)
    if not known.any():
        return None
    if texts == {""}:
        nights = np.diff(times[known], prepend=times[known][0]) < -_DAY / 2
        times[known] += _DAY * np.cumsum(nights)
    return np.asarray(times - times[known][0])


def _day(text: str) -> float:
    """Number of a day; NaN if the order of day and month is not known."""
    parts = re.split("[-./]", text)
    if len(parts[0]) != 4:
        if "." not in text:
            return math.nan if text else 0.0  # 3/4/2024: April, or March?
        parts.reverse()
    with suppress(ValueError):
        return float(date(*map(int, parts)).toordinal())
    return math.nan


def read_text(path: Path, data: bytes) -> list[Table]:
    """Read a text with any usual separator, decimal sign, encoding and header.

    The result has several tables if each signal has its own time column.
    """
    check_size(path, "bytes of text", len(data))
    text = _text(path, data).replace("\r\n", "\n").replace("\r", "\n")
    check_size(path, "rows", text.count("\n"))
    numbered = list(enumerate(text.split("\n"), 1))
    if text.startswith(_LVM):
        return _labview(path, numbered)
    return read_lines(path, numbered, cut=not text.endswith("\n"))


def read_lines(path: Path, numbered: Iterable[tuple[int, str]], cut: bool = False) -> list[Table]:
    """The tables in numbered lines; with `cut`, the last line may be incomplete."""
    numbered = [(k, t) for k, t in numbered if t.strip(" \t,;")]
    if not numbered:
        raise BadRecord(f"{path}: is empty; expected a header row of names and rows of numbers")
    texts = [t for _, t in numbered]
    check_size(path, "characters in a line", max(map(len, texts)))
    style, width, filled, firm = _style(path, texts)
    above: Rows = []
    row: list[str] = []
    for text in texts:
        row = style.cells(text)
        named = bool(above) and width < len(row) <= len(above[-1])  # words in a last column
        begins = style.is_number(row[0]) or not (row[0] and firm)
        if (_fits(row, width) or named) and begins and style.is_row(row[:width]):
            break
        above.append([c for c in row if c != _MARK] if style.separator == " " else row)
    head = len(above[-1]) if above else 0
    remarks = head == width + 1 and style.separator != " " and _MARK not in above[-1][0]
    full = head if width < len(row) <= head or remarks else width
    names, units = _header(path, above, style, full, filled)
    texts, lines = texts[len(above) :], np.array([k for k, _ in numbered[len(above) :]])
    # separators at the ends of lines give columns without name and number
    wide = filled if names[filled:] == [str(k + 1) for k in range(filled, full)] else full
    plain, notes = _plain(texts, style, wide), tuple[str, ...]()
    if plain is not None:
        columns = [Column(n, v.copy()) for n, v in zip(names[:wide], plain.T, strict=True)]
    else:
        rows = list(map(style.cells, texts))
        kept, notes = _kept(rows, lines, width, style, cut)
        rows, lines = [rows[k] for k in kept], lines[kept]
        rows = [r + [""] * (full - len(r)) if len(r) >= width else r for r in rows]
        for row, line in zip(rows, lines, strict=True):
            if not _fits(row, full):
                raise BadRecord(f"{path}, row {line}: {len(row)} cells, expected {full}")
        cells = ([row[k] for row in rows] for k in range(full))
        columns = [_column(n, c, lines, style) for n, c in zip(names, cells, strict=True)]
    columns = [
        c._replace(number=str(k), unit=c.unit or unit)
        for k, (c, unit) in enumerate(zip(columns, units, strict=False), 1)
        if c.name != str(k) or c.values is None or np.isfinite(c.values).any()
    ]
    return _by_time(path, columns, lines, notes)


def _by_time(
    path: Path, columns: Sequence[Column], lines: Integers, notes: Sequence[str]
) -> list[Table]:
    """One table, or one per time column if signals have their own and these differ."""
    starts = [k for k, column in enumerate(columns) if column.name == columns[0].name]
    parts = [columns[a:b] for a, b in pairwise([*starts, len(columns)])]
    if len(parts) == 1 or min(map(len, parts)) < 2:
        return [table_of(path, columns, "", lines, notes)]
    first, *others = (part[0] for part in parts)
    values, starts_at = first.values, {t.start for t in others}
    same = values is not None and all(
        t.values is not None and np.array_equal(t.values, values) for t in others
    )
    if same and starts_at == {first.start}:
        kept = [c for c in columns if c.name != first.name]
        table = table_of(path, [first, *kept], "", lines, notes)
        called = {t.number: table.numbers[first.number] for t in others}
        return [replace(table, numbers=table.numbers | called)]
    found = []
    for part in parts:
        samples, time = len(lines), part[0].values
        if time is not None and np.isfinite(time).any():  # it may be shorter
            samples = 1 + int(np.flatnonzero(np.isfinite(time))[-1])
        short = [c if c.values is None else c._replace(values=c.values[:samples]) for c in part]
        found.append(table_of(path, short, part[1].name, lines[:samples], notes))
    return found


def _kept(
    rows: Rows, lines: Integers, width: int, style: _Style, cut: bool
) -> tuple[list[int], tuple[str, ...]]:
    """The rows to keep, and a note: not lines of words, and no incomplete line at the end."""

    def begins(k: int) -> bool:
        return style.is_number(rows[k][0])

    short = (k for k, row in enumerate(rows) if len(row) < width)
    out, last = {k for k in short if not any(map(style.is_number, rows[k]))}, len(rows) - 1
    if cut and last > 0 and len(rows[last]) < width and begins(last):
        out.add(last)
    while last > 0 and (last in out or (begins(0) and rows[last][0] and not begins(last))):
        out.add(last)
        last -= 1
    what = f"{len(out)} invalid line{'s' if len(out) > 1 else ''} of the table left out"
    note = (f"{what}; the first is line {lines[min(out)]}",) if out else ()
    return [k for k in range(len(rows)) if k not in out], note


def _labview(path: Path, numbered: Sequence[tuple[int, str]]) -> list[Table]:
    """The one segment of a LabVIEW measurement file."""
    ends = [k for k, (_, text) in enumerate(numbered) if text.startswith(_LVM_END)]
    if len(ends) > 2:
        raise BadRecord(f"{path}: has {len(ends) - 1} segments of LabVIEW; save one of them")
    header = _said(numbered[: ends[-1]] if ends else [])
    found = []
    for table in read_lines(path, numbered[ends[-1] + 1 :] if ends else numbered):
        columns, units = dict(table.columns), dict(table.units)
        x, *signals = columns
        if header.get("X_Columns") == ["No"]:
            texts = [(header.get(n) or [""])[0].replace(",", ".") for n in ("X0", "Delta_X")]
            begin, step = map(_float, texts)
            if begin is None or step is None:
                raise BadRecord(f"{path}: has no column of time, and no X0 and Delta_X")
            columns[x] = np.asarray(begin + step * np.arange(len(columns[x])), dtype=float)
        if header.get("X_Columns") != ["Multi"]:
            units |= dict(zip(signals, header.get("Y_Unit_Label", []), strict=False))
        found.append(replace(table, columns=columns, units=units))
    return found


def _said(numbered: Sequence[tuple[int, str]]) -> dict[str, list[str]]:
    """Lines that consist of a name and its text."""
    cells = [re.split(r"[\t;]|,(?=\D)", text.strip()) for _, text in numbered]
    return {first: rest for first, *rest in cells if first}


def _text(path: Path, data: bytes) -> str:
    marked = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    if b"\0" in data and not marked:
        raise BadRecord(f"{path}: is not a text table: it contains zero bytes; save it as CSV")
    with suppress(UnicodeDecodeError):
        return data.decode("utf-16" if marked else "utf-8-sig")
    return data.decode("cp1252", "replace")


def _style(path: Path, texts: Sequence[str]) -> tuple[_Style, int, int, bool]:
    """The style of most rows, their cells, those used, and whether all begin with a number."""
    some = texts[-min(_LOOKED_AT, len(texts) // 2 + 1) :]
    found, most = None, 0.0
    for separator, comma in product(_SEPARATORS, (False, True)):
        if comma and separator == "," and not any('"' in t for t in some):
            continue
        style = _Style(separator, comma)
        rows = [row for row in map(style.cells, some) if len(row) > 1 and style.is_row(row)]
        filled = sum(style.is_number(c) - 0.5 * style.is_doubtful(c) for row in rows for c in row)
        if filled > most:
            lengths = Counter(map(len, rows))
            width = min(n for n in lengths if lengths[n] == max(lengths.values()))
            firm = all(style.is_number(row[0]) for row in rows if len(row) == width)
            used = 1 + max(k for row in rows for k, cell in enumerate(row[:width]) if cell)
            found, most = (style, width, used, firm), filled
    if found is None:
        expected = "expected columns with names, separated by tabs, semicolons or commas"
        raise BadRecord(f"{path}: has no rows of numbers; {expected}")
    return found


def _fits(row: Sequence[str], width: int) -> bool:
    return len(row) >= width and not any(row[width:])


def _header(
    path: Path, above: Rows, style: _Style, width: int, filled: int
) -> tuple[list[str], list[str]]:
    """Names and units from the lines above the numbers; `filled` cells of a row are used."""
    names, units = _scope_header(above, width)
    if names:
        return names, units
    block: Rows = []
    for row in reversed(above):
        if len(row) < 2 or any(row[width:]) or any(map(style.is_number, row)):
            break
        block.append(row)
    numbers, nothing = [str(k + 1) for k in range(width)], [""] * width
    if not block:
        return numbers, nothing
    bare = [c.strip("[]() ") for c in block[0]]
    known = all(quantity_of(c) or c in _UNITS_TOO for c in bare)
    has_units = len(block) > 1 and known and any(block[0])
    header = block[1] if has_units else block[0]
    if len(header) < filled:
        twice = style.separator == "," and filled == 2 * len(header)
        why = "; are commas used both between numbers and as decimal separators?" if twice else ""
        named = f"names {len(header)} columns ({', '.join(header)})"
        raise BadRecord(f"{path}: {named}, but its rows have {filled}{why}")
    header = (header + nothing)[:width]
    header[0] = header[0].removeprefix(_MARK).lstrip()
    names = [name or number for name, number in zip(header, numbers, strict=True)]
    return names, ((bare if has_units else []) + nothing)[:width]


def _scope_header(above: Rows, width: int) -> tuple[list[str], list[str]]:
    """Names and units of an export of the TwinCAT scope; empty for other files."""
    rows = [row for row in above if len(row) == width and len(set(row[0::2])) == 1]
    header = {row[0]: row[1::2] for row in rows if width % 2 == 0}
    if "Name" not in header or not any(n.startswith("SampleTime") for n in header):
        return [], []
    units = header.get("Unit", [""] * width)
    names = [n for signal in header["Name"] for n in ("time", signal)]
    return names, [u for unit in units for u in ("", unit)]


def _plain(texts: Sequence[str], style: _Style, width: int) -> npt.NDArray[np.float64] | None:
    """All rows at once, if all their cells are numbers; else None."""
    rows = [t.rstrip("\t;, ") for t in texts]
    if style.comma and any("." in t for t in rows):
        return None
    rows = [t.replace(",", ".") for t in rows] if style.comma else rows
    separator = None if style.separator == " " else style.separator
    with suppress(ValueError):
        table = np.loadtxt(rows, delimiter=separator, comments=None, ndmin=2)
        return table if table.shape[1] == width else None
    return None


def _column(name: str, cells: Sequence[str], lines: Integers, style: _Style) -> Column:
    """The numbers of a column, or seconds from its first stamp; or the first cell that is wrong."""
    filled = [c for c in cells if c]
    stamped = 2 * sum(map(bool, map(_stamp, filled))) > len(filled)
    where = f", column {name!r}: {filled[0]!r}" if filled else ""
    if filled and all(map(style.is_doubtful, filled)):  # thousands or decimals?
        doubt = f"has a dot; {_DOTS}" if style.comma else f"has a comma; {_COMMAS}"
        return Column(name, fault=f"{where} {doubt}")
    numbers = [style.number(c) if c else math.nan for c in cells]
    for cell, number, line in zip(cells, numbers, lines, strict=True):
        if cell and (not _stamp(cell) if stamped else number is None):
            what = "time of day, unlike the other cells" if stamped else "number"
            why = f"; {_DOTS}" if style.comma and style.is_doubtful(cell) else ""
            fault = f", row {line}, column {name!r}: {shortened(cell)} is not a {what}{why}"
            return Column(name, fault=fault)
    if not stamped:
        return Column(name, np.array(numbers, dtype=float))
    since = _seconds(cells)
    if since is None:
        may_be = "may be from two days; write dates as 2024-03-31 12:00:00"
        return Column(name, fault=f"{where} {may_be}")
    return Column(name, since, "s", filled[0])
