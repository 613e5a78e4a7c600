"""Limits of the numbers of a run, checked once at input; and of the memory that it may need."""

from __future__ import annotations

import math
from typing import Any

from ...solver.errors import BadParameter, UserError
from .operating_system import available_memory

SHORTEST = 1e-9  # [s]: a shorter motion has no steps
MOST_STEPS = 1e9  # a run with more would not end in reasonable time
FIRST_STEP = 1e-3  # first step that is tried; step of exponents and maps over FMUs [s]
TIME_LIMIT = 60.0  # for any one call of an FMU in its own process [s]
TOLERANCE = 1e-11  # of exponents; maps of many loops use a coarser one
TOLERANCE_OF_MAPS, TOLERANCE_OF_MOTIONS = (1e-8, 1e-6)  # with exponents, and by the motion alone


def as_number(what: str, given: Any) -> float:
    """A finite number, also from text; raises `BadParameter`."""
    try:
        value = float(given)
    except (ValueError, TypeError):
        raise BadParameter(f"{what} is {given!r}, expected a number") from None
    if not math.isfinite(value):
        raise BadParameter(f"{what} is {given}, expected a finite number")
    return value


def check_length(what: str, given: Any) -> float:
    """A length of time [s]; raises `BadParameter`."""
    length = as_number(what, given)
    if length < SHORTEST:
        raise BadParameter(f"{what} is {given} s, expected more than 0, at least {SHORTEST:g} s")
    return length


def check_corrections(what: str, given: Any) -> int | None:
    """Number of corrections of a step; None: as many as the parts allow. Raises `BadParameter`."""
    if given not in (None, 0, 1, "0", "1"):
        raise BadParameter(f"{what} is {given!r}, expected 0 or 1")
    return None if given is None else int(given)


def check_step(what: str, given: Any, stop: float | None) -> float:
    """A communication step [s] of a motion of this length; raises `BadParameter`.

    The length is None if it is not known yet.
    """
    step, stop = as_number(what, given), math.inf if stop is None else stop
    if not 0 < step <= stop:
        longest = what.replace("step", "stop")
        raise BadParameter(f"{what} is {given} s, expected more than 0 and at most {longest}")
    if stop < math.inf and stop / step > MOST_STEPS:
        raise BadParameter(f"{what} {step:g} makes {stop / step:.3g} steps; use a larger one")
    return step


def check_memory(size: float, what: str, remedy: str) -> None:
    """Reject a request that would need so many bytes: what it is and the remedy become one line."""
    room = available_memory()
    if room is not None and size > room:
        need, left = (f"{n / 1e6:.3g} MB" if n < 1e9 else f"{n / 1e9:.3g} GB" for n in (size, room))
        raise UserError(f"{what}, about {need} of memory, but only {left} is available; {remedy}")
