"""Set-points to follow, with their derivatives: steps, jerk-limited moves, sine, triangle.

On the command line and in study files they are written ``KIND:NAME=VALUE,...``, as in
``move:distance=0.08,speed=0.1,acceleration=1,jerk=50``.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable

import numpy as np

from .reference_signal import BadReference, Reference

SPACING = 2.5e-4  # s, between the points of a curved set-point
MOST_POINTS = 4_000_000


def step(size: float = 0.08, at: float = 0.0) -> Reference:
    """A step from 0 to `size` [m] at a time [s]."""
    if not at > 0:
        return Reference.constant(size)
    zero = np.zeros(3)
    return Reference(np.array([0.0, at, at]), np.array([0.0, 0.0, size]), zero, zero)


def move(
    distance: float = 0.08,
    speed: float = 0.1,
    acceleration: float = 1.0,
    jerk: float = 50.0,
    start: float = 0.1,
    dwell: float = 0.5,
    back: float = 1.0,
) -> Reference:
    """A jerk-limited move over a distance, a dwell, and the way back.

    The shortest move from rest to rest within the limits, of at most seven phases of constant jerk.

    Parameters
    ----------
    distance : float
        With its sign [m].
    speed, acceleration, jerk : float
        Limits [m/s], [m/s^2], [m/s^3].
    start, dwell : float
        Rest before the move, and at its end [s].
    back : {1, 0}
        Whether it comes back.

    Raises
    ------
    BadReference
        If a limit is not positive.
    """
    limits = {"speed": speed, "acceleration": acceleration, "jerk": jerk}
    for name, limit in limits.items():
        if not (math.isfinite(limit) and limit > 0):
            raise BadReference(f"{name} of a move is {limit:g}, expected more than 0")
    if back not in (0.0, 1.0):
        raise BadReference(f"back of a move is {back:g}, expected 0 or 1")
    ramp, flat, cruise = move_times(abs(distance), speed, acceleration, jerk)
    peak = math.copysign(jerk, distance)
    there = [(peak, ramp), (0.0, flat), (-peak, ramp), (0.0, cruise)]
    there += [(-peak, ramp), (0.0, flat), (peak, ramp)]
    again = [(-j, length) for j, length in there]
    legs = [([(0.0, start)], 0.0), (there, distance), ([(0.0, dwell)], distance)]
    legs += [(again, 0.0), ([(0.0, dwell)], 0.0)] if back else []
    return _of_jerks(legs)


def move_times(
    distance: float, speed: float, acceleration: float, jerk: float
) -> tuple[float, float, float]:
    """Lengths of a move's jerk phases, of its phases of full acceleration, and of full speed [s].

    L. Biagiotti and C. Melchiorri, Trajectory Planning for Automatic Machines and Robots (2008),
    Section 3.4: a limit that the distance does not let the move reach gives way.
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
    """The motion from rest to rest over each leg: phases of constant jerk [m/s^3] and their lengths
    [s], and the position where they end [m], which is told since round-off would leave it creeping.
    """
    rows, state, now = [np.zeros((1, 4))], np.zeros(3), 0.0
    for phases, end in legs:
        for jerk, length in phases:
            if not length > 0:
                continue
            curved = bool(jerk or state[2])
            t = np.linspace(0.0, length, (_points(length) if curved else 1) + 1)[1:]
            x, v, a = state
            acceleration = a + jerk * t
            velocity = v + a * t + jerk * t**2 / 2
            position = x + v * t + a * t**2 / 2 + jerk * t**3 / 6
            rows.append(np.column_stack([now + t, position, velocity, acceleration]))
            state, now = rows[-1][-1, 1:], now + length
        state[:] = end, 0.0, 0.0
    return Reference(*np.concatenate(rows).T)


def sine(
    amplitude: float = 1e-3, frequency: float = 1.0, duration: float = 20.0, start: float = 0.0
) -> Reference:
    """``amplitude (1 - cos(2 pi frequency t)) / 2`` from a time on: from rest, without a jump.

    Parameters
    ----------
    amplitude : float
        From end to end [m].
    frequency : float
        [Hz]
    duration, start : float
        [s]
    """
    _positive("sine", frequency=frequency, duration=duration)
    omega = 2 * math.pi * frequency
    t = np.linspace(0.0, duration, _points(duration, 1 / (400 * frequency)) + 1)
    half = amplitude / 2
    table = [
        half * (1 - np.cos(omega * t)),
        half * omega * np.sin(omega * t),
        half * omega**2 * np.cos(omega * t),
    ]
    return _after(start, Reference(t, *table))


def triangle(
    amplitude: float = 1e-3, period: float = 1.0, duration: float = 20.0, start: float = 0.0
) -> Reference:
    """To and fro at constant speed between 0 and `amplitude` [m], `period` [s] for both ways.

    Its velocity jumps at the turning points, where two points share a time; the acceleration there
    is left out of what is fed forward.
    """
    _positive("triangle", period=period, duration=duration)
    count = math.ceil(2 * duration / period - 1e-9)
    _check_count(count)
    turns = np.arange(count + 1)
    speed = 2 * amplitude / period
    t = np.repeat(turns * period / 2, 2)[1:-1]
    x = np.repeat(amplitude * (turns % 2), 2)[1:-1]
    v = np.where(np.repeat(turns[:-1], 2) % 2 == 0, speed, -speed)
    return _after(start, Reference(t, x, v, np.zeros(len(t))))


def _after(start: float, motion: Reference) -> Reference:
    if not start > 0:
        return motion
    rest = np.zeros(2)
    columns = (np.concatenate([rest, motion.derivative(order)]) for order in range(3))
    return Reference(np.concatenate([[0.0, start], start + motion.times]), *columns)


def _points(length: float, spacing: float = SPACING) -> int:
    count = max(4, math.ceil(length / min(spacing, SPACING)))
    _check_count(count)
    return count


def _check_count(count: int) -> None:
    if count > MOST_POINTS:
        raise BadReference(f"a set-point of {count} points, expected at most {MOST_POINTS}")


def _positive(kind: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise BadReference(f"{name} of a {kind} is {value:g}, expected more than 0")


KINDS: dict[str, Callable[..., Reference]] = {
    "step": step,
    "move": move,
    "sine": sine,
    "triangle": triangle,
}


def read_motion(text: str) -> Reference | None:
    """A set-point from ``KIND:NAME=VALUE,...``; None where the text names no kind.

    Raises
    ------
    BadReference
        If a name is not one of the kind's, or a value is no finite number.
    """
    kind, colon, rest = text.partition(":")
    if kind not in KINDS or not (colon or text in KINDS):
        return None
    known = list(inspect.signature(KINDS[kind]).parameters)
    values: dict[str, float] = {}
    for part in filter(None, rest.split(",")):
        name, _, number = (piece.strip() for piece in part.partition("="))
        if name not in known:
            raise BadReference(f"{text!r}: {kind} has no {name!r}; it has {', '.join(known)}")
        try:
            values[name] = float(number)
        except ValueError:
            raise BadReference(f"{text!r}: {name} is {number!r}, expected a number") from None
        if not math.isfinite(values[name]):
            raise BadReference(f"{text!r}: {name} is {number}, expected a finite number")
    return KINDS[kind](**values)
