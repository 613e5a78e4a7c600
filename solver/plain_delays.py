"""Delayed signals for the stepper in plain Python; the same method as in ``c/delays.h``.

This file imports only `core`: both are part of every exported FMU.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .core import (
    COUNT,
    DISTURBED,
    DURATIONS,
    END,
    PIECES,
    ROOM,
    new_history,
    roomier,
    step_size,
)

SMOOTH = 5  # orders above this one disturb no step
NO_JUMP = 99.0
SAME_TIME = 1e-12
UNRESOLVED = 1e-4


class PlainDelays:
    """The functions of a generated text, with delayed signals and their history.

    Parameters
    ----------
    functions : mapping or namespace of str to function
    count, first, held : int
        Delayed signals, place of the first in u, and the length of u.
    """

    def __init__(self, functions: Any, count: int, first: int, held: int) -> None:
        self.plain = functions
        self.count, self.first, self.held = count, first, held
        self.kind = functions.kind
        self._steps = DURATIONS + count + held
        self._size = step_size(count)
        self.history = new_history(count, held)

    def make_room(self) -> None:
        """Double the room of the history."""
        self.history = roomier(self.history, self.count, self.held)

    # -- the functions ---------------------------------------------------------------------------

    def __getattr__(self, name: str) -> Any:
        """A function of the text with the delayed signals filled in."""
        plain = getattr(self.plain, name)

        def late(t: float, x: Any, u: Any, p: Any, *rest: Any) -> None:
            self._look_back(t, x, u, p)
            plain(t, x, u, p, *rest)
            if name == "react":
                self.history[DISTURBED] = 1.0

        setattr(self, name, late)
        return late

    def _delayed(self, t: float, x: Any, u: Any, p: Any) -> list[float]:
        told = [0.0] * (4 * self.count)
        self.plain.delayed(t, x, u, p, told)
        return told

    # -- the history -----------------------------------------------------------------------------

    def _step(self, k: int) -> int:
        """Where the numbers of a step begin."""
        return self._steps + k * self._size

    def _same(self, t: float) -> float:
        """Largest difference of two times near t that count as equal."""
        return SAME_TIME * (abs(t) + abs(float(self.history[END])))

    def _step_of(self, t: float) -> int:
        """The last step that began before or at t; -1 if there is none."""
        low, high = -1, int(self.history[COUNT])
        while high - low > 1:
            middle = (low + high) // 2
            if self.history[self._step(middle)] <= t:
                low = middle
            else:
                high = middle
        return low

    def _look_back(self, t: float, x: Any, u: Any, p: Any) -> None:
        h = self.history
        count, end, same = int(h[COUNT]), float(h[END]), self._same(t)
        # at the start of a step, signals have their values after it; within it, those before
        side = same if t <= end + same else -same
        told: list[float] = []
        for j in range(self.count):
            then = t - float(h[DURATIONS + j])
            k = self._step_of(then + side) if count > 0 else -1
            if k < 0:
                told = told or self._delayed(t, x, u, p)
                u[self.first + j] = told[2 * self.count + j]
                u[self.first + self.count + j] = 0.0
                continue
            step = self._step(k)
            begin = float(h[step])
            after = float(h[self._step(k + 1)]) if k + 1 < count else end
            share = (min(then, after) - begin) / (after - begin)
            at = step + 2 + (PIECES + 1) * j
            value, slope = _through(h[at : at + PIECES + 1].tolist(), PIECES * share)
            u[self.first + j] = value
            u[self.first + self.count + j] = PIECES * slope / (after - begin)

    def begin(self, t0: float, x: Any, u: Any, p: Any) -> bool:
        """Prepare steps from t0; False if a delay is zero."""
        h = self.history
        durations = self._delayed(t0, x, u, p)[self.count : 2 * self.count]
        h[DURATIONS : DURATIONS + self.count] = durations
        if not all(0.0 < duration < math.inf for duration in durations):
            return False
        if h[COUNT] == 0.0 or abs(t0 - float(h[END])) > self._same(t0):
            h[COUNT], h[END], h[DISTURBED] = 0.0, t0, 1.0
        return True

    def has_room(self) -> bool:
        """Whether there is room for one more step; old steps are removed first."""
        h = self.history
        count = int(h[COUNT])
        if count < int(h[ROOM]):
            return True
        longest = float(max(h[DURATIONS : DURATIONS + self.count]))
        end = float(h[END])
        kept = self._step_of(end - longest - 2.0 * self._same(end))
        if 2 * kept < count:
            return False
        left = h[self._step(kept) : self._step(count)].copy()
        h[self._steps : self._steps + len(left)] = left
        h[COUNT] = count - kept
        return True

    def latest_end(self, t: float, t1: float) -> float:
        """Latest end of a step from t."""
        h = self.history
        same, count, end = 2.0 * self._same(t), int(h[COUNT]), t1
        for j in range(self.count):
            duration = float(h[DURATIONS + j])
            end = min(end, t + duration)
            for k in range(self._step_of(t - duration + same) + 1, count):
                if h[self._step(k) + 1] <= SMOOTH:
                    end = min(end, float(h[self._step(k)]) + duration)
                    break
        return end if end < t1 - same else t1  # no tiny step because of round-off

    def _level_from_before(self, t: float) -> float:
        """Order of the derivative that jumps at the start of this step, from earlier steps."""
        h, same, level = self.history, 2.0 * self._same(t), NO_JUMP
        for j in range(self.count):
            then = t - float(h[DURATIONS + j])
            for k in range(self._step_of(then + same), -1, -1):
                step = self._step(k)
                if h[step] < then - same:
                    break
                if h[step + 1] <= SMOOTH:
                    level = min(level, float(h[step + 1]) + 1.0)
        return level

    def follow(
        self,
        t: float,
        h: float,
        dense: Callable[[float], Any],
        u: Any,
        p: Any,
        rtol: float,
    ) -> float:
        """Write the signals of a step after the known ones; return error over tolerance."""
        known = self.history
        step = self._step(int(known[COUNT]))
        apart = 0.0
        shortest = float(min(known[DURATIONS : DURATIONS + self.count]))
        for k in range(PIECES + 2):
            share = k / PIECES if k <= PIECES else 0.5 / PIECES
            x = dense(share)
            self._look_back(t + share * h, x, u, p)
            told = self._delayed(t + share * h, x, u, p)
            for j in range(self.count):
                at = step + 2 + (PIECES + 1) * j
                if k <= PIECES:
                    known[at + k] = told[j]
                    continue
                values = known[at : at + PIECES + 1].tolist()
                size = max(told[3 * self.count + j], *map(abs, values))
                apart = max(apart, abs(_through(values, 0.5)[0] - told[j]) / (rtol * size))
        return apart if h > UNRESOLVED * shortest else 0.0

    def keep(self, t: float, end: float, x: Any, u: Any, p: Any) -> None:
        """Add the step that `follow` has written last to the known ones."""
        h = self.history
        count = int(h[COUNT])
        step = self._step(count)
        level = self._level_from_before(t)
        last = h[DURATIONS + self.count : self._steps]
        own = slice(self.first, self.first + 2 * self.count)
        held = [float(value) for value in u]
        held[own] = last[own].tolist()
        if h[DISTURBED] != 0.0 or held != last.tolist():
            level = min(level, 1.0)
        starts = self._delayed(t, x, u, p)[2 * self.count : 3 * self.count]
        for j, start in enumerate(starts):
            at = 2 + (PIECES + 1) * j
            before = h[step - self._size + at + PIECES] if count > 0 else start
            if before != h[step + at]:
                level = 0.0
        last[:] = u
        h[step], h[step + 1] = t, level
        h[DISTURBED], h[COUNT], h[END] = 0.0, count + 1, end


def _through(values: list[float], z: float) -> tuple[float, float]:
    """The polynomial through equidistant values, and its derivative by the index z."""
    c = list(values)
    for order in range(1, PIECES + 1):
        for k in range(PIECES, order - 1, -1):
            c[k] -= c[k - 1]
    value, rate = c[PIECES], 0.0
    for k in range(PIECES - 1, -1, -1):
        rate = (value + (z - k) * rate) / (k + 1)
        value = c[k] + (z - k) / (k + 1) * value
    return value, rate
