"""The compiled core: one library for all systems, which evaluates their equations from tapes.

This file imports nothing of the package: it is also part of every exported FMU, together with the
library.
"""

from __future__ import annotations

import ctypes as ct
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

# how an integration ends
DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, CHATTER, DIVERGED, STIFF, NO_MEMORY, NOT_FINITE = range(8)
NO_ROOM, NO_DELAY = 8, 9
# numbers that it returns, see ``Info`` in ``c/stepper.h``
NEXT_STEP, ACCEPTED, REJECTED, REACHED, EVENTS, STATUS, LAST_ERROR = range(7)
INFO_SIZE = 7
FUNCTIONS = "rhs jac out sample indicate kind react slopes delayed".split()
EITHER, CHANGES_MODE, RESETS = range(3)  # kinds of events
ROOM = 0  # place in a history of delayed signals: the steps that it has room for
FIRST_ROOM = 32
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
# libraries for other platforms have these in their names, see `library`
LIBRARY = f"libcore{SUFFIX}"
_DELAYS = 3  # place of their number in tapes


_At, _Number, _Whole = ct.c_void_p, ct.c_double, ct.c_int32


def _fields(*groups: tuple[Any, str]) -> tuple[tuple[str, Any], ...]:
    """Fields of a record: types, and the names of those that follow each other."""
    return tuple((name, kind) for kind, names in groups for name in names.split())


class _Instance(ct.Structure):
    _fields_ = _fields((_At, "solver x u y p atol info"))


class Walk(ct.Structure):
    """``Walk`` in ``c/tangents.h``."""

    _fields_ = _fields(
        (_Whole, "rows count"),
        (_At, "times states growth trace frame u p atol"),
        (_Number, "rtol"),
        (_At, "bound scale"),
        (_Whole, "max_steps collocating"),
        (_Number, "period"),
    )


class Crossings(ct.Structure):
    """``Crossings`` in ``c/tangents.h``."""

    _fields_ = _fields(
        (_Number, "t0 t1"),
        (_At, "x u p atol"),
        (_Number, "rtol"),
        (_At, "bound"),
        (_Whole, "max_steps coordinate"),
        (_Number, "level"),
        (_Whole, "most"),
        (_At, "times states low high"),
        (_Number, "period"),
    )


_SIZE = ct.c_int64
_WHERE = (_At, _Number, _At, _At, _At)
_SIGNATURES: dict[str, tuple[Any, ...]] = {  # what a function returns, and its arguments
    "size": (_SIZE, _At),
    "make": (None, _At, _At, _At),
    "history_size": (_SIZE, _At, _SIZE),
    "remember": (None, _At, _At),
    **dict.fromkeys(("rhs", "out", "sample", "indicate"), (None, *_WHERE, _At)),
    "jac": (None, *_WHERE, _At, _At),
    "settle": (_Whole, *_WHERE, _At),
    "integrate": (_Whole, _At, _Number, _Number, *[_At] * 4, _Number, _At, _Whole),
    "step": (_Whole, _At, _Number, _Number, _Number, _Whole),
    "output": (None, _At, _Number),
    "trajectory": (
        *(_Whole, _At, _Whole, _Number, _At, _Whole, _At, _At, _Whole, _At, _At, _Whole),
        *(_At, _Whole, _Whole, _At, _At, _At, _Number, _At, _Whole),
    ),
    "spectrum": (_Whole, _At, _At, _Whole, _At),
    "returns": (_Whole, _At, _At, _Whole, _At),
}


@cache
def library() -> Any:
    """The core's functions, loaded once from the first file next to this one that can be loaded.

    An FMU may run on other platforms, and contains the core for several.

    Raises
    ------
    OSError
        If no file can be loaded on this platform.
    """
    loaded = _first_loaded(Path(__file__).parent / "c")
    for name, (result, *types) in _SIGNATURES.items():
        function = getattr(loaded, f"core_{name}")
        function.restype, function.argtypes = result, types
    return loaded


