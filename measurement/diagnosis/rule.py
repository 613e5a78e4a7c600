"""The rule that decides what is wrong, what is built in, and what is named.

A hypothesis is *found* if its score, its share of the squares and the lower end of the interval of
that share, all on held-out blocks, are large enough. The set has the best one that is found and all
that come near the top score; without one that is found, it is empty. The best is named if no other
entry of the catalogue is in the set, and if its share or its score is far larger: what is outside
the catalogue looks in part like one of its causes. The numbers were set on records of simulated
machines; `proofs/diagnosis/rule.py` counts how often they are wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from .causes import CAUSES, OUTSIDE, entry_of
from .causes.cause import Form
from .fit import Fit, Study
from .model import Drive
from .motion import Course, recalibrated
from .scores import Catalogue, Gain, Hypothesis, gain_of, scored, smaller_by

SCORE = 100.0  # least score of what is found [nats]

SHARE = 0.05  # least share of the squares that it removes

NEAR = 0.8  # least score of a member of the set, as a share of the best one

NAMED_SHARE, NAMED_SCORE = 0.9, 500.0  # one of them is reached by what is named

NOISE = 20.0  # scores up to this are noise [nats]

_MOST = 4  # causes built in


@dataclass(frozen=True)
class Explained:
    """Causes built in, in the order in which they were found, and the hypotheses that remain."""

    study: Study
    catalogue: Catalogue
    built: list[Hypothesis]
    sets: list[list[Hypothesis]]  # the set before each of them, best first, and the last one
    near: list[Hypothesis]  # near the top of the last scores, and above noise

    @property
    def forms(self) -> list[Form]:
        return [h.form for h in self.built]

    @cached_property
    def fit(self) -> Fit:
        return self.catalogue.without(self.forms)

    @cached_property
    def corrected(self) -> tuple[list[Course], Drive]:
        """Courses with the causes built in, and the model with values fitted beside them."""
        return built(self.study, self.forms, self.fit.amplitude[0])

    @property
    def variance(self) -> Vector:
        """Variance of the residual in each used band, per number [N^2]."""
        bands = self.study.bands
        counts = bands.counts[:, bands.used].sum(axis=0)
        return np.asarray(self.fit.squares[0].sum(axis=0) / counts + self.study.exact**2)

    @property
    def doubtful(self) -> list[Hypothesis]:
        """What may be there if nothing is found."""
        return [] if self.built or self.sets[-1] else self.near

    @property
    def suspects(self) -> list[Hypothesis]:
        """Members of the sets that are not built in, or what is doubtful, the best first."""
        names, sets = {h.name for h in self.built}, [*self.sets, self.doubtful]
        kept = {h.name: h for members in sets for h in members if h.name not in names}
        return sorted(kept.values(), key=lambda h: -h.score)

    @property
    def outside(self) -> Hypothesis | None:
        """The free curve that follows what is left, if nothing in the catalogue does."""
        return next((h for h in self.sets[-1][:1] if h.name == OUTSIDE), None)

    @property
    def alternatives(self) -> dict[str, tuple[str, ...]]:
        """For each cause built in, the others of its set."""
        names, out = {h.name for h in self.built}, {}
        for h, members in zip(self.built, self.sets, strict=False):
            if others := tuple(m.name for m in members if m.name not in names):
                out[h.name] = others
        return out

    def gain(self, forms: Sequence[Form]) -> Gain:
        """What the causes built in remove from what only these of their forms leave."""
        squares = self.fit.squares[0]
        for form, mine in own_amplitudes(self.study, self.forms, self.fit.amplitude[0]):
            if not any(form is f for f in forms):
                squares = squares / smaller_by(self.study, form, mine) ** 2
        return gain_of(self.study, self.catalogue.without(forms).squares[0], squares)


def explained(study: Study, take: str | None = None) -> Explained:
    """Build in the cause `take`, then the best one that is found, each beside the earlier ones.

    At the end, each gets the form that scores best together with all others, and one that gains
    nothing beside them goes. Raises `BadRecord` if these records cannot show the cause `take`.
    """
    catalogue = Catalogue(study)
    built: list[Hypothesis] = []
    sets: list[list[Hypothesis]] = []
    while True:
        ranked = scored(catalogue, built)
        sets.append(members_of(ranked))
        if take and not built:
            first = next((h for h in ranked if h.name == take), None)
            if first is None:
                why = CAUSES[take].beyond(study.courses, study.model)
                why = why or "none of its forms fits the records"
                raise BadRecord(f"these records cannot show {take}: {why}")
        elif not sets[-1] or sets[-1][0].name == OUTSIDE or len(built) == _MOST:
            break
        else:
            first = sets[-1][0]
        # the numbers were set for the first cause
        built.append(replace(first, certain=first.certain and not built))
    for k, h in enumerate(built):
        others = [m for m in built if m is not h]
        better = scored(catalogue, others, only=h.name) if others else []
        if better:
            built[k] = replace(better[0], lead=h.lead, certain=h.certain, alike=h.alike)
    near = [h for h in near_top(ranked) if h.score > NOISE]
    found = Explained(study, catalogue, built, sets, near)
    while True:
        gains = [found.gain([f for f in found.forms if f is not h.form]) for h in built]
        each = enumerate(zip(built, gains, strict=True))
        idle = [k for k, (h, gain) in each if gain.interval[0] <= 0.0 and h.name != take]
        if not idle:
            return found
        del built[idle[-1]], sets[idle[-1]]
        found = replace(found)  # which forgets the fit with that one


def is_found(h: Hypothesis) -> bool:
    """Whether a hypothesis is more than noise: score, share, and force on held-out data."""
    return h.score >= SCORE and h.gain.share >= SHARE and h.gain.interval[0] > 0.0


def near_top(ranked: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The causes near the best one, or a free curve, which has more parameters, if none is near."""
    causes = [h for h in ranked if h.name != OUTSIDE]
    top = causes[0].score if causes else 0.0
    curve = next((h for h in ranked if h.name == OUTSIDE), None)
    if curve and top < NEAR * curve.score:
        return [curve]
    return [h for h in causes if h.score >= NEAR * top]


