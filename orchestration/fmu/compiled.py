"""The master's compiled part: its records, as ``c/`` declares them, its functions, and its FMUs.

A record holds numbers, other records and the addresses of arrays, and compiled code gets the
address of the record: a single argument, and both sides see all changes.

An FMU of FMI 2.0 in this process whose signals are real is called through the addresses of its
own functions, one in another process through those of ``remote.c``, and a group of FMUs through
those of ``group.c``. Any other instance (FMI 3.0, model exchange, units that are converted) gets
functions with the same signatures that call its Python methods, so that one code of the coupling
is enough for all of them.
"""

from __future__ import annotations

import ctypes as ct
import itertools
import math
import re
from collections.abc import Callable, Sequence
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ...solver.core import SUFFIX
from .fmi_versions import ERROR, OK, STATE, STEP
from .fmu_instance import ENTRY_POINTS, MOVE, AnyFmu, FmuInstance, Instance, Stepped
from .group import Group

USES = 3  # of saved states, as in ``c/controller.c``
FARTHEST = 1e4  # times an output's nominal value: beyond it, a loop diverges
Why = IntEnum("Why", "GOES_ON STEP_FAILED DIVERGES", start=0)
"""Why a march has ended; in the order of ``c/master.c``."""

OWN_STEP, WAITS = ct.CFUNCTYPE(ct.c_int, ct.c_double), ct.CFUNCTYPE(ct.c_int, ct.c_int)
VALUES = ct.CFUNCTYPE(ct.c_int, ct.c_void_p, ct.c_void_p, ct.c_size_t, ct.c_void_p)  # fmi2SetReal

_FOLDER = Path(__file__).parents[1] / "master" / "c"
_SOURCES = "calls.h controller.c coupling.c clock.c joint_step.c group.c remote.c master.c".split()
_SIZED = "Loop Course Clock Joint Trail Group Member Line Remote Served".split()


@cache
def records() -> dict[str, np.dtype[Any]]:
    """The records of the C sources by name; what is neither number nor record is an address."""
    kinds: dict[str, np.dtype[Any]] = {"int64_t": np.dtype(np.int64), "double": np.dtype(float)}
    text = "".join((_FOLDER / name).read_text("utf-8") for name in _SOURCES)
    text = re.sub(r"/\*.*?\*/|\bconst\b", "", text, flags=re.DOTALL)
    for body, record in re.findall(r"typedef struct \{(.*?)\} (\w+);", text, flags=re.DOTALL):
        fields: list[tuple[str, np.dtype[Any]]] = []
        for field in body.split(";")[:-1]:
            kind, names = field.split(maxsplit=1)
            if function := re.search(r"\(\*(\w+)\)", names):
                kind, names = "", function[1]
            own = kinds.get("" if "*" in names else kind, np.dtype(np.intp))
            fields += [(name.strip(" *"), own) for name in names.split(",")]
        kinds[record] = np.dtype(fields)
    return kinds


class Struct:
    """A record for compiled code, or a part of one, with the arrays that its vectors point to."""

    def __init__(self, whole: Any, kept: list[Any]) -> None:
        self._whole, self._kept = whole, kept
        self.record: Any = whole[0]
        self.address = int(whole.ctypes.data)  # for compiled code

    def part(self, name: str) -> Struct:
        """A record within this one."""
        return Struct(self._whole[name], self._kept)

    def set(self, **fields: Any) -> None:
        """Set numbers, vectors to arrays, and addresses to records; both live as long as this."""
        for name, value in fields.items():
            if isinstance(value, np.ndarray | Struct):
                self._kept.append(value)
            if isinstance(value, np.ndarray):
                assert value.flags.c_contiguous
                value = (value.ctypes.data, value.size)
            self._whole[name] = value.address if isinstance(value, Struct) else value


def struct(name: str) -> Struct:
    """A new record of the C sources, all zeros."""
    return Struct(np.zeros(1, records()[name]).view(np.recarray), [])


@cache
def library() -> Any:
    """The compiled functions, loaded once; other threads can run during their calls."""
    loaded = ct.CDLL(str(_FOLDER / f"libmaster{SUFFIX}"))
    loaded.clock_now.restype = loaded.clock_step_to_come.restype = ct.c_double
    size = ct.c_int64.in_dll(loaded, "master_size").value
    if size != sum(records()[name].itemsize for name in _SIZED):
        raise ImportError("libmaster has other records than this version of ballscrew: build it")
    return loaded


def call(function: str, *arguments: Struct | npt.NDArray[Any] | float) -> Any:
    """Call a compiled function; records and arrays are read or written in place; 0: no record."""

    def passed(given: Struct | npt.NDArray[Any] | float) -> Any:
        if isinstance(given, Struct | np.ndarray):
            return ct.c_void_p(given.address if isinstance(given, Struct) else given.ctypes.data)
        return ct.c_double(given) if isinstance(given, float) else ct.c_int64(given)

    return getattr(library(), function)(*map(passed, arguments))


def address_of(function: Any) -> int:
    return ct.cast(function, ct.c_void_p).value or 0


