"""numba's compiler with types that mypy can follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

from ..solver.writable_cache import ready

ready()
_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(function: _Function) -> _Function:
    """The function as machine code that lets other threads run, kept on disk between processes."""
    return cast(_Function, njit(cache=True, nogil=True)(function))


def compiled_lean(function: _Function) -> _Function:
    """As `compiled`, for what makes no arrays: they are not counted, which costs more than sums."""
    return cast(_Function, njit(cache=True, nogil=True, _nrt=False)(function))


def compiled_in_place(function: _Function) -> _Function:
    """A part of compiled functions, put in where it is called: for inner loops."""
    return cast(_Function, njit(inline="always")(function))
