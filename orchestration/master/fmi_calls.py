"""Calls of an FMU instance by compiled code.

An FMU of FMI 2.0 in this process whose signals are real is called through the addresses of its
own functions, and a group of such FMUs through those of ``c/group.c``. Any other FMU instance gets
functions with the same signatures that call its Python methods, so that one code of the coupling is
enough for all of them.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ..fmu.fmi_versions import OK, STATE, STEP
from ..fmu.fmu_instance import ENTRY_POINTS, FmuInstance, Instance
from ..fmu.group import Group
from .structs import VECTOR, Struct, Vector, struct

PUT, TAKE, MOVE, SAVE, RESTORE = range(5)  # kinds of failed calls
_FAILED_IN_PYTHON = 3  # fmi2Error
_ADDRESSES = ctypes.CFUNCTYPE(  # signature of fmi2SetReal, with pointers as plain addresses
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p
)


class CallFailed(Exception):
    """An FMU instance rejected a call; its record has the call and the reason."""


CALLS = np.dtype(
    [
        # addresses of the instance and of its functions
        *((name, np.intp) for name in ENTRY_POINTS),
        # value references and values of inputs and outputs
        ("inputs", VECTOR),
        ("given", VECTOR),
        ("outputs", VECTOR),
        ("taken", VECTOR),
        ("stop", float),  # no step may end after it [s]
        # addresses of saved states, one for each use; zero if none is saved
        ("states", VECTOR),
        # FMI status and kind of the call that failed
        ("status", np.int64),
        ("failed", np.int64),
    ]
)
"""An FMU instance, see ``c/calls.h``: its functions, their inputs and their outputs."""

MEMBER = np.dtype([("calls", CALLS), ("sources", VECTOR), ("first", np.int64)])
GROUP = np.dtype(
    [
        *((name, VECTOR) for name in ("members", "there", "back", "values", "flags")),
        ("lags", np.int64),
    ]
)
"""A group of FMUs and a member of it, see ``c/group.c``."""


class Bound:
    """An FMU instance with the inputs that will be set and the outputs that will be read.

    Parameters
    ----------
    instance : Instance
        Initialized.
    inputs, outputs : sequence of str
        A call sets or reads any number of the first of them.
    uses : int
        Number of states that are saved at the same time.
    calls : Struct
        The struct to fill, of the kind `CALLS`.
    """

    def __init__(
        self,
        instance: Instance,
        inputs: Sequence[str],
        outputs: Sequence[str],
        uses: int,
        calls: Struct,
    ) -> None:
        self._inputs, self._outputs = list(inputs), list(outputs)
        self._calls = calls
        references = [0] * len(inputs), [0] * len(outputs)
        given, taken = np.zeros(len(inputs)), np.zeros(len(outputs))
        self._fmu: FmuInstance | None = None
        self._others: _PythonCalls | _GroupCalls | None = None
        if isinstance(instance, FmuInstance) and instance.is_compiled([*inputs, *outputs]):
            self._fmu = instance
            entry_points = instance.entry_points()
            references = instance.references(inputs), instance.references(outputs)
        elif isinstance(instance, Group) and instance.is_compiled():
            self._others = _GroupCalls(instance)
            entry_points = self._others.entry_points()
            at = instance.place
            references = [at[n] for n in inputs], [at[n] for n in outputs]
        else:
            self._others = _PythonCalls(instance, self._inputs, self._outputs, given, taken)
            entry_points = self._others.entry_points()
        calls.set(
            **dict(zip(ENTRY_POINTS, entry_points, strict=True)),
            inputs=np.array(references[0], dtype=np.uint32),
            given=given,
            outputs=np.array(references[1], dtype=np.uint32),
            taken=taken,
            stop=getattr(instance, "stop", math.inf),
            states=np.zeros(uses, dtype=np.int64),
        )

    def failure(self) -> BaseException | None:
        """The error of the last failed call, as raised by the FMU instance."""
        status, what = int(self._calls.record.status), int(self._calls.record.failed)
        if status <= OK:
            return None
        if self._fmu is None:
            return self._others.error if self._others else None
        if what == MOVE:
            return self._fmu.step_failed(status)
        said = {
            PUT: f"rejects the values of {', '.join(self._inputs)}",
            TAKE: f"cannot give {', '.join(self._outputs)}",
            SAVE: "cannot save its state",
            RESTORE: "cannot restore its state",
        }
        return self._fmu.failed(status, said[what])


def failure_of(*bound: Bound) -> BaseException | None:
    """The error of the instance whose call failed; None if no call failed."""
    return next((error for error in (b.failure() for b in bound) if error is not None), None)


@contextlib.contextmanager
def raise_failures(*bound: Bound) -> Iterator[None]:
    """Raise a failed call as the error that the FMU instance itself would raise."""
    try:
        yield
    except CallFailed as failed:
        raise (failure_of(*bound) or failed) from None


class _GroupCalls:
    """The functions of a group of FMUs that compiled code calls directly."""

    def __init__(self, group: Group) -> None:
        from .compiled import library  # its records contain those of this module

        self._library = library()
        self._struct = struct(GROUP)
        self._bound: list[Bound] = []
        addresses: dict[int, int] = {}
        for part in group.parts:
            whole = struct(MEMBER)
            ports = [f.port for f in part.feeds]
            calls = whole.part("calls")
            self._bound.append(Bound(part.instance, ports, part.instance.outputs, 0, calls))
            whole.set(sources=part.sources.astype(np.int64), first=part.outputs.start)
            addresses[id(part)] = whole.address
        self._struct.set(
            members=np.array([addresses[id(p)] for p in group.parts], dtype=np.int64),
            there=np.array([addresses[id(p)] for p in group.there], dtype=np.int64),
            back=np.array([addresses[id(p)] for p in group.back], dtype=np.int64),
            values=group.values,
            flags=group.flags,
            lags=group.lags,
        )

    @property
    def error(self) -> BaseException | None:
        return failure_of(*self._bound)

    def entry_points(self) -> tuple[int, ...]:
        """Addresses of the group and of its functions."""
        functions = (getattr(self._library, f"group_{name}") for name in ENTRY_POINTS[1:])
        addresses = (ctypes.cast(f, ctypes.c_void_p).value or 0 for f in functions)
        return (self._struct.address, *addresses)


class _PythonCalls:
    """Functions with the signatures of FMI that call an FMU instance's methods.

    `given` and `taken` are the arrays whose addresses the functions are called with.
    """

    def __init__(
        self,
        instance: Instance,
        inputs: Sequence[str],
        outputs: Sequence[str],
        given: Vector,
        taken: Vector,
    ) -> None:
        self._given, self._taken = given, taken
        self.error: BaseException | None = None
        self._instance = instance
        self._states: dict[int, Any] = {}
        self._count = 0

        def guarded(method: Callable[..., None]) -> Callable[..., int]:
            def call(*arguments: Any) -> int:
                try:
                    method(*arguments)
                except BaseException as error:  # also interruptions: raised after the compiled code
                    self.error = error
                    return _FAILED_IN_PYTHON
                return 0

            return call

        self._functions = [
            _ADDRESSES(guarded(self._set)),
            _ADDRESSES(guarded(self._get)),
            STEP(guarded(lambda _, t, h, __: instance.step(t, h))),
            STATE(guarded(self._save)),
            STATE(guarded(lambda _, state: instance.restore(self._states[state]))),
            STATE(guarded(self._release)),
        ]
        # one for each requested number of signals
        self._writer = functools.cache(lambda count: instance.writer(inputs[:count]))
        self._reader = functools.cache(lambda count: instance.reader(outputs[:count]))

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
        self._states[self._count] = self._instance.save()
        ctypes.c_void_p.from_address(slot).value = self._count

    def _release(self, _: Any, slot: int) -> None:
        number = ctypes.c_void_p.from_address(slot).value
        self._instance.release(self._states.pop(number or 0))
