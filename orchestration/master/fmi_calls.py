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
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..fmu.fmi_versions import OK, STATE, STEP
from ..fmu.fmu_instance import ENTRY_POINTS, FmuInstance, Instance
from ..fmu.group import Group
from .compiled import CallFailed, Guarded, Struct, Vector, address_of, library, struct

PUT, TAKE, MOVE, SAVE, RESTORE = range(5)  # kinds of failed calls
VALUES = ctypes.CFUNCTYPE(  # signature of fmi2SetReal, with pointers as plain addresses
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p
)


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
        The record `Calls` to fill.
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
        self._struct = struct("Group")
        self._bound: list[Bound] = []
        addresses: dict[int, int] = {}
        for part in group.parts:
            whole = struct("Member")
            ports = [f.port for f in part.feeds]
            calls = whole.part("calls")
            self._bound.append(Bound(part.instance, ports, part.instance.outputs, 0, calls))
            whole.set(sources=part.sources.astype(np.int64), first=part.outputs.start)
            addresses[id(part)] = whole.address
        orders = {"members": group.parts, "there": group.there, "back": group.back}
        self._struct.set(
            **{n: np.array([addresses[id(p)] for p in ps], np.int64) for n, ps in orders.items()},
            values=group.values,
            flags=group.flags,
            lags=group.lags,
        )

    @property
    def error(self) -> BaseException | None:
        return failure_of(*self._bound)

    def entry_points(self) -> tuple[int, ...]:
        """Addresses of the group and of its functions."""
        functions = (getattr(library(), f"group_{name}") for name in ENTRY_POINTS[1:])
        return (self._struct.address, *map(address_of, functions))


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
        self._guarded = Guarded(0, 3)  # fmi2OK, fmi2Error
        self._instance = instance
        self._states: dict[int, Any] = {}
        self._count = 0
        # one for each requested number of signals
        self._writer = functools.cache(lambda count: instance.writer(inputs[:count]))
        self._reader = functools.cache(lambda count: instance.reader(outputs[:count]))

    @property
    def error(self) -> BaseException | None:
        return self._guarded.error

    def entry_points(self) -> tuple[int, ...]:
        """No component, and the functions' addresses."""
        address = self._guarded.address
        return (
            0,
            address(VALUES, self._set),
            address(VALUES, self._get),
            address(STEP, lambda _, t, h, __: self._instance.step(t, h)),
            address(STATE, self._save),
            address(STATE, lambda _, state: self._instance.restore(self._states[state])),
            address(STATE, self._release),
        )

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
