"""From scores to the smallest set of suspects that contains the true cause with a known coverage.

Each suspect, `NOTHING` and `OUTSIDE` get a utility that is linear in a few statistics of their
scores, and so a probability (conditional logit; D. McFadden, "Conditional
logit analysis of qualitative choice behavior", 1974). A set contains all whose probability is above
a threshold. In 5 % of the calibration records the probability of the true cause was below it (split
conformal prediction, least ambiguous sets; M. Sadinle, J. Lei and L. Wasserman, JASA 114, 2019). If
an error is certain, the threshold is a different one. The coverage holds for records like those of
the calibration; `proofs/calibrate_sets.py` computes the table.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ...solver.arrays import Matrix, Vector
from .causes import CAUSES
from .scores import OUTSIDE, Scored, Suspect
from .signals import SIGNALS

NOTHING = "none"
EVERYONE = (*CAUSES, *SIGNALS, OUTSIDE)
TABLE = Path(__file__).with_name("sets.json")

_UNIT = 5.0  # a score that noise can have [nats]
_SURE = 20.0  # a score that distinguishes the first from the others [nats]
_OF_SUSPECT = 10
_OF_NOTHING = 9
STATISTICS = 2 * _OF_SUSPECT + _OF_NOTHING + 2
"""Number of statistics: of a suspect of the catalogue, of `OUTSIDE`, of `NOTHING`, and two with
separate weights for each name."""


@dataclass(frozen=True)
class Likely:
    """A member of a set.

    Attributes
    ----------
    name : str
        Name of a cause or signal, `OUTSIDE` or `NOTHING`.
    probability : float
        Probability among all hypotheses.
    suspect : Suspect or None
        The suspect with its size; None for `NOTHING`.
    certain : bool
        Whether it is named: at most 2 % of the calibration records got a wrong name.
    """

    name: str
    probability: float
    suspect: Suspect | None
    certain: bool = False


def statistics(scored: Scored) -> tuple[list[str], Matrix]:
    """Names of all suspects and `NOTHING`, and their statistics, shape (names, STATISTICS).

    The statistics of a suspect are: logarithms of its score and of its distance to the best score;
    its removed share and the distance to the largest one, over all bands and in its best band; the
    logarithms of its score without its best block, of the cost of its values, of its score in
    addition to the first, and of its lead.
    """
    suspects = scored.suspects
    best = max((s.score for s in suspects), default=0.0)
    second = max((s.score for s in suspects[1:]), default=0.0)
    share = max((_share(s.share) for s in suspects), default=0.0)
    in_band = max((_share(s.band_share) for s in suspects), default=0.0)
    names, rows = [], []
    for k, s in enumerate(suspects):
        own = [
            _log(s.score),
            _log(best - max(s.score, 0.0)),
            _share(s.share),
            max(share, 0.0) - _share(s.share),
            _share(s.band_share),
            max(in_band, 0.0) - _share(s.band_share),
            _log(s.score - float(np.max(s.by_block))),
            float(np.log1p(s.cost)),
            _log(scored.beside.get(s.name, 0.0)) if k else 0.0,
            0.0 if k else _log(best - second),
        ]
        row = np.zeros(STATISTICS)
        begin = _OF_SUSPECT if s.name == OUTSIDE else 0
        row[begin : begin + _OF_SUSPECT] = own
        row[-2:] = own[0], max(s.score, 0.0) / (best + _SURE)
        names.append(s.name)
        rows.append(row)
    for name in EVERYONE:
        if name not in names:  # it improves no score, but may still be present
            row = np.zeros(STATISTICS)
            begin = _OF_SUSPECT if name == OUTSIDE else 0
            row[begin + 1], row[begin + 3] = _log(best), max(share, 0.0)
            row[begin + 5] = max(in_band, 0.0)
            names.append(name)
            rows.append(row)
    outside = max((s.score for s in suspects if s.name == OUTSIDE), default=0.0)
    row = np.zeros(STATISTICS)
    row[2 * _OF_SUSPECT : -2] = [
        _log(best),
        max(share, 0.0),
        float(np.log1p(scored.base.cost[0])),
        _log(outside),
        max(in_band, 0.0),
        *scored.unlike_noise,
    ]
    return [*names, NOTHING], np.array([*rows, row])


def probabilities(
    names: Sequence[str], rows: Matrix, weights: Vector, own: Mapping[str, Sequence[float]]
) -> Vector:
    """Probability of each name, shape (names,).

    `own` has for each name a constant and weights of the last two statistics.
    """
    of_names = np.array([own.get(n, (0.0, 0.0, 0.0)) for n in names])
    utility = rows @ weights + of_names[:, 0] + np.sum(rows[:, -2:] * of_names[:, 1:], axis=1)
    odds = np.exp(utility - utility.max())
    return np.asarray(odds / odds.sum())


def likely(scored: Scored, something: bool = False) -> tuple[list[Likely], bool]:
    """The set, the most probable first, and whether there is an error at all.

    With `something`, an error is already known to exist.

    The first is certain if its probability is so high that at most 2 % of the calibration records
    got a wrong name (conformal risk control; A. Angelopoulos and others, 2022). An error is
    reported if its absence is less probable than for 97 % of faultless records.
    """
    table = _table()
    least = table["thresholds"]
    names, rows = statistics(scored)
    found = probabilities(names, rows, np.array(table["weights"]), table["own"])
    nothing = names.index(NOTHING)
    something = something or bool(found[nothing] < least["of_none"])
    if something:
        found[nothing] = 0.0
        found /= found.sum()
    suspects = {s.name: s for s in scored.suspects}
    order = np.argsort(-found)
    of_members = least["of_something" if something else "of_members"]
    kept = [k for j, k in enumerate(order) if j == 0 or found[k] >= of_members]
    members = [Likely(names[k], float(found[k]), suspects.get(names[k])) for k in kept]
    first = members[0]
    if first.suspect and first.name != OUTSIDE and first.probability >= least["of_name"]:
        members[0] = replace(first, certain=True)
    return members, something


@cache
def _table() -> dict[str, Any]:
    return dict(json.loads(TABLE.read_text(encoding="utf-8")))


def _share(share: float) -> float:
    return min(max(share, -0.3), 1.0)


def _log(score: float) -> float:
    return float(np.log1p(max(score, 0.0) / _UNIT))
