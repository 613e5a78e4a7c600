"""Tables of numbers as text, the way machines write them.

Separator, decimal sign, lines before the table, names and a line of units below them are found in
the text itself: the table is where rows of numbers are.
"""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .bad_record import BadRecord
from .units import NO_UNIT, quantity_of

Vector = npt.NDArray[np.float64]
Rows = list[list[str]]

_SEPARATORS = ("\t", ";", ",", " ")
_LOOKED_AT = 400  # lines of the file's second half that tell how it is written
_DOTS = "the file has decimal commas: write a comma for each decimal point, and take other dots out"
_SHOWN = 40  # characters of a cell that is no number
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?")  # 19.882 and 1.019.882,5
_UNITS_TOO = (*NO_UNIT, "%", "counts", "count", "inc")  # stand in lines of units


@dataclass(frozen=True)
class Table:
    """Columns of a file under the names that they have there.

    Attributes
    ----------
    path : Path
    columns : dict of str to ndarray, shape (n,)
        Of different lengths, if the file has such; one without a name has its number, from 1 on.
    units : dict of str to str
        What the file says of its columns' units, in its own words.
    lines : ndarray of int, shape (n,), or None
        Where the rows stand in a text file, from 1 on.
    """

    path: Path
    columns: dict[str, Vector]
    units: dict[str, str] = field(default_factory=dict)
    lines: npt.NDArray[np.int64] | None = None

    def row(self, k: int) -> int:
        """What a user calls the `k`-th sample, from 0 on: its line, or its number from 1 on."""
        return k + 1 if self.lines is None else int(self.lines[k])


@dataclass(frozen=True)
class _Style:
    """How a file is written."""

    separator: str
    comma: bool  # in decimals

    def cells(self, line: str) -> list[str]:
        # a program that changed the file may have filled up its lines with separators of its own
        line = line.rstrip("".join(s for s in ",; \t" if s != self.separator))
        if self.separator == " ":
            return line.split()
        if '"' in line:
            try:
                return [c.strip() for c in next(csv.reader([line], delimiter=self.separator))]
            except csv.Error:  # a quoted cell without end
                return [line]
        return [c.strip() for c in line.split(self.separator)]

    def number(self, cell: str) -> float | None:
        if not self.comma:
            return _float(cell)
        if "." in cell and not _THOUSANDS.fullmatch(cell):
            return None
        return _float(cell.replace(".", "").replace(",", "."))

    def has_point(self, cell: str) -> bool:
        """Whether a cell would be a number with a decimal point, where decimals have commas."""
        return self.comma and "." in cell and _float(cell) is not None

    def is_number(self, cell: str) -> bool:
        return self.number(cell) is not None or self.has_point(cell)

    def numbers_in(self, cells: Sequence[str]) -> int:
        return sum(self.is_number(c) for c in cells)

    def is_row(self, cells: Sequence[str]) -> bool:
        """Whether more than half of the cells are numbers or empty, and one at least a number."""
        count = self.numbers_in(cells)
        return count > 0 and count + sum(not c for c in cells) > len(cells) / 2


def _float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def read_csv(path: Path) -> Table:
    """Read a text table with any usual separator, decimal sign, encoding and header.

    Raises
    ------
    BadRecord
        If there is no table of numbers, or a row of it is broken.
    OSError
    """
    numbered = [(k, t) for k, t in enumerate(_text(path).splitlines(), 1) if t.strip(" \t,;")]
    if not numbered:
        raise BadRecord(f"{path}: is empty, expected a header row of names and rows of numbers")
    texts = [t for _, t in numbered]
    style, width, filled = _style(path, texts)
    above: Rows = []
    for text in texts:
        row = style.cells(text)
        if _fits(row, width) and style.is_row(row[:width]):
            break
        above.append(row)
    first = len(above)
    names, units = _header(path, above, style, width, filled)
    lines = np.array([k for k, _ in numbered[first:]])
    # separators at the ends of lines make columns that have neither name nor number
    wide = filled if names[filled:] == [str(k + 1) for k in range(filled, width)] else width
    plain = _plain(texts[first:], style, wide)
    if plain is None:
        table = _numbers(path, list(map(style.cells, texts[first:])), lines, names, style)
        columns = {n: v for n, v in zip(names, table, strict=True) if v is not None}
    else:
        columns = {n: plain[:, k].copy() for k, n in enumerate(names[:wide])}
    return Table(path, columns, {n: u for n, u in units.items() if n in columns}, lines)


def _text(path: Path) -> str:
    data = path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif b"\0" in data:
        raise BadRecord(f"{path}: is no text table: it has zero bytes")
    else:
        encodings = ["utf-8-sig", "cp1252", "latin-1"]
    for encoding in encodings:
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise BadRecord(f"{path}: is no text table")


