"""What a name that is not known may have meant: the end of a line of complaint."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

ALIKE = 0.5  # least likeness of two names, of 1


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The one name that is nearest, as a question; empty where none is near."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=ALIKE)
    return f", did you mean {near[0]}?" if near else ""


def nearest(name: str, known: Iterable[str]) -> str:
    """Up to three names that are near; empty where none is."""
    near = difflib.get_close_matches(name, list(known), n=3, cutoff=ALIKE)
    return f"; nearest: {', '.join(near)}" if near else ""
