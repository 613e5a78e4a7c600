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
FUNCTIONS = "rhs jac out sample indicate spread kind react slopes delayed".split()
EITHER, CHANGES_MODE, RESETS = range(3)  # kinds of events
# a history of delayed signals, see ``c/delays.c``
ROOM, COUNT, END, DISTURBED, DURATIONS = range(5)
PIECES = 5
FIRST_ROOM = 32  # steps
STAGES = 8  # of the stiff stepper
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
# libraries for other platforms have these in their names, see `library`
LIBRARY = f"libcore{SUFFIX}"
_OPERATION_SIZE = 10  # bytes
_HEAD = 6 + 2 * len(FUNCTIONS)  # numbers

_At = ct.c_void_p


class _Tape(ct.Structure):
    _fields_ = (("operations", _At), ("constants", _At), ("constant_count", ct.c_int32))


class _Equations(ct.Structure):
    _fields_ = tuple((name, _Tape) for name in FUNCTIONS)


class _System(ct.Structure):
    _fields_ = (
        ("states", ct.c_int32),
        ("held", ct.c_int32),
        ("events", ct.c_int32),
        ("equations", _At),
        *((name, _At) for name in FUNCTIONS),
        ("delays", _At),
    )


class _Delays(ct.Structure):
    _fields_ = (
        ("count", ct.c_int32),
        ("first", ct.c_int32),
        ("plain", _System),
        *((name, _At) for name in ("history", "told", "node")),
    )


class _Work(ct.Structure):
    _fields_ = (
        *(
            (name, _At)
            for name in (
                "jacobian w k stage slope by_time alone end first middle g before left inverse "
                "lower upper lower_end rows counts below pivots fired"
            ).split()
        ),
        ("found", ct.c_int32),
        ("known", ct.c_int32),
        ("note", _At),
    )


class _Instance(ct.Structure):
    _fields_ = tuple((name, _At) for name in ("system", "work", "x", "u", "y", "p", "atol", "info"))


class Walk(ct.Structure):
    """``Walk`` in ``c/tangents.h``."""

    _fields_ = (
        ("rows", ct.c_int32),
        ("count", ct.c_int32),
        *((name, _At) for name in ("times", "states", "growth", "trace", "frame", "u", "p")),
        ("atol", _At),
        ("rtol", ct.c_double),
        ("bound", _At),
        ("scale", _At),
        ("max_steps", ct.c_int32),
        ("collocating", ct.c_int32),
        ("period", ct.c_double),
    )


class Crossings(ct.Structure):
    """``Crossings`` in ``c/tangents.h``."""

    _fields_ = (
        ("t0", ct.c_double),
        ("t1", ct.c_double),
        *((name, _At) for name in ("x", "u", "p", "atol")),
        ("rtol", ct.c_double),
        ("bound", _At),
        ("max_steps", ct.c_int32),
        ("coordinate", ct.c_int32),
        ("level", ct.c_double),
        ("most", ct.c_int32),
        *((name, _At) for name in ("times", "states", "low", "high")),
        ("period", ct.c_double),
    )


