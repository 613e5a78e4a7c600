"""A table of trials: is the scatter of a value random, or does a recorded condition explain it?

The test permutes the trials and does not assume normal values: if a condition has no effect, all
assignments of its levels to otherwise equal trials are equally likely. A few trials have only a few
such assignments, so the smallest possible p-value is given with the result.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from thesis_trials.permutation_test import (
    holm,
    level_codes,
    permute_levels,
    ratio,
    residual_squares,
)

Vector = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

LEVEL = 0.05  # p-value, corrected, below which a condition explains scatter
LEAST_TRIALS = 4


class BadTable(ValueError):
    """The table cannot be used; the message says what it is, what is wrong and what to do."""


@dataclass(frozen=True)
class Level:
    """The trials at one level of a condition: their number, and the mean of their value."""

    label: str
    trials: int
    mean: float


@dataclass(frozen=True)
class Condition:
    """Relation of one recorded condition to a value.

    Attributes
    ----------
    same_as : tuple of str
        Columns that divide the trials in the same way; the results hold for any of them.
    levels : tuple of Level
    share : float
        Share of the sum of squares about the mean that only this condition explains.
    difference : float
        Largest mean of a level less the smallest, in the value's unit.
    standardized : float
        The same in residual standard deviations; infinite if the residual is zero.
    p_value, corrected : float
        Share of the assignments that explain at least as much; Holm's correction for the number of
        conditions tested.
    smallest_p, smallest_corrected : float
        The smallest p-value possible with these trials, and its correction if it were the only
        small one. 1: no two trials differ in this condition only.
    assignments : int
        Number of different assignments, or of random ones.
    exact : bool
        All assignments were counted.
    explains : bool
        `corrected` is below `LEVEL`.
    """

    name: str
    same_as: tuple[str, ...]
    levels: tuple[Level, ...]
    share: float
    difference: float
    standardized: float
    p_value: float
    corrected: float
    smallest_p: float
    smallest_corrected: float
    assignments: int
    exact: bool
    explains: bool

    @property
    def can_tell(self) -> bool:
        """Whether these trials could have shown the strongest possible effect."""
        return self.smallest_corrected < LEVEL


@dataclass(frozen=True)
class TrialsDiagnosis:
    """Scatter of one column explained by the conditions of the trials.

    Attributes
    ----------
    table, value : str
    trials : int
        Number of trials with the value and all conditions.
    left_out : int
        Number of other trials.
    mean, deviation : float
        Mean and standard deviation of the value over all trials, with n - 1 in the denominator.
    explained : float
        Share of the sum of squares explained by all conditions together, with a separate mean for
        each level of each condition.
    adjusted : float
        The same less the share explained by equally many columns of noise; may be below zero.
    residual_deviation : float
        Residual standard deviation with its degrees of freedom; NaN without any.
    conditions : tuple of Condition
        Conditions in the order of their explained share.
    no_conditions : dict of str to str
        The other columns, with the reason why each is not a condition.
    """

    table: str
    value: str
    trials: int
    left_out: int
    mean: float
    deviation: float
    explained: float
    adjusted: float
    residual_deviation: float
    conditions: tuple[Condition, ...]
    no_conditions: Mapping[str, str]

    @property
    def answer(self) -> str:
        """One sentence: whether the scatter is random."""
        explaining = [c for c in self.conditions if c.explains]
        if explaining:
            told = "; ".join(
                f"{c.name} explains {c.share:.0%} (p = {c.corrected:.2g}), "
                f"{c.difference:.3g} between its levels"
                for c in explaining
            )
            return f"The scatter of {self.value} is not all scatter: {told}."
        able = [c.name for c in self.conditions if c.can_tell]
        unable = [c.name for c in self.conditions if not c.can_tell]
        parts = []
        if able:
            parts.append(f"no sign that {' or '.join(able)} explains the scatter of {self.value}")
        if unable:
            least = min(c.smallest_corrected for c in self.conditions if not c.can_tell)
            parts.append(
                f"{self.trials} trials cannot tell about {' or '.join(unable)}: "
                f"the smallest p-value they could have given is {least:.2g}"
            )
        if not parts:
            return f"No condition was recorded that could explain the scatter of {self.value}."
        sentence = "; ".join(parts)
        return sentence[0].upper() + sentence[1:] + "."


def explain_scatter(table: Path | str, value: str) -> TrialsDiagnosis:
    """Test whether the recorded conditions of trials explain a value's scatter.

    Constant columns are not used. A column with more than half as many different values as trials
    counts as the trial's number or another result, not as a condition.

    Parameters
    ----------
    table : Path or str
        CSV with a header, one trial per row; an empty cell is a missing value.
    value : str
        The column whose scatter is tested.

    Returns
    -------
    TrialsDiagnosis

    Raises
    ------
    BadTable
        If the table cannot be read, has no such column, or its values cannot be compared.
    """
    path = Path(table)
    columns = read_columns(path)
    if value not in columns:
        raise BadTable(f"{path}: no column {value!r}; there are {', '.join(columns)}")
    conditions, no_conditions = _conditions(columns, value)
    complete = [
        k
        for k, cell in enumerate(columns[value])
        if cell and all(columns[n][k] for n in conditions)
    ]
    y = _values(path, value, [columns[value][k] for k in complete])
    n, total = len(y), float(((y - y.mean()) ** 2).sum())
    labels = {n: [columns[n][k] for k in complete] for n in conditions}
    codes = {n: level_codes(cells) for n, cells in labels.items()}
    # without the left-out trials, a level or a difference may be missing
    for name in [n for n, c in codes.items() if c.max() == 0]:
        no_conditions[name] = "the same in every trial that has the value"
        del codes[name]
    alike = {n: next(m for m in codes if np.array_equal(codes[m], codes[n])) for n in codes}
    no_conditions |= {
        n: f"divides the trials as {first} does" for n, first in alike.items() if n != first
    }
    same_as = {n: [m for m in codes if alike[m] == n != m] for n in codes if alike[n] == n}
    kept = {n: codes[n] for n in same_as}
    left, freedom = residual_squares(y, list(kept.values()))
    residual = math.sqrt(left / freedom) if freedom else math.nan
    found = _tested(y, kept, labels, same_as, residual)
    return TrialsDiagnosis(
        path.name,
        value,
        n,
        len(columns[value]) - n,
        float(y.mean()),
        math.sqrt(total / (n - 1)),
        1 - left / total,
        1 - (left / freedom) / (total / (n - 1)) if freedom else math.nan,
        residual,
        tuple(found),
        no_conditions,
    )


def _values(path: Path, value: str, cells: Sequence[str]) -> Vector:
    """The value's numbers; raise BadTable if there are too few or if they are all equal."""
    y = np.array([number(path, value, cell) for cell in cells])
    if len(y) < LEAST_TRIALS:
        raise BadTable(
            f"{path}: {len(y)} trials have {value!r} and its conditions, expected at least "
            f"{LEAST_TRIALS}"
        )
    total = float(((y - y.mean()) ** 2).sum())
    if total <= (1e-12 * float(np.abs(y).max())) ** 2 * len(y):
        raise BadTable(f"{path}: {value!r} is {y[0]:g} in every trial, there is no scatter")
    return y


