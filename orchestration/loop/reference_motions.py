"""Set-points to follow, with their derivatives: steps, jerk-limited moves, sine, triangle.

On the command line and in study files they are written ``KIND:NAME=VALUE,...``, as in
``move:distance=0.08,speed=0.1,acceleration=1,jerk=50``.
"""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ...solver.arrays import Matrix, Vector
from ...solver.errors import BadParameter, did_you_mean
from ...solver.signals import START_VALUE
from ..fmu.limits import as_number
from ..master.reference_signal import TERMS, Reference

ReferenceLike: TypeAlias = "float | str | Path | Reference"
PIECES = 128  # of each period of a sine
MOST_POINTS = 4_000_000


def step(size: float = START_VALUE, at: float = 0.0) -> Reference:
    """A step from 0 to `size` [m] at a time [s]."""
    if not at > 0:
        return Reference.constant(size)
    return Reference.of_pieces([0.0, at], [[0.0], [size]])


def move(
    distance: float = START_VALUE,
    speed: float = 0.1,
    acceleration: float = 1.0,
    jerk: float = 50.0,
    start: float = 0.1,
    dwell: float = 0.5,
    back: float = 1.0,
) -> Reference:
    """A jerk-limited move over a distance with its sign [m], a dwell, and the way back.

    The shortest move from rest to rest within limits of speed [m/s], acceleration [m/s^2] and jerk
    [m/s^3]. It rests for `start` before it and for `dwell` at its ends [s], and comes back if
    `back` is 1.
    """
    _positive("move", speed=speed, acceleration=acceleration, jerk=jerk)
    if back not in (0.0, 1.0):
        raise BadParameter(f"back of a move is {back:g}, expected 0 or 1")
    ramp, flat, cruise = move_times(abs(distance), speed, acceleration, jerk)
    peak = math.copysign(jerk, distance)
    up = [(peak, ramp), (0.0, flat), (-peak, ramp)]
    there = [*up, (0.0, cruise), *up[::-1]]
    again = [(-j, length) for j, length in there]
    legs = [([(0.0, start)], 0.0), (there, distance), ([(0.0, dwell)], distance)]
    return _of_jerks([*legs, (again, 0.0), ([(0.0, dwell)], 0.0)] if back else legs)


def move_times(
    distance: float, speed: float, acceleration: float, jerk: float
) -> tuple[float, float, float]:
    """Lengths of a move's jerk phases, of its phases of full acceleration, and of full speed [s].

    L. Biagiotti and C. Melchiorri, Trajectory Planning for Automatic Machines and Robots (2008),
    Section 3.4: a limit that the move cannot reach within the distance has no effect.
    """
    ramp = min(acceleration / jerk, math.sqrt(speed / jerk))
    if 2 * jerk * ramp**3 >= distance:  # neither full acceleration nor full speed
        return (distance / (2 * jerk)) ** (1 / 3), 0.0, 0.0
    top = jerk * ramp  # the acceleration that is reached
    flat = max(0.0, speed / top - ramp)
    cruise = distance / speed - (2 * ramp + flat)
    if cruise >= 0:
        return ramp, flat, cruise
    # full acceleration, but not full speed: distance = top (ramp + flat) (2 ramp + flat)
    flat = -1.5 * ramp + math.sqrt(0.25 * ramp**2 + distance / top)
    return ramp, max(0.0, flat), 0.0


def _of_jerks(legs: list[tuple[list[tuple[float, float]], float]]) -> Reference:
    """The motion over legs of (jerk, length) phases and given ends, since round-off adds up."""
    times, curve, now, state = [], [], 0.0, (0.0, 0.0, 0.0)
    for phases, end in legs:
        for jerk, length in phases:
            if not length > 0:
                continue
            x, v, a = state
            times.append(now)
            curve.append([x, v, a / 2, jerk / 6])
            now += length
            place = x + v * length + a * length**2 / 2 + jerk * length**3 / 6
            state = place, v + a * length + jerk * length**2 / 2, a + jerk * length
        state = end, 0.0, 0.0
    return Reference.of_pieces([*times, now], [*curve, [*state, 0.0]])