def members_of(ranked: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The set with leads and the name decided, the best found first, or nothing if none is."""
    causes = [h for h in ranked if h.name != OUTSIDE]
    near = near_top([h for h in ranked if h.name != OUTSIDE or is_found(h)])
    first = next(filter(is_found, near), None)
    if first is None or first.name == OUTSIDE:
        return [first] if first else []

    def led(h: Hypothesis) -> Hypothesis:
        others = [o.score for o in causes if entry_of(o.name) != entry_of(h.name)]
        return replace(h, lead=h.score - max(others, default=0.0))

    rest = [led(h) for h in near if h is not first]
    alike = tuple(h.name for h in rest if entry_of(h.name) == entry_of(first.name))
    clear = first.gain.share >= NAMED_SHARE or first.score >= NAMED_SCORE
    certain = clear and len(alike) == len(rest)
    return [replace(led(first), certain=certain, alike=alike), *rest]


def built(study: Study, forms: Sequence[Form], amplitude: Vector) -> tuple[list[Course], Drive]:
    """Courses with the causes, and the model, by the amplitudes of a fit of these forms."""
    model, names = study.model, study.values
    change = dict(zip(names, amplitude.tolist(), strict=False))
    values = {n: model.values[n] * (1.0 + change[n]) for n in model.adjustable}
    off = {n: c for n, c in change.items() if n not in values}
    courses = recalibrated(study.courses, off)
    for form, mine in own_amplitudes(study, forms, amplitude):
        courses = form.added_to(courses, mine)
    return courses, model.changed(values)


def own_amplitudes(
    study: Study, forms: Sequence[Form], amplitude: Vector
) -> Iterator[tuple[Form, Vector]]:
    """Forms that have amplitudes of their own, with these, of a fit of all the forms."""
    at = len(study.values)
    for form in forms:
        if not form.freed:
            yield form, amplitude[at : at + len(form.columns)]
            at += len(form.columns)
