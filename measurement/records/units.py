"""Units of recorded data, and their conversion to SI.

A rotary drive's angles and torques become positions and forces of its screw: an angle `phi` is the
position ``lead*phi/(2*pi)``, a torque `T` the force ``2*pi*T/lead``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from ...solver.errors import BadRecord

UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
    | {"in": 0.0254, "ft": 0.3048},
    "angle": {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6}
    | {"m/min": 1 / 60, "mm/min": 1e-3 / 60.0, "km/h": 1 / 3.6, "in/s": 0.0254, "ft/s": 0.3048},
    "acceleration": {"m/s^2": 1.0, "mm/s^2": 1e-3},
    "angular acceleration": {"rad/s^2": 1.0},
    "angular velocity": {"rad/s": 1.0, "deg/s": math.pi / 180, "rev/s": 2 * math.pi}
    | {"rpm": math.pi / 30},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "torque": {"N*m": 1.0, "mN*m": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
    "temperature": {"degC": 1.0},
}
"""Factors to SI units, by quantity."""
ROTARY = {"angle": "length", "angular velocity": "velocity", "torque": "force"}  # by a screw
NO_UNIT = ("", "-", "1")  # words for no unit, or for an unknown one
_SPELLINGS = {
    **{"sec": "s", "µs": "us", "µm": "um", "µm/s": "um/s", "°": "deg", "°/s": "deg/s"},
    **dict.fromkeys(("1/min", "min-1", "r/min", "rev/min"), "rpm"),
    **{"Nm": "N*m", "mNm": "mN*m", "°C": "degC", "volt": "V", "volts": "V"},
}
_SIZED = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?:\s*\*\s*|\s+)(.+)")


def spell(unit: str) -> str:
    """A unit in the spelling of `UNITS`; other text unchanged."""
    unit = unit.strip().replace("μ", "µ").replace("²", "2")  # two characters look like mu
    unit = re.sub("/s2$", "/s^2", re.sub("N[.·]m$", "N*m", unit))
    return _SPELLINGS.get(unit, unit)


def quantity_of(unit: str) -> str:
    """The quantity of a unit; empty for an unknown unit."""
    return next((q for q, units in UNITS.items() if spell(unit) in units), "")


def conversion(
    column: str, text: str, quantities: Sequence[str], lead: float | None
) -> tuple[float, str]:
    """Factor to SI values of a linear motion, and the recorded quantity, a key of `UNITS`.

    `text` is a unit, or a number of units such as ``2.5e-6*m``; `lead` is the screw's [m].
    """
    sized = _SIZED.fullmatch(text.strip())
    unit = spell(sized[2] if sized else text)
    size = float(sized[1]) if sized else 1.0
    quantity = quantity_of(unit)
    if not math.isfinite(size) or size == 0.0 or quantity not in quantities:
        known = ", ".join(u for q in quantities for u in UNITS[q])
        such = f"a number of them such as 1e-3*{next(iter(UNITS[quantities[0]]))}"
        raise BadRecord(f"unit {column}={text}: expected one of {known}, or {such}")
    factor = size * UNITS[quantity][unit]
    if quantity not in ROTARY:
        return factor, quantity
    if lead is None:
        why = "the conversion along the screw depends on its lead"
        give = "give lead in metres, or p (turns per metre) in params"
        raise BadRecord(f"unit {column}={text}: {why}; {give}")
    per_metre = 2 * math.pi / lead
    return factor * (per_metre if quantity == "torque" else 1.0 / per_metre), quantity