def sine(
    amplitude: float = 1e-3, frequency: float = 1.0, duration: float = 20.0, start: float = 0.0
) -> Reference:
    """``amplitude (1 - cos(2 pi frequency t)) / 2`` from a time on: from rest, without a jump.

    The amplitude is from end to end [m]; frequency in Hz, duration and start in s.
    """
    _positive("sine", frequency=frequency, duration=duration)
    count = _count(duration * frequency * PIECES)
    times = np.append(np.arange(count) / (PIECES * frequency), duration)
    phase = 2 * math.pi * np.append(np.arange(count) % PIECES / PIECES, duration * frequency % 1.0)
    powers = np.arange(TERMS)
    sizes = (2 * math.pi * frequency) ** powers / np.array([math.factorial(p) for p in powers])
    curve = -0.5 * amplitude * sizes * np.cos(phase[:, None] + powers * math.pi / 2)
    curve[:, 0] += 0.5 * amplitude
    return _after(start, times, curve)


def triangle(
    amplitude: float = 1e-3, period: float = 1.0, duration: float = 20.0, start: float = 0.0
) -> Reference:
    """Forwards and backwards at constant speed between 0 and `amplitude` [m]; `period` in s."""
    _positive("triangle", period=period, duration=duration)
    count = _count(2 * duration / period)
    turns = np.arange(count + 1)
    rest = amplitude * (turns % 2)
    speed = 2 * amplitude / period * np.where(turns % 2 == 0, 1.0, -1.0)
    return _after(start, turns * period / 2, np.column_stack([rest, speed]))


def _after(start: float, times: Vector, curve: Matrix) -> Reference:
    if not start > 0:
        return Reference.of_pieces(times, curve)
    rest = np.zeros((1, curve.shape[1]))
    return Reference.of_pieces(np.append(0.0, start + times), np.vstack([rest, curve]))


def _count(points: float) -> int:
    if points > MOST_POINTS:
        raise BadParameter(f"a set-point of {points:.0f} points, expected at most {MOST_POINTS}")
    return math.ceil(points - 1e-9)


def _positive(kind: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise BadParameter(f"{name} of a {kind} is {value:g}, expected more than 0")


KINDS: dict[str, Callable[..., Reference]] = {k.__name__: k for k in (step, move, sine, triangle)}


def as_reference(given: ReferenceLike) -> Reference:
    """A set-point over time: a number is a constant one, text a motion or the path of a file."""
    if isinstance(given, Reference):
        return given
    if not isinstance(given, str | Path):
        return Reference.constant(as_number("reference", given))
    text = str(given)
    kind, colon, values = text.partition(":")
    if kind in KINDS:
        return _motion(text, kind, values)
    if colon and not os.path.exists(text):
        raise BadParameter(
            f"{text!r}: there is no such file and no motion {kind!r}; motions are "
            f"{', '.join(KINDS)}{did_you_mean(kind, KINDS)}"
        )
    return Reference.read(text)


def _motion(text: str, kind: str, given: str) -> Reference:
    known = list(inspect.signature(KINDS[kind]).parameters)
    values: dict[str, float] = {}
    for part in filter(None, given.split(",")):
        name, _, number = (piece.strip() for piece in part.partition("="))
        if name not in known:
            raise BadParameter(f"{text!r}: {kind} has no {name!r}; it has {', '.join(known)}")
        values[name] = as_number(f"{text!r}: {name}", number)
    try:
        with np.errstate(all="ignore"):
            motion = KINDS[kind](**values)
    except (OverflowError, ZeroDivisionError):
        motion = Reference.constant(math.nan)
    if not (np.isfinite(motion.times).all() and np.isfinite(motion.pieces(0)).all()):
        raise BadParameter(f"{text!r}: its times or places are beyond all numbers")
    return motion
