"""Errors that a user can correct: one line each, and one base; suggestions for unknown names.

Importing them needs no SymPy.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_ALIKE = 0.5  # least similarity of two names, 0 to 1


class UserError(ValueError):
    """A request that cannot be met; the message says what was got, and what was expected."""


class ContractError(UserError):
    """A component is inconsistent or cannot be used; the message names it and the wrong part."""


class UnknownName(UserError, KeyError):
    """There is no part or law of this name; the message lists the known ones."""

    def __str__(self) -> str:
        return str(self.args[0])


class BadParameter(UserError):
    """An argument or a parameter does not exist, or has an invalid value."""


class BadParameters(UserError):
    """The parameter file is invalid; the message says where, why and what to do."""


class BadRecord(UserError):
    """The file cannot be used as a record; the message says where, why and what to do."""


class FmuError(UserError):
    """The file is not an FMU or a system that can run here; the message says what is wrong."""


class CouplingError(UserError):
    """The parts cannot be coupled in this way; the message names ports or the coupling."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The most similar name, as a question; empty if none is similar."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=_ALIKE)
    return f", did you mean {near[0]}?" if near else ""


def nearest(name: str, known: Iterable[str]) -> str:
    """Up to three similar names; empty if none is similar."""
    near = difflib.get_close_matches(name, list(known), n=3, cutoff=_ALIKE)
    return f"; nearest: {', '.join(near)}" if near else ""
