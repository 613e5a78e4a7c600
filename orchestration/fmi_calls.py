"""How compiled code calls a participant.

An FMU in this process is called through the addresses of its own FMI 2.0 functions. Any other
participant gets functions of the same shapes that call its Python methods, so that there is one
text of the coupling for all of them.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from .participant import ENTRY_POINTS, OK, STATE, STEP, FmuParticipant, Participant
from .structs import VECTOR, Struct, Vector, compiled, places

PUT, TAKE, MOVE, SAVE, RESTORE = range(5)  # what failed
_FAILED_IN_PYTHON = 3  # fmi2Error
_ADDRESSES = ctypes.CFUNCTYPE(  # of the shape of fmi2SetReal, with nothing made of its pointers
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p
)


class CallFailed(Exception):
    """A participant refused a call; which and why is kept in its record."""


CALLS = np.dtype(
    [
        # addresses of the instance and of its functions
        *((name, np.intp) for name in ENTRY_POINTS),
        # value references and values of what is set and of what is read
        ("inputs", VECTOR),
        ("given", VECTOR),
        ("outputs", VECTOR),
        ("taken", VECTOR),
        # addresses of saved states, one for each use; zero where nothing is saved
        ("states", VECTOR),
        # FMI status and kind of the call that failed
        ("status", np.int64),
        ("failed", np.int64),
    ]
)
"""A participant: its functions, what they are called with, and what they gave."""


def _call(builder: Any, kinds: Sequence[Any], values: Sequence[Any]) -> Any:
    """The instruction that calls the function at the address `values[0]` with the others."""
    kind = ir.FunctionType(ir.IntType(32), kinds)
    return builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])


_WORD, _DOUBLE, _INT = ir.IntType(64), ir.DoubleType(), ir.IntType(32)


@intrinsic  # type: ignore[untyped-decorator]
def _signals(_: Any, address: Any, component: Any, names: Any, count: Any, values: Any) -> Any:
    def generated(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        return _call(builder, [_WORD] * 4, arguments)

    return types.int32(*[types.intp] * 5), generated


@intrinsic  # type: ignore[untyped-decorator]
def _step(_: Any, address: Any, component: Any, t: Any, h: Any) -> Any:
    def generated(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        goes_on = ir.Constant(_INT, 1)  # no state before this step will be wanted again
        return _call(builder, [_WORD, _DOUBLE, _DOUBLE, _INT], [*arguments, goes_on])

    return types.int32(types.intp, types.intp, types.float64, types.float64), generated


@intrinsic  # type: ignore[untyped-decorator]
def _state(_: Any, address: Any, component: Any, state: Any) -> Any:
    def generated(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        return _call(builder, [_WORD] * 2, arguments)

    return types.int32(types.intp, types.intp, types.intp), generated


@compiled
def _check(calls: Any, status: int, what: int) -> None:
    if status > OK:
        calls.status = status
        calls.failed = what
        raise CallFailed


@compiled
def put(calls: Any, count: int) -> None:
    """Set the first `count` inputs to what is in `given`."""
    if count > 0:
        names, values = calls.inputs.address, calls.given.address
        _check(calls, _signals(calls.set_real, calls.component, names, count, values), PUT)


@compiled
def take(calls: Any, count: int) -> None:
    """Read the first `count` outputs into `taken`."""
    if count > 0:
        names, values = calls.outputs.address, calls.taken.address
        _check(calls, _signals(calls.get_real, calls.component, names, count, values), TAKE)


@compiled
def move(calls: Any, t: float, h: float) -> None:
    """Do a communication step from t to t + h."""
    _check(calls, _step(calls.do_step, calls.component, t, h), MOVE)


@compiled
def save(calls: Any, use: int) -> None:
    """Keep the present state for this use."""
    slot = calls.states.address + 8 * use
    _check(calls, _state(calls.get_state, calls.component, slot), SAVE)


@compiled
def restore(calls: Any, use: int) -> None:
    """Go back to the state kept for this use."""
    state = places(calls.states)[use]
    _check(calls, _state(calls.set_state, calls.component, state), RESTORE)


@compiled
def release(calls: Any, use: int) -> None:
    """Forget the state kept for this use, if there is one."""
    states = places(calls.states)
    if states[use] != 0:
        _state(calls.free_state, calls.component, calls.states.address + 8 * use)
        states[use] = 0


class Bound:
    """A participant with the inputs that will be set and the outputs that will be read.

    Parameters
    ----------
    participant : Participant
        Initialized.
    inputs, outputs : sequence of str
        As many of the first of them as wanted are set or read in one call.
    uses : int
        How many states are saved at once.
    calls : Struct
        Where to put it: of the kind `CALLS`.
    """

    def __init__(
        self,
        participant: Participant,
        inputs: Sequence[str],
        outputs: Sequence[str],
        uses: int,
        calls: Struct,
    ) -> None:
        self._inputs, self._outputs = list(inputs), list(outputs)
        self._calls = calls
        references = [0] * len(inputs), [0] * len(outputs)
        given, taken = np.zeros(len(inputs)), np.zeros(len(outputs))
        if isinstance(participant, FmuParticipant):
            self._fmu: FmuParticipant | None = participant
            entry_points = participant.entry_points()
            references = participant.references(inputs), participant.references(outputs)
        else:
            self._fmu = None
            self._python = _PythonCalls(participant, self._inputs, self._outputs, given, taken)
            entry_points = self._python.entry_points()
        calls.set(
            **dict(zip(ENTRY_POINTS, entry_points, strict=True)),
            inputs=np.array(references[0], dtype=np.uint32),
            given=given,
            outputs=np.array(references[1], dtype=np.uint32),
            taken=taken,
            states=np.zeros(uses, dtype=np.int64),
        )

    def failure(self) -> BaseException | None:
        """The error of the last call that failed, as the participant itself raises it."""
        status, what = int(self._calls.record.status), int(self._calls.record.failed)
        if status <= OK:
            return None
        if self._fmu is None:
            return self._python.error
        said = {
            PUT: f"refuses the values of {', '.join(self._inputs)}",
            TAKE: f"cannot give {', '.join(self._outputs)}",
            MOVE: f"the step failed with FMI status {status}",
            SAVE: "cannot save its state",
            RESTORE: "cannot restore its state",
        }
        return self._fmu.failed(status, said[what])


def failure_of(*bound: Bound) -> BaseException | None:
    """The error of the one whose call failed."""
    return next((error for error in (b.failure() for b in bound) if error is not None), None)


@contextlib.contextmanager
def raising(*bound: Bound) -> Iterator[None]:
    """Raise a failed call as the error that the participant itself would raise."""
    try:
        yield
    except CallFailed as failed:
        raise (failure_of(*bound) or failed) from None


class _PythonCalls:
    """Functions of FMI's shapes that call a participant's methods.

    `given` and `taken` are the arrays whose addresses the functions are called with.
    """

    def __init__(
        self,
        participant: Participant,
        inputs: Sequence[str],
        outputs: Sequence[str],
        given: Vector,
        taken: Vector,
    ) -> None:
        self._given, self._taken = given, taken
        self.error: BaseException | None = None
        self._participant = participant
        self._states: dict[int, Any] = {}
        self._count = 0

        def guarded(method: Callable[..., None]) -> Callable[..., int]:
            def call(*arguments: Any) -> int:
                try:
                    method(*arguments)
                except BaseException as error:  # an interruption too: raised where we are back
                    self.error = error
                    return _FAILED_IN_PYTHON
                return 0

            return call

        self._functions = [
            _ADDRESSES(guarded(self._set)),
            _ADDRESSES(guarded(self._get)),
            STEP(guarded(lambda _, t, h, __: participant.step(t, h))),
            STATE(guarded(self._save)),
            STATE(guarded(lambda _, state: participant.restore(self._states[state]))),
            STATE(guarded(self._release)),
        ]
        # one for each number of signals that is asked for
        self._writer = functools.cache(lambda count: participant.writer(inputs[:count]))
        self._reader = functools.cache(lambda count: participant.reader(outputs[:count]))

    def entry_points(self) -> tuple[int, ...]:
        """No component, and the functions' addresses."""
        addresses = (ctypes.cast(f, ctypes.c_void_p).value or 0 for f in self._functions)
        return (0, *addresses)

    def _set(self, _: Any, __: Any, count: int, ___: Any) -> None:
        self._writer(count)(self._given[:count].copy())

    def _get(self, _: Any, __: Any, count: int, ___: Any) -> None:
        self._taken[:count] = self._reader(count)()

    def _save(self, _: Any, slot: int) -> None:
        self._count += 1
        self._states[self._count] = self._participant.save()
        ctypes.c_void_p.from_address(slot).value = self._count

    def _release(self, _: Any, slot: int) -> None:
        number = ctypes.c_void_p.from_address(slot).value
        self._participant.release(self._states.pop(number or 0))
