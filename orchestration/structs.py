"""Records that compiled code and Python share.

A record holds numbers, other records and the addresses of arrays, and compiled code gets the
address of the record: one argument, however much is in it, and changes are seen on both sides. To
hand over the arrays themselves would make numba's compiler ten times as slow.
"""

from __future__ import annotations

from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import carray, njit, types
from numba.extending import intrinsic

from ..solver.writable_cache import ready

ready()
Vector = npt.NDArray[np.float64]
_Function = TypeVar("_Function")

VECTOR = np.dtype([("address", np.intp), ("size", np.intp)])
"""An array of numbers that somebody else keeps."""


def compiled(function: _Function) -> _Function:
    """The function as machine code that lets other threads run, kept on disk."""
    return cast(_Function, njit(cache=True, nogil=True, error_model="numpy")(function))


@intrinsic  # type: ignore[untyped-decorator]
def _numbers(_: Any, address: Any) -> Any:
    def generated(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.intp), generated


@intrinsic  # type: ignore[untyped-decorator]
def _places(_: Any, address: Any) -> Any:
    def generated(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())

    return types.CPointer(types.int64)(types.intp), generated


@compiled
def numbers(vector: Any) -> Vector:
    """The array at a `VECTOR`."""
    found: Vector = carray(_numbers(vector.address), vector.size)
    return found


@compiled
def places(vector: Any) -> npt.NDArray[np.int64]:
    """The array of indices at a `VECTOR`."""
    found: npt.NDArray[np.int64] = carray(_places(vector.address), vector.size)
    return found


@compiled
def copy(source: Vector, target: Vector) -> None:
    """Write one array over another of the same length."""
    for k in range(len(target)):
        target[k] = source[k]


class Struct:
    """A record, or a part of one, with the arrays that its vectors point to.

    Attributes
    ----------
    record : np.record
        For compiled code; its numbers can be read and set.
    """

    def __init__(self, whole: Any, kept: list[Any]) -> None:
        self._whole, self._kept = whole, kept
        self.record: Any = whole[0]

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


def struct(kind: np.dtype[Any]) -> Struct:
    """A new record, all zeros."""
    return Struct(np.zeros(1, kind).view(np.recarray), [])
