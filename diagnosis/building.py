"""Causes included in a model one after the other, each together with those before.

Of each look the most probable is built in, where something is wrong for certain. It is named only
where it is certain itself, and that is told of the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..records.bad_record import BadRecord
from .causes import CAUSES
from .explained import Explained, built
from .held_out import laps_of, left_on_blocks
from .noise_floor import noise_floor
from .residuals import residual
from .scores import OUTSIDE, Catalogue, Scored, Suspect, in_best_form, scored
from .sets import Likely, likely
from .study import Study

_MOST = 4  # of what is built in
_AS_GOOD, _LIKELY = 0.7, 0.1  # of the score of a free curve, and a probability


def explained(study: Study, take: str | None = None) -> Explained:
    """Build in the cause to `take`, then what is likeliest, each beside those before.

    In the end each is taken in the form that does best beside all others.

    Raises
    ------
    BadRecord
        If these records cannot show the cause that is to be taken.
    """
    catalogue = Catalogue(study)
    taken: list[Likely] = []
    sets: list[list[Likely]] = []
    while True:
        looked = scored(catalogue, _suspects(taken))
        members, wrong = likely(looked, _repeats(Explained(study, catalogue, taken)))
        sets.append(members)
        first = _likeliest(members)
        if take is not None:
            first, take = _taken(looked, members, study, take), None
        elif first is None or not (first.certain or wrong) or len(taken) == _MOST:
            break
        # names were calibrated where nothing is known yet
        taken = [*taken, replace(first, certain=first.certain and not taken)]
    for k, member in enumerate(taken):
        others = _suspects([m for m in taken if m is not member])
        if others and member.suspect:
            better = in_best_form(catalogue, member.suspect, others)
            taken[k] = replace(member, suspect=better)
    return Explained(study, catalogue, taken, sets, wrong)


def _likeliest(members: Sequence[Likely]) -> Likely | None:
    """The first of a set, if it can be built in.

    A free curve follows what a cause does, too: one that does nearly as much is taken before it.
    """
    first = members[0]
    if first.suspect is None or first.name != OUTSIDE:
        return first if first.suspect else None
    least = _AS_GOOD * first.suspect.score
    for m in members[1:]:
        if m.suspect is not None:
            return m if m.probability >= _LIKELY and m.suspect.score >= least else None
    return None


def _suspects(members: Sequence[Likely]) -> list[Suspect]:
    return [m.suspect for m in members if m.suspect]


def _taken(looked: Scored, members: Sequence[Likely], study: Study, name: str) -> Likely:
    suspect = next((s for s in looked.suspects if s.name == name), None)
    if suspect is None:
        why = CAUSES[name].beyond(study.courses, study.model) or (
            "none of its forms fits the records"
        )
        raise BadRecord(f"these records cannot show {name}: {why}")
    probability = next((m.probability for m in members if m.name == name), 0.0)
    return Likely(name, probability, suspect)


def _repeats(found: Explained) -> bool:
    """Whether the residual on held-out data is larger than the differences between laps."""
    if not laps_of(found.study.courses):
        return False
    left = residual(*built(found.study, found.forms, found.fit.amplitude[0]))
    return not noise_floor(found, left).has(left_on_blocks(found, found.forms))
