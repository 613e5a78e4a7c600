"""Common parts of the pictures of all systems: size, style, colours, and paths of components."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ballscrew.orchestration.loop.pictures import COLOURS, DASHES, styled_figure, write_figure

__all__ = ["COLOURS", "DASHES", "drawing", "part", "write_figure"]


@contextmanager
def drawing(columns: int = 1, rows: int = 1, height: float = 3.8) -> Iterator[tuple[Any, Any]]:
    """A figure and a flat array of its axes, in the common style."""
    with styled_figure(rows, columns, (9.5, height * rows)) as (figure, axes):
        yield figure, list(axes.flat)


def part(beside: str, name: str) -> str:
    """Name for commands of a component in the ``components.py`` next to the file `beside`."""
    return f"{Path(beside).with_name('components.py')}:{name}"
