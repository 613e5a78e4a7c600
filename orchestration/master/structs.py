"""Records that compiled code and Python share.

A record holds numbers, other records and the addresses of arrays, and compiled code gets the
address of the record: a single argument, and both sides see all changes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]

VECTOR = np.dtype([("address", np.intp), ("size", np.intp)])
"""An array of numbers that is owned elsewhere."""


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


def struct(kind: np.dtype[Any]) -> Struct:
    """A new record, all zeros."""
    return Struct(np.zeros(1, kind).view(np.recarray), [])
