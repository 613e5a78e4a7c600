"""The master's compiled part: its records, as ``c/`` declares them, and calls of its functions.

A record holds numbers, other records and the addresses of arrays, and compiled code gets the
address of the record: a single argument, and both sides see all changes.
"""

from __future__ import annotations

import ctypes as ct
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...solver.core import SUFFIX, at

Vector = npt.NDArray[np.float64]

USES = 3  # uses of saved states
FARTHEST = 1e4  # times an output's nominal value: beyond it, a loop diverges
GOES_ON, STEP_FAILED, COMMAND_FAILED, NOT_FINITE, DIVERGES, CALL_FAILED = range(6)

OWN_STEP = ct.CFUNCTYPE(ct.c_int, ct.c_double)
ASKED_LAW = ct.CFUNCTYPE(ct.c_int, ct.c_double, ct.c_double, ct.c_void_p, ct.c_void_p)
ASKED_ADVANCE = ct.CFUNCTYPE(ct.c_int, ct.c_double, ct.c_double, ct.c_void_p)

_FOLDER = Path(__file__).parent / "c"
_SOURCES = ("calls.h", "coupling.c", "clock.c", "joint_step.c", "group.c", "master.c")
_SIZED = ("Pair", "Course", "Clock", "Joint", "Trail", "Group", "Member")


class CallFailed(Exception):
    """An FMU instance rejected a call; its record has the call and the reason."""


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
            kind = "" if "*" in names else kind
            own = kinds.get(kind, np.dtype(np.intp))
            fields += [(name.strip(" *"), own) for name in names.split(",")]
        kinds[record] = np.dtype(fields)
    return kinds


class Struct:
    """A record for compiled code, or a part of one, with the arrays that its vectors point to."""

    def __init__(self, whole: Any, kept: list[Any]) -> None:
        self._whole, self._kept = whole, kept
        self.record: Any = whole[0]

    @property
    def address(self) -> int:
        """Its address, for compiled code."""
        return int(self._whole.ctypes.data)

    def part(self, name: str) -> Struct:
        """A record within this one."""
        return Struct(self._whole[name], self._kept)

    def set(self, **fields: Any) -> None:
        """Set numbers, and vectors to arrays, which are kept as long as the record."""
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                assert value.flags.c_contiguous
                self._kept.append(value)
                value = (value.ctypes.data, value.size)
            self._whole[name] = value


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


def call(function: str, *arguments: Struct | Vector | float) -> Any:
    """Call a compiled function; records and arrays are read or written in place."""

    def passed(given: Struct | Vector | float) -> Any:
        if isinstance(given, Struct):
            return ct.c_void_p(given.address)
        if isinstance(given, np.ndarray):
            return ct.c_void_p(at(given))
        return ct.c_double(given) if isinstance(given, float) else ct.c_int64(given)

    return getattr(library(), function)(*map(passed, arguments))


def ask(function: str, whom: Struct, *arguments: Vector | float) -> None:
    """Call a function ``master_...`` on a loop or an FMU instance; raises `CallFailed`."""
    if not call(f"master_{function}", whom, *arguments):
        raise CallFailed


def address_of(function: Any) -> int:
    return ct.cast(function, ct.c_void_p).value or 0


class Guarded:
    """Python functions for compiled code; an error, also an interruption, is raised after it.

    They return `done`, or `failed` after an error.
    """

    def __init__(self, done: int, failed: int) -> None:
        self.error: BaseException | None = None
        self._done, self._failed = done, failed
        self._kept: list[Any] = []

    def address(self, kind: Any, method: Callable[..., Any]) -> int:
        """The address of a method as a C function of this kind, valid as long as this object."""

        def called(*arguments: Any) -> int:
            try:
                method(*arguments)
            except BaseException as error:
                self.error = error
                return self._failed
            return self._done

        self._kept.append(kind(called))
        return address_of(self._kept[-1])
