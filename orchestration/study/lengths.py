"""Lengths in millimetres or micrometres, by their size."""

from __future__ import annotations

import math
from collections.abc import Iterable
from statistics import median

LARGE = 1e-3  # m; from here on in millimetres


def scale(lengths: Iterable[float]) -> tuple[float, str]:
    """Factor for lengths [m], and the unit: by the median of those that are not NaN or infinite."""
    sizes = [abs(x) for x in lengths if math.isfinite(x)]
    return (1e3, "mm") if sizes and median(sizes) >= LARGE else (1e6, "um")


def length(value: float) -> str:
    """One length [m] with three digits and its unit."""
    factor, unit = scale([value])
    return f"{factor * value:.3g} {unit}"