class Guarded:
    """Python functions for compiled code; an error, also an interruption, is raised after it.

    They return the status fmi2OK, or fmi2Error after an error.
    """

    def __init__(self) -> None:
        self.error: BaseException | None = None
        self._kept: list[Any] = []

    def address(self, kind: Any, method: Callable[..., Any]) -> int:
        """The address of a method as a C function of this kind, valid as long as this object."""

        def called(*arguments: Any) -> int:
            try:
                method(*arguments)
            except BaseException as error:
                self.error = error
                return ERROR
            return 0

        self._kept.append(kind(called))
        return address_of(self._kept[-1])


class Bound:
    """An instance for compiled code: its functions, and these ports, in the given record.

    Compiled code finds the signals in the order of the ports; `USES` states can be saved at a
    time.
    """

    def __init__(
        self, instance: Instance, inputs: Sequence[str], outputs: Sequence[str], calls: Struct
    ) -> None:
        self.calls, self._ports, self._guarded = calls, (list(inputs), list(outputs)), Guarded()
        given, taken = np.zeros(len(inputs)), np.zeros(len(outputs))
        places: list[Sequence[int]] = [[0] * len(inputs), [0] * len(outputs)]
        self._error: Callable[[], BaseException | None]
        if isinstance(instance, FmuInstance) and instance.is_compiled([*inputs, *outputs]):
            points: Sequence[Any] = instance.entry_points()
            places = [instance.references(names) for names in self._ports]
            self._error = lambda: self._error_of(instance)
            calls.set(ends=self._guarded.address(STEP, instance.check_end))
        elif isinstance(instance, AnyFmu) and hasattr(instance, "bind"):
            points, self._error = instance.bind(*self._ports)
        elif isinstance(instance, Group):
            points, self._error = _group_calls(instance)
            places = [[instance.place[n] for n in names] for names in self._ports]
        else:
            points, self._error = _python_calls(
                cast("Stepped", instance), *self._ports, given, taken
            )
        calls.set(**dict(zip(ENTRY_POINTS, points, strict=True)))
        calls.set(inputs=np.array(places[0], dtype=np.uint32), given=given)
        calls.set(outputs=np.array(places[1], dtype=np.uint32), taken=taken)
        calls.set(stop=getattr(instance, "stop", math.inf), states=np.zeros(USES, dtype=np.int64))

    def failure(self) -> BaseException | None:
        """The error of the last failed call, as raised by the FMU instance."""
        return self._error() if self.calls.record.status > OK else None

    def _error_of(self, fmu: FmuInstance) -> BaseException:
        status, call = int(self.calls.record.status), int(self.calls.record.failed)
        return fmu.failure(status, call, self._ports[call] if call < MOVE else ())


def failure_of(*bound: Bound) -> BaseException | None:
    """The error of the instance whose call failed; None if no call failed."""
    return next((error for error in (b.failure() for b in bound) if error is not None), None)


def ask(bound: Sequence[Bound], function: str, *arguments: Any) -> None:
    """Call a function ``master_...``; raises a failed call as the instance itself would."""
    if not call(f"master_{function}", *arguments):
        raise failure_of(*bound) or RuntimeError(function)


Calls = tuple[Sequence[Any], Callable[[], BaseException | None]]


def _group_calls(group: Group) -> Calls:
    """A group and the functions of ``c/group.c``, and what gives the error of a failed call."""
    whole, bound, addresses = struct("Group"), list[Bound](), dict[int, int]()
    for part in group.parts:
        member, ports = struct("Member"), [f.port for f in part.feeds]
        follows = any(map(part.instance.follows_at_once, part.instance.outputs))
        member.set(sources=part.sources.astype(np.int64), first=part.outputs.start, follows=follows)
        bound.append(Bound(part.instance, ports, part.instance.outputs, member.part("calls")))
        addresses[id(part)] = member.address
    for name in ("parts", "there", "back"):
        order = [addresses[id(part)] for part in getattr(group, name)]
        whole.set(**{name: np.array(order, dtype=np.int64)})
    whole.set(values=group.values, flags=group.flags, lags=group.lags)
    functions = (address_of(getattr(library(), f"group_{name}")) for name in ENTRY_POINTS[1:])
    return (whole, *functions), lambda: failure_of(*bound)


def _python_calls(
    instance: Stepped, inputs: Sequence[str], outputs: Sequence[str], given: Vector, taken: Vector
) -> Calls:
    """Functions with FMI's signatures that call an instance's methods, with these two arrays."""
    guarded, states, numbers = Guarded(), dict[int, Any](), itertools.count(1)
    write = instance.writer(inputs)
    reader = cache(lambda count: instance.reader(outputs[:count]))

    def take(_: Any, __: Any, count: int, ___: Any) -> None:
        taken[:count] = reader(count)()

    def save(_: Any, slot: int) -> None:
        number = next(numbers)
        states[number] = instance.save()
        ct.c_void_p.from_address(slot).value = number

    def release(_: Any, slot: int) -> None:
        instance.release(states.pop(ct.c_void_p.from_address(slot).value or 0))

    functions = (
        (VALUES, lambda *_: write(given.copy())),
        (VALUES, take),
        (STEP, lambda _, t, h, __: instance.step(t, h)),
        (STATE, save),
        (STATE, lambda _, state: instance.restore(states[state])),
        (STATE, release),
    )
    points = (0, *(guarded.address(kind, function) for kind, function in functions))
    return points, lambda: guarded.error