_EVALUATED = ct.CFUNCTYPE(None, _At, ct.c_double, _At, _At, _At, _At)
_LINEARIZED = ct.CFUNCTYPE(None, _At, ct.c_double, _At, _At, _At, _At, _At)
_NUMBER, _WHOLE = ct.c_double, ct.c_int
_SIGNATURES: dict[str, tuple[Any, ...]] = {
    "play_tapes": (_At, _At),
    "lay_work": (_At, _WHOLE, _WHOLE, _At),
    "lay_delays": (_At, _At, _WHOLE, _WHOLE, _At),
    "settle": (_At, _NUMBER, *[_At] * 5),
    "integrate": (_At, _NUMBER, _NUMBER, *[_At] * 4, _NUMBER, _At, _At, _WHOLE),
    "step": (_At, _NUMBER, _NUMBER, _NUMBER, _WHOLE),
    "output": (_At, _NUMBER),
    "trajectory": (
        *[_At, _At, _WHOLE] * 3,
        _At,
        *[_WHOLE] * 2,
        *[_At] * 3,
        _NUMBER,
        *[_At] * 2,
        _WHOLE,
    ),
    "spectrum": (_At, _At, _WHOLE, _At),
    "returns": (_At, _At, _WHOLE, _At),
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
    for name, types in _SIGNATURES.items():
        function = getattr(loaded, f"core_{name}")
        function.argtypes = types
        silent = ("play_tapes", "lay_work", "lay_delays", "output")
        function.restype = None if name in silent else _WHOLE
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
    loaded = ct.CDLL(path)
    loaded.fill_system.argtypes, loaded.fill_system.restype = (_At,), None
    return loaded


def at(array: Any) -> int:
    """Address of a contiguous array of floats; an address is returned unchanged."""
    if type(array) is int:
        return array
    if array.dtype == np.float64:
        try:
            return ct.addressof(_NUMBER.from_buffer(array))  # four times faster than what follows
        except (TypeError, ValueError):  # read-only, empty, or with gaps
            if array.flags.c_contiguous:
                return int(array.ctypes.data)
    raise TypeError(f"the core takes floats without gaps, not {array.dtype}, {array.strides}")


def new_history(delays: int, held: int) -> Any:
    """An empty history, with room for some steps."""
    history = np.zeros(DURATIONS + delays + held + FIRST_ROOM * step_size(delays))
    history[ROOM] = FIRST_ROOM
    return history


def roomier(history: Any, delays: int, held: int) -> Any:
    """The same history with twice as much room."""
    more = np.zeros(len(history) + int(history[ROOM]) * step_size(delays))
    more[: len(history)] = history
    more[ROOM] = 2 * history[ROOM]
    return more


def step_size(delays: int) -> int:
    """Numbers that a step stores in a history."""
    return 2 + (PIECES + 1) * delays


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
        data = np.frombuffer(tapes + bytes(-len(tapes) % 8)).copy()
        start = data.ctypes.data
        head = data.view(np.int32)[:_HEAD].tolist()
        self.states, self.held, self.events, self.delays, first = head[:5]
        sizes = list(zip(head[5:-1:2], head[6::2], strict=True))
        constants = start + 4 * _HEAD
        operations = constants + 8 * sum(count for _, count in sizes)
        parts = []
        for length, count in sizes:
            parts.append(_Tape(operations, constants, count))
            operations, constants = operations + _OPERATION_SIZE * length, constants + 8 * count
        self._equations = _Equations(*parts)
        self._system = _System(self.states, self.held, self.events)
        self.address = ct.addressof(self._system)
        self._core.core_play_tapes(self.address, ct.addressof(self._equations))
        if equations:
            _compiled(equations).fill_system(self.address)
        n = self.states
        self._delays = _Delays()
        signals = np.zeros(4 * self.delays + n)
        self.history: Any = np.zeros(0)
        if self.delays:
            self._core.core_lay_delays(
                self.address, ct.addressof(self._delays), self.delays, first, at(signals)
            )
            self.forget()
        memory = np.zeros(4 * n * n + (STAGES + 11) * n + 3 * self.events + 2)
        self._work = _Work()
        self._work_address = ct.addressof(self._work)
        self._core.core_lay_work(self._work_address, n, self.events, at(memory))
        self._read_by_the_core = (data, memory, signals)
        self._rhs, self._out, self._sample, self._indicate = (
            _EVALUATED(getattr(self._system, name)) for name in ("rhs", "out", "sample", "indicate")
        )
        self._jac = _LINEARIZED(self._system.jac)

    def forget(self) -> None:
        """Clear the history: delayed signals have their start values."""
        if self.delays:
            self.remember(new_history(self.delays, self.held))

    def remember(self, history: Any) -> None:
        """Set the history of delayed signals from a copy of `history`."""
        if self.delays:
            self.history = history.copy()
            self._delays.history = at(self.history)

    def make_room(self) -> None:
        """Double the room of the history."""
        self.remember(roomier(self.history, self.delays, self.held))

    def rhs(self, t: float, x: Any, u: Any, p: Any, dx: Any) -> None:
        """Write the derivatives, shape (states,)."""
        self._rhs(self.address, t, at(x), at(u), at(p), at(dx))

    def jac(self, t: float, x: Any, u: Any, p: Any, jacobian: Any, by_time: Any) -> None:
        """Write the derivatives' slopes by the states, (states, states), and by time."""
        self._jac(self.address, t, at(x), at(u), at(p), at(jacobian), at(by_time))

    def out(self, t: float, x: Any, u: Any, p: Any, y: Any) -> None:
        """Write the outputs."""
        self._out(self.address, t, at(x), at(u), at(p), at(y))

    def sample(self, t: float, x: Any, u: Any, p: Any, d: Any) -> None:
        """Write the next discrete states."""
        self._sample(self.address, t, at(x), at(u), at(p), at(d))

    def indicate(self, t: float, x: Any, u: Any, p: Any, g: Any) -> None:
        """Write the indicators of the present mode, shape (events,)."""
        self._indicate(self.address, t, at(x), at(u), at(p), at(g))

    def settle(self, t: float, x: Any, u: Any, p: Any, info: Any) -> int:
        """Handle every event that is due now; return `DONE` or `CHATTER`."""
        return int(
            self._core.core_settle(
                self.address, t, at(x), at(u), at(p), self._work_address, at(info)
            )
        )

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
        """Move the state from `t0` to `t1` with `u` and `p` held, in place.

        Parameters
        ----------
        x : ndarray, shape (states,)
            State at `t0`; on return the state at the time ``info[REACHED]``.
        u : ndarray, shape (held,)
            Events change the mode in it.
        atol : ndarray, shape (states,)
            Absolute tolerance of each state, in its own unit.
        rtol : float
            Relative tolerance.
        info : ndarray, shape (INFO_SIZE,)
            ``info[NEXT_STEP]`` is the step to try first (0: choose one) and on return the step that
            the error control would take next; accepted and rejected steps and events are added up.
            The memory of the error control is kept if a call ends at `max_steps`, so that many
            calls of one step each give the same result as one call.
        max_steps : int
            Most steps, accepted or rejected, that this call may take.

        Returns
        -------
        int
            `DONE`, `TOO_MANY_STEPS`, `STEP_TOO_SMALL`, `CHATTER` or `NO_DELAY`.
        """
        while True:
            status = int(
                self._core.core_integrate(
                    *(self.address, t0, t1, *map(at, (x, u, p, atol)), rtol),
                    *(self._work_address, at(info), max_steps),
                )
            )
            if status != NO_ROOM:
                return status
            self.make_room()
            t0 = float(info[REACHED])

    def instance(self, x: Any, u: Any, p: Any, y: Any, atol: Any, info: Any) -> Instance:
        """The system with fixed memory; see `advance` and `out`."""
        return Instance(
            self,
            _Instance(self.address, self._work_address, *map(at, (x, u, y, p, atol, info))),
            info,
        )

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

        Parameters
        ----------
        times : ndarray, shape (m,)
        states, outputs : ndarray, shape (m, ...)
            The first state is given.
        given : tuple of two ndarrays, shape (m, k), or None
            Values of the first `k` of `u` before each time, and at it.
        samples : tuple of (ndarray of bool, shape (m,), without gaps, or None), int, int
            At which times the discrete states are updated, where in `u` they begin, and how many
            there are.
        """
        within, after = given or (None, None)
        sampled, first, count = samples
        return int(
            self._core.core_trajectory(
                *(self.address, at(times), len(times)),
                *(at(states), at(outputs), outputs.shape[1]),
                None if within is None else at(within),
                None if after is None else at(after),
                0 if within is None else within.shape[1],
                None if sampled is None else sampled.ctypes.data,
                *(first, count, *map(at, (u, p, atol)), rtol),
                *(self._work_address, at(info), max_steps),
            )
        )

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
