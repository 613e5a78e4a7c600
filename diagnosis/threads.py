"""Work that is independent, on both cores: what is compiled here lets other threads run."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_Given = TypeVar("_Given")
_Made = TypeVar("_Made")

_AT_ONCE = 2


def in_threads(function: Callable[[_Given], _Made], given: Iterable[_Given]) -> list[_Made]:
    """What a function makes of each, in their order."""
    with ThreadPoolExecutor(_AT_ONCE) as threads:
        return list(threads.map(function, given))
