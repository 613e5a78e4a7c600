"""How often a record without any effect shows as much evidence for a cause."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]

NEAREST = 60
"""Faultless records of most like kind that a record is compared with."""
_SIZES = 3  # of a kind's figures, that are compared by their ratios


class RecordKind(NamedTuple):
    """What tells how much evidence there is in a record without any fault.

    Attributes
    ----------
    noise : float
        Of the force, as share of the friction.
    inertia : float
        Of all that moves [kg].
    step : float
        Sampling interval [s].
    current : float
        1 where the motor's current is recorded, else 0.
    classical : float
        1 where the friction is believed to depend on velocity alone, else 0.
    """

    noise: float
    inertia: float
    step: float
    current: float
    classical: float


def p_value(evidence: float, kind: RecordKind) -> float:
    """Share of the most alike faultless records whose strongest cause has at least this evidence.

    The record in question counts as one of them, so that this is a p-value if it is faultless, and
    its drive like those of ``proofs/worlds``, whose records the shares are taken from. No model of
    the noise is asked: a law that is not exact leaves structure in every record, and that structure
    is in these records, too. Comparing with what lies nearest is localized conformal inference
    (Guan, Biometrika 110, 2023), with weights of one and zero.

    Parameters
    ----------
    evidence : float
        Of the strongest cause by itself, in natural logarithms, see `strongest_alone`.
    kind : RecordKind
    """
    return share_alike(evidence, kind, _known())


def share_alike(evidence: float, kind: RecordKind, known: Matrix) -> float:
    """As `p_value`, told by given records.

    Parameters
    ----------
    known : ndarray, shape (records, 6)
        Evidence of the strongest cause, then the figures of `RecordKind`.
    """
    places = _places(known[:, 1:])
    spread = np.maximum(places.std(axis=0), 1e-9)
    apart = np.linalg.norm((places - _places(np.array([kind]))) / spread, axis=1)
    alike = known[np.argsort(apart, kind="stable")[:NEAREST], 0]
    return float((1 + np.count_nonzero(alike >= evidence)) / (1 + len(alike)))


def _places(kinds: Matrix) -> Matrix:
    return np.hstack([np.log(kinds[:, :_SIZES]), kinds[:, _SIZES:]])


@cache
def _known() -> Matrix:
    with (files(__package__) / "faultless_evidence.csv").open(encoding="utf-8") as table:
        return np.loadtxt(table, delimiter=",", skiprows=1, ndmin=2)
