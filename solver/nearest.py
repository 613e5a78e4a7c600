"""Suggestions for an unknown name, for the end of an error message."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

ALIKE = 0.5  # least similarity of two names, 0 to 1


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The most similar name, as a question; empty if none is similar."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=ALIKE)
    return f", did you mean {near[0]}?" if near else ""


def nearest(name: str, known: Iterable[str]) -> str:
    """Up to three similar names; empty if none is similar."""
    near = difflib.get_close_matches(name, list(known), n=3, cutoff=ALIKE)
    return f"; nearest: {', '.join(near)}" if near else ""
