"""How often a record without any effect shows as much evidence for a cause."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np
import numpy.typing as npt


def p_value(evidence: float) -> float:
    """Share of faultless records whose strongest cause has at least this evidence.

    The record in question counts as one of them, so that this is a p-value if it is faultless, and
    its drive like those of ``proofs/worlds``, whose records the shares are taken from. No model of
    the noise is asked: a law that is not exact leaves structure in every record, and that structure
    is in these records, too.

    Parameters
    ----------
    evidence : float
        Of the strongest cause by itself, in natural logarithms, see `strongest_alone`.
    """
    known = _evidence()
    return float((1 + np.count_nonzero(known >= evidence)) / (1 + len(known)))


@cache
def _evidence() -> npt.NDArray[np.float64]:
    text = (files(__package__) / "faultless_evidence.csv").read_text(encoding="utf-8")
    return np.array([float(line) for line in text.splitlines()[1:]])
