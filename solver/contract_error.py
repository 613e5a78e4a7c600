"""The error of an inconsistent component, in its own file: importing it needs no SymPy."""

from __future__ import annotations


class ContractError(ValueError):
    """A component is inconsistent; the message names it and the wrong part."""
