"""The unit that suits the size of numbers, for tables and pictures: one rule for all."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np

_STEPS = ((1.0, 1.0, ""), (1e-3, 1e3, "m"), (1e-6, 1e6, "µ"), (0.0, 1e9, "n"))
_RAD = 0.1
_PREFIXED = re.compile(r"(?:m|A|rad)(?=$|[/*])")  # mV and mN are no usual units of drives


def shown_unit(values: Iterable[float] | Any, unit: str) -> tuple[float, str]:
    """The factor from a unit to the one that suits the largest of some values, and that unit.

    Parameters
    ----------
    values : array_like
        In `unit`; values that are not finite are ignored.
    unit : str
        A unit that begins with m, A or rad gets a prefix; "1" means no unit.

    Examples
    --------
    >>> shown_unit([0.02, -0.08], "m"), shown_unit([3e-6], "m/s"), shown_unit([0.0], "m")
    ((1000.0, 'mm'), (1000000.0, 'µm/s'), (1.0, 'm'))
    """
    sizes = np.abs(np.asarray(values, dtype=float))
    largest = float(np.max(sizes, initial=0.0, where=np.isfinite(sizes)))
    whole = unit.startswith("rad") and largest >= _RAD  # 0.5 rad is no 500 mrad
    if not _PREFIXED.match(unit) or largest == 0.0 or whole:
        return 1.0, "" if unit == "1" else unit
    factor, prefix = next((f, p) for least, f, p in _STEPS if largest >= least)
    return factor, prefix + unit


def quantity(value: float | None, unit: str) -> str:
    """A number with six digits in the unit that suits it; a dash if there is none."""
    if value is None:
        return "-"
    factor, shown = shown_unit([value], unit)
    return f"{factor * value:.6g} {shown}".rstrip()


def labelled(name: str, unit: str) -> str:
    """The label of an axis."""
    return f"{name} [{unit}]" if unit else name