def _style(path: Path, texts: Sequence[str]) -> tuple[_Style, int, int]:
    """How most of the lines become rows of at least two numbers; cells in them, and filled ones."""
    some = texts[-min(_LOOKED_AT, len(texts) // 2 + 1) :]
    best, most, width, used = None, 0, 0, 0
    for separator in _SEPARATORS:
        for comma in (False, True):
            if comma and separator == ",":
                continue
            style = _Style(separator, comma)
            rows = [row for row in map(style.cells, some) if style.is_row(row)]
            usual, _ = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
            filled = sum(style.numbers_in(row) for row in rows if len(row) == usual)
            if usual > 1 and filled > most:
                best, most, width = style, filled, usual
                used = 1 + max(k for row in rows for k in range(usual) if k < len(row) and row[k])
    if best is None:
        raise BadRecord(
            f"{path}: has no rows of numbers, expected columns with names, separated by tabs, "
            "semicolons or commas"
        )
    return best, width, used


def _fits(row: Sequence[str], width: int) -> bool:
    return len(row) >= width and not any(row[width:])


def _header(
    path: Path, above: Rows, style: _Style, width: int, filled: int
) -> tuple[list[str], dict[str, str]]:
    """Names and units from the lines above the numbers, of which `filled` cells are in use."""
    block: Rows = []
    for row in reversed(above):
        if len(row) < 2 or not _fits(row + [""] * width, width) or style.numbers_in(row) > 0:
            break
        block.append(row)
    numbers = [str(k + 1) for k in range(width)]
    if not block:
        return numbers, {}
    known = [quantity_of(_bare(c)) != "" or _bare(c) in _UNITS_TOO for c in block[0]]
    has_units = len(block) > 1 and all(known) and any(block[0])
    header = block[1] if has_units else block[0]
    if len(header) < filled:
        twice = style.separator == "," and filled == 2 * len(header)
        raise BadRecord(
            f"{path}: names {len(header)} columns ({', '.join(header)}), but its rows have {filled}"
            + ("; commas both between numbers and in them?" if twice else "")
        )
    header = (header + [""] * width)[:width]
    names = [name or number for name, number in zip(header, numbers, strict=True)]
    twice_there = [n for n, count in Counter(names).items() if count > 1]
    if twice_there:
        raise BadRecord(f"{path}: the column {twice_there[0]!r} is there twice")
    said = block[0] if has_units else []
    return names, {n: _bare(u) for n, u in zip(names, said, strict=False) if _bare(u)}


def _bare(unit: str) -> str:
    """A unit without brackets."""
    return unit.strip("[]() ")


def _plain(texts: Sequence[str], style: _Style, width: int) -> npt.NDArray[np.float64] | None:
    """All rows at once, if all of their cells are numbers; else None."""
    rows = [t.rstrip("\t;, ") for t in texts]
    if style.comma and any("." in t for t in rows):
        return None
    rows = [t.replace(",", ".") for t in rows] if style.comma else rows
    separator = None if style.separator == " " else style.separator
    try:
        table = np.loadtxt(rows, delimiter=separator, comments=None, ndmin=2)
    except ValueError:
        return None
    return table if table.shape[1] == width else None


def _numbers(
    path: Path,
    rows: Rows,
    lines: npt.NDArray[np.int64],
    names: Sequence[str],
    style: _Style,
) -> list[Vector | None]:
    """The columns; None for one of words, or without a name and without a number."""
    width = len(names)
    for row, line in zip(rows, lines, strict=True):
        if not _fits(row, width):
            raise BadRecord(f"{path}, row {line}: {len(row)} cells, expected {width}")
    columns: list[Vector | None] = []
    for k, name in enumerate(names):
        cells = [row[k] for row in rows]
        filled = list(filter(None, cells))
        if filled and all(map(style.has_point, filled)):  # in thousands, or with decimal points?
            raise BadRecord(f"{path}, column {name!r}: {filled[0]!r} has a dot; {_DOTS}")
        numbers = [style.number(c) if c else math.nan for c in cells]
        if not any(map(style.is_number, cells)) and (filled or name == str(k + 1)):
            columns.append(None)
            continue
        for cell, number, line in zip(cells, numbers, lines, strict=True):
            if number is None:
                shown = cell if len(cell) <= _SHOWN else cell[:_SHOWN] + "..."
                why = f"; {_DOTS}" if style.has_point(cell) else ""
                raise BadRecord(f"{path}, row {line}, column {name!r}: {shown!r} is no number{why}")
        columns.append(np.array(numbers, dtype=float))
    return columns
