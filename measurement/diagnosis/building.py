"""Causes included in a model one after the other, each together with the earlier ones.

In each step the most probable cause is included, if an error is certain. It is named only if it is
itself certain, which is decided for the first cause only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...solver.errors import BadRecord
from .causes import CAUSES
from .explained import Explained, built
from .held_out import HeldOut, laps_of, left_on_blocks
from .noise_floor import noise_floor
from .residuals import residual
from .scores import OUTSIDE, Catalogue, Scored, Suspect, in_best_form, scored
from .sets import Likely, likely
from .study import Study

_MOST = 4  # included causes
_AS_GOOD, _LIKELY = 0.7, 0.1  # share of a free curve's score; probability


def explained(study: Study, take: str | None = None) -> Explained:
    """Include the cause `take`, then the most probable ones, each in addition to the earlier ones.

    At the end, each cause gets the form that scores best together with all others.

    Raises
    ------
    BadRecord
        If these records cannot show the cause `take`.
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
        # the certainty of names is calibrated only for the first cause
        taken = [*taken, replace(first, certain=first.certain and not taken)]
    for k, member in enumerate(taken):
        others = _suspects([m for m in taken if m is not member])
        if others and member.suspect:
            better = in_best_form(catalogue, member.suspect, others)
            taken[k] = replace(member, suspect=better)
    return Explained(study, catalogue, taken, sets, wrong)


def alternatives(found: Explained, held: HeldOut) -> dict[str, tuple[str, ...]]:
    """For each cause that is not certain, what explains the held-out data as well in its place."""
    built = {m.name for m in found.built}
    out = {}
    for k, member in enumerate(found.built):
        others = _suspects([m for m in found.built if m is not member])
        rivals = [m.suspect for m in found.sets[k] if m.suspect and m.name not in built]
        as_good = []
        for rival in [] if member.certain else rivals:
            best = in_best_form(found.catalogue, rival, others)
            left = left_on_blocks(found, [*(s.form for s in others), best.form])
            if held.gain(left, held.all)[1][0] <= 0.0:
                as_good.append(rival.name)
        if as_good:
            out[member.name] = tuple(as_good)
    return out


def _likeliest(members: Sequence[Likely]) -> Likely | None:
    """The first member of a set that can be included in the model.

    A free curve also follows the effect of a cause, so a cause with nearly the same score is
    preferred.
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
