"""Communication points as multiples of one tick, so that time does not drift."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .structs import compiled, struct

FINEST = 12  # adaptive steps go down to 2^-12 of the given one


CLOCK = np.dtype(
    [
        ("tick", float),  # unit of time [s]
        ("stop", float),  # end [s]
        ("last", np.int64),  # ticks of the run
        ("longest", np.int64),  # ticks of the longest step
        ("adaptive", np.int64),
        ("count", np.int64),  # ticks gone
        ("stride", np.int64),  # ticks of the step to come
        ("shortest_used", float),  # [s]
        ("longest_used", float),  # [s]
    ]
)
"""Where a run stands."""


def clock(stop: float, step: float, adaptive: bool) -> Any:
    """A clock at time zero, for steps of this length [s] or for steps up to it."""
    size = 2**FINEST if adaptive else 1
    tick = step / size
    last = max(1, math.ceil(stop / tick - 1e-9))
    made = struct(CLOCK)
    made.set(tick=tick, stop=stop, last=last, longest=size, stride=size, adaptive=adaptive)
    made.set(shortest_used=math.inf)
    return made.record


@compiled
def now(clock: Any) -> float:
    """Present time [s]."""
    return float(min(clock.count * clock.tick, clock.stop))


@compiled
def done(clock: Any) -> bool:
    """Whether the end is reached."""
    return bool(clock.count >= clock.last)


@compiled
def next_place(clock: Any) -> int:
    """Ticks gone after the step to come."""
    return int(min(clock.count + clock.stride, clock.last))


@compiled
def next_time(clock: Any) -> float:
    """Time after the step to come [s]."""
    return float(min(next_place(clock) * clock.tick, clock.stop))


@compiled
def step_to_come(clock: Any) -> float:
    """Its length [s]: a multiple of the tick, but for a last, shorter one."""
    following = next_place(clock)
    if following * clock.tick > clock.stop:
        return float(clock.stop - now(clock))
    return float((following - clock.count) * clock.tick)


@compiled
def accept(clock: Any) -> None:
    """Go on by the step."""
    step = step_to_come(clock)
    clock.shortest_used = min(clock.shortest_used, step)
    clock.longest_used = max(clock.longest_used, step)
    clock.count = next_place(clock)


@compiled
def adapt(clock: Any, share: float) -> None:
    """Halve or double the step, so that steps stay aligned with multiples of themselves.

    `share` is what the last one cost of what it may.
    """
    count, stride = clock.count, clock.stride
    if share > 1.0 and stride > 1:
        clock.stride = stride // 2
    elif share < 0.1 and stride < clock.longest and count % (2 * stride) == 0:
        clock.stride = 2 * stride
