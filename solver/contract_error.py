"""The error of a component that contradicts itself; apart, so that to name it costs no SymPy."""

from __future__ import annotations


class ContractError(ValueError):
    """A component contradicts itself; the message names it and the offending part."""
