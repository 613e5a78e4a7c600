"""Causes included in a model, and the sets of other possible causes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...solver.arrays import Vector
from .balance import Added, recalibrated
from .drive import Drive
from .modelled_record import ModelledRecord
from .scores import OUTSIDE, Catalogue, Form, Suspect
from .sets import NOTHING, Likely
from .study import Fit, Study


@dataclass(frozen=True)
class Explained:
    """Included causes, and other possible causes.

    Attributes
    ----------
    built : list of Likely
        In the order in which they were found.
    sets : list of list of Likely
        The set of possible causes before each inclusion, and the last set.
    none_ruled_out : bool
        Whether an error exists in addition to the included causes: at most 3 of 100 faultless
        records look like this.
    """

    study: Study
    catalogue: Catalogue
    built: list[Likely] = field(default_factory=list)
    sets: list[list[Likely]] = field(default_factory=list)
    none_ruled_out: bool = False

    @property
    def forms(self) -> list[Form]:
        return [m.suspect.form for m in self.built if m.suspect]

    @cached_property
    def fit(self) -> Fit:
        return self.catalogue.without(self.forms)

    @property
    def variance(self) -> Vector:
        """Variance of the residual in each used band, per number [N^2]."""
        bands = self.study.bands
        counts = bands.counts[:, bands.used].sum(axis=0)
        return np.asarray(self.fit.squares[0].sum(axis=0) / counts + self.study.exact**2)

    @property
    def suspects(self) -> list[Likely]:
        """Other possible causes, besides the included ones or instead of them, most probable first.

        If no other cause is the most probable result, the list
        is empty.
        """
        names = {m.name for m in self.built}
        kept: dict[str, Likely] = {}
        for members in self.sets:
            if members[0].name == NOTHING:
                continue
            for m in members:
                if m.suspect is not None and m.name not in names:
                    kept[m.name] = m
        return sorted(kept.values(), key=lambda m: -m.probability)


def outside(found: Explained) -> Suspect | None:
    """The free curve that follows the residual, if that is the most probable; else None."""
    first = found.sets[-1][0]
    return first.suspect if first.name == OUTSIDE else None


def built(
    study: Study, forms: Sequence[Form], amplitude: Vector
) -> tuple[list[ModelledRecord], Drive, Added]:
    """Courses, model and additions to it, by the amplitudes of a fit of these forms.

    Parameters
    ----------
    amplitude : ndarray, shape (columns,)
        Amplitudes of values, then of each form's own columns.
    """
    model, names = study.model, study.values
    change = dict(zip(names, amplitude.tolist(), strict=False))
    values = {n: model.values[n] * (1.0 + change[n]) for n in model.adjustable}
    off = {n: c for n, c in change.items() if n not in values}
    courses = recalibrated(study.courses, off)
    added = Added.nothing(study.courses)
    for form, mine in own_amplitudes(study, forms, amplitude):
        added = added.more(form.shape, mine)
    return courses, model.changed(values), added


def own_amplitudes(
    study: Study, forms: Sequence[Form], amplitude: Vector
) -> Iterator[tuple[Form, Vector]]:
    """Forms that have amplitudes of their own, with these, of a fit of all the forms."""
    at = len(study.values)
    for form in forms:
        if not form.freed:
            yield form, amplitude[at : at + len(form.columns)]
            at += len(form.columns)
