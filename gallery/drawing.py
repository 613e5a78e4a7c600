"""What the pictures of all systems have in common: size, style, colours, and where a part is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ballscrew.orchestration.pictures import COLOURS, DASHES, STYLE, new_figure, write_figure

__all__ = ["COLOURS", "DASHES", "drawing", "part", "write_figure"]


@contextmanager
def drawing(columns: int = 1, rows: int = 1, height: float = 3.8) -> Iterator[tuple[Any, Any]]:
    """A figure and its axes, flat, to draw into in the style of all pictures."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure, axes = new_figure(rows, columns, (9.5, height * rows))
        yield figure, list(axes.flat)


def part(beside: str, name: str) -> str:
    """A component of the file ``components.py`` beside another, as commands name it."""
    return f"{Path(beside).with_name('components.py')}:{name}"