def _tested(
    y: Vector,
    codes: Mapping[str, Indices],
    labels: Mapping[str, Sequence[str]],
    same_as: Mapping[str, Sequence[str]],
    residual: float,
) -> list[Condition]:
    """Each condition tested with all others, in the order of the explained share."""
    total = float(((y - y.mean()) ** 2).sum())
    tests = {
        n: permute_levels(y, c, [o for m, o in codes.items() if m != n]) for n, c in codes.items()
    }
    corrected = holm({n: t.p_value for n, t in tests.items()})
    found = []
    for name, test in tests.items():
        levels = _levels(y, codes[name], labels[name])
        difference = max(v.mean for v in levels) - min(v.mean for v in levels)
        found.append(
            Condition(
                name,
                tuple(same_as[name]),
                levels,
                test.explained / total,
                difference,
                ratio(difference, residual),
                test.p_value,
                corrected[name],
                test.smallest_p,
                min(1.0, test.smallest_p * len(tests)),
                test.assignments,
                test.exact,
                corrected[name] < LEVEL,
            )
        )
    return sorted(found, key=lambda c: (-c.share, c.name))


def read_columns(path: Path) -> dict[str, list[str]]:
    """The cells of a CSV table by column, as text.

    Raises
    ------
    BadTable
        If it cannot be read, has no rows, or rows of different lengths.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [r for r in csv.reader(file) if any(cell.strip() for cell in r)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadTable(f"{path}: cannot be read as a CSV table: {error}") from error
    if len(rows) < 2:
        raise BadTable(f"{path}: {len(rows)} lines, expected a header and a trial in each row")
    header = [name.strip() for name in rows[0]]
    if len(set(header)) < len(header):
        twice = next(n for n in header if header.count(n) > 1)
        raise BadTable(f"{path}: two columns are named {twice!r}, expected different names")
    for k, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise BadTable(f"{path}: row {k} has {len(row)} cells, expected {len(header)}")
    return {n: [r[j].strip() for r in rows[1:]] for j, n in enumerate(header)}


def number(path: Path, column: str, cell: str) -> float:
    """A cell as a finite number.

    Raises
    ------
    BadTable
        If it is not a finite number.
    """
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadTable(f"{path}: {column!r} is {cell!r} in a row, expected a number")
    return value


def _conditions(columns: Mapping[str, list[str]], value: str) -> tuple[list[str], dict[str, str]]:
    """The columns that are conditions, and the reasons why others are not."""
    conditions, others = [], {}
    for name, cells in columns.items():
        if name == value:
            continue
        with_value = [c for c, v in zip(cells, columns[value], strict=True) if v and c]
        levels = len(set(with_value))
        if levels < 2:
            others[name] = "the same in every trial that has the value"
        elif 2 * levels > len(with_value):
            others[name] = "hardly ever the same twice: the trial's number, or another result"
        else:
            conditions.append(name)
    return conditions, others


def _levels(y: Vector, codes: Indices, labels: Sequence[str]) -> tuple[Level, ...]:
    levels = []
    for code in range(int(codes.max()) + 1):
        at = np.flatnonzero(codes == code)
        levels.append(Level(labels[int(at[0])], len(at), float(y[at].mean())))
    return tuple(levels)
