"""Communication points as multiples of one tick, so that time does not drift."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .compiled import CLOCK, library
from .reference_signal import ROUND_OFF
from .structs import struct

FINEST = 12  # adaptive steps go down to 2^-12 of the given one


class Clock:
    """State of a run in time: from zero, with fixed steps or with steps up to a length.

    Parameters
    ----------
    stop, step : float
        [s]
    adaptive : bool
    breaks : array_like, shape (m,)
        Rising times at which a step must also end [s].
    """

    def __init__(
        self, stop: float, step: float, adaptive: bool, breaks: npt.ArrayLike = ()
    ) -> None:
        size = 2**FINEST if adaptive else 1
        tick = step / size
        last = max(1, math.ceil(stop / tick - 1e-9))
        self._whole = struct(CLOCK)
        self._whole.set(tick=tick, stop=stop, last=last, longest=size, stride=size)
        self._whole.set(adaptive=adaptive, shortest_used=math.inf)
        close = max(ROUND_OFF * step, 1e-14 * stop)
        times = np.asarray(breaks, dtype=float)
        times = times[(times > close) & (times < stop - close)]
        times = times[np.diff(times, prepend=0.0) > close]
        self._whole.set(close=close, breaks=times)
        self.address = self._whole.address

    @property
    def now(self) -> float:
        """Present time [s]."""
        return float(library().clock_now(self.address))

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return bool(self._whole.record.count >= self._whole.record.last)

    @property
    def step_to_come(self) -> float:
        """Length of the next step [s]: a multiple of the tick, except a last, shorter one."""
        return float(library().clock_step_to_come(self.address))

    def next_ticks(self, count: int) -> None:
        """Set the length of the next step of a fixed-step clock in ticks."""
        self._whole.set(stride=count)

    @property
    def used(self) -> tuple[float, float]:
        """Shortest and longest step so far [s]."""
        record = self._whole.record
        return float(record.shortest_used), float(record.longest_used)