def _first_loaded(folder: Path) -> Any:
    fault = OSError(f"{folder} holds no libcore*{SUFFIX}")
    for path in sorted(folder.glob(f"libcore*{SUFFIX}"), key=lambda p: p.name != LIBRARY):
        try:
            return ct.CDLL(str(path))
        except OSError as error:  # for another processor
            fault = error
    raise fault


@cache
def _compiled(path: str) -> Any:
    return ct.CDLL(path)


def at(array: Any) -> int:
    """Address of a contiguous array of floats; an address is returned unchanged."""
    if type(array) is int:
        return array
    if array.dtype == np.float64:
        try:
            return ct.addressof(_Number.from_buffer(array))  # four times faster than what follows
        except (TypeError, ValueError):  # read-only, empty, or with gaps
            if array.flags.c_contiguous:
                return int(array.ctypes.data)
    raise TypeError(f"the core takes floats without gaps, not {array.dtype}, {array.strides}")


class System:
    """The equations of a component and the stiff stepper, with its scratch memory.

    Vectors x, u and p are the states, the held values (inputs, discrete states, the mode) and the
    parameters, shapes (states,), (held,) and (parameters,). Arrays that are not moved in memory can
    be given by their address, see `at`.

    Parameters
    ----------
    tapes : bytes
        See `tape.record_tape`.
    equations : str, optional
        File of the same equations compiled, see ``translation.py``.

    Raises
    ------
    OSError
        If this platform cannot load the core.
    """

    def __init__(self, tapes: bytes, equations: str = "") -> None:
        self._core = library()
        # numbers are aligned to eight bytes
        self._tapes = np.frombuffer(tapes + bytes(-len(tapes) % 8)).copy()
        tapes_at = at(self._tapes)
        self._memory = np.zeros(int(self._core.core_size(tapes_at)) // 8)
        self.address = at(self._memory)
        fill = ct.cast(_compiled(equations).fill_system, _At) if equations else None
        self._core.core_make(self.address, tapes_at, fill)
        self.delays = int(self._tapes.view(np.int32)[_DELAYS])
        self.history: Any = np.zeros(0)
        self.forget()

    def forget(self) -> None:
        """Clear the history: delayed signals have their start values."""
        self.remember(self._history(FIRST_ROOM))

    def remember(self, history: Any) -> None:
        """Set the history of delayed signals from a copy of `history`."""
        if self.delays:
            self.history = history.copy()
            self._core.core_remember(self.address, at(self.history))

    def make_room(self) -> None:
        """Double the room of the history."""
        more = self._history(2 * int(self.history[ROOM]))
        more[ROOM + 1 : len(self.history)] = self.history[ROOM + 1 :]
        self.remember(more)

    def _history(self, room: int) -> Any:
        """An empty history with room for so many steps."""
        history = np.zeros(int(self._core.core_history_size(self.address, room)))
        history[ROOM] = room
        return history

    def rhs(self, t: float, x: Any, u: Any, p: Any, dx: Any) -> None:
        """Write the derivatives, shape (states,)."""
        self._core.core_rhs(self.address, t, at(x), at(u), at(p), at(dx))

    def jac(self, t: float, x: Any, u: Any, p: Any, jacobian: Any, by_time: Any) -> None:
        """Write the derivatives' slopes by the states, (states, states), and by time."""
        self._core.core_jac(self.address, t, at(x), at(u), at(p), at(jacobian), at(by_time))

    def out(self, t: float, x: Any, u: Any, p: Any, y: Any) -> None:
        """Write the outputs."""
        self._core.core_out(self.address, t, at(x), at(u), at(p), at(y))

    def sample(self, t: float, x: Any, u: Any, p: Any, d: Any) -> None:
        """Write the next discrete states."""
        self._core.core_sample(self.address, t, at(x), at(u), at(p), at(d))

    def indicate(self, t: float, x: Any, u: Any, p: Any, g: Any) -> None:
        """Write the indicators of the present mode, shape (events,)."""
        self._core.core_indicate(self.address, t, at(x), at(u), at(p), at(g))

    def settle(self, t: float, x: Any, u: Any, p: Any, info: Any) -> int:
        """Handle every event that is due now; return `DONE` or `CHATTER`."""
        return int(self._core.core_settle(self.address, t, at(x), at(u), at(p), at(info)))

    def advance(  # noqa: PLR0913
        self,
        t0: float,
        t1: float,
        x: Any,
        u: Any,
        p: Any,
        atol: Any,
        rtol: float,
        info: Any,
        max_steps: int,
    ) -> int:
        """Move the state from `t0` to `t1` in place; events change the mode in `u`.

        ``info[NEXT_STEP]`` is the step to try first (0: choose one) and on return the step that
        the error control would take next; ``info[REACHED]`` is the time that was reached; accepted
        and rejected steps and events are added up. At most `max_steps` steps are taken; the memory
        of the error control is then kept, so that many calls of one step each give the same result
        as one call. Returns `DONE` or why it ended.
        """
        while True:
            status = int(
                self._core.core_integrate(
                    *(self.address, t0, t1, *map(at, (x, u, p, atol)), rtol, at(info), max_steps)
                )
            )
            if status != NO_ROOM:
                return status
            self.make_room()
            t0 = float(info[REACHED])

    def instance(self, x: Any, u: Any, p: Any, y: Any, atol: Any, info: Any) -> Instance:
        """The system with fixed memory; see `advance` and `out`."""
        return Instance(self, _Instance(self.address, *map(at, (x, u, y, p, atol, info))), info)

    def trajectory(  # noqa: PLR0913
        self,
        times: Any,
        states: Any,
        outputs: Any,
        given: tuple[Any, Any] | None,
        samples: tuple[Any, int, int],
        u: Any,
        p: Any,
        atol: Any,
        rtol: float,
        info: Any,
        max_steps: int,
    ) -> int:
        """Write states and outputs over a grid of times; return the number of rows reached.

        The first state is given. `given` are values of the first of `u` before each time, and at
        it; `samples` are the flags of times at which discrete states are updated, where in `u`
        they begin, and how many there are.
        """
        within, after = given or (None, None)
        sampled, first, count = samples
        row, t = 0, times[0]
        while True:
            row = int(
                self._core.core_trajectory(
                    *(self.address, row, t, at(times), len(times)),
                    *(at(states), at(outputs), outputs.shape[1]),
                    None if within is None else at(within),
                    None if after is None else at(after),
                    0 if within is None else within.shape[1],
                    None if sampled is None else sampled.ctypes.data,
                    *(first, count, *map(at, (u, p, atol)), rtol, at(info), max_steps),
                )
            )
            if row == len(times) or info[STATUS] != NO_ROOM:
                return row
            self.make_room()
            t = info[REACHED]

    def spectrum(self, walk: Walk, explicitly: bool, info: Any) -> int:
        """Follow state and tangents; return the number of rows reached."""
        return int(self._core.core_spectrum(self.address, ct.addressof(walk), explicitly, at(info)))

    def returns(self, crossings: Crossings, explicitly: bool, info: Any) -> int:
        """Follow a motion to where it crosses a plane; return the number of crossings."""
        return int(
            self._core.core_returns(self.address, ct.addressof(crossings), explicitly, at(info))
        )


class Instance:
    """A system with its memory, for the steps of an FMU; twice as fast as with arrays."""

    def __init__(self, system: System, given: _Instance, info: Any) -> None:
        self._system, self._given, self._info = system, given, info
        self.address = ct.addressof(given)
        self._step, self._output = system._core.core_step, system._core.core_output

    def advance(self, t0: float, t1: float, rtol: float, max_steps: int) -> int:
        """As `System.advance`; `NOT_FINITE` if it ends with a state that is not finite."""
        status = int(self._step(self.address, t0, t1, rtol, max_steps))
        while status == NO_ROOM:
            self._system.make_room()
            status = int(self._step(self.address, float(self._info[REACHED]), t1, rtol, max_steps))
        return status

    def out(self, t: float) -> None:
        """Write the outputs."""
        self._output(self.address, t)
