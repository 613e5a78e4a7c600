"""The suspects of a study with their sizes, for an answer that is a set and not one name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from ..records.bad_record import BadRecord
from ..records.drive_record import DriveRecord
from .causes import CAUSES
from .diagnosis import SuspectFound
from .drive_model import DriveModel
from .found_cause import UNITS
from .modelled_record import opposing
from .residuals import rms
from .scores import OUTSIDE, Catalogue, Study, Suspect, refined, scored, study_of
from .sets import NOTHING, Likely, likely
from .signals import SIGNALS

Vector = npt.NDArray[np.float64]

_OUTSIDE_SAYS = (
    "something that no cause of the catalogue is: friction or force that only a free curve follows"
)
_LEAST_FACTOR = 1e-3


@dataclass(frozen=True)
class Suspicion:
    """What the scores say of a study.

    Attributes
    ----------
    suspects : tuple of SuspectFound
        The smallest set that holds the truth with 95 %, the likeliest first, without `none`; empty
        where `none` is the likeliest.
    none_likely : bool
        Whether that there is nothing is in the set.
    none_ruled_out : bool
        Whether of a hundred faultless records at most two look like this.
    because : str
        Why there are none; empty if that is not so.
    """

    suspects: tuple[SuspectFound, ...]
    none_likely: bool
    none_ruled_out: bool
    because: str = ""


def suspicion(records: Sequence[DriveRecord], prior_model: DriveModel) -> Suspicion:
    """The suspects of records whose command the model takes, see `commanded`."""
    try:
        study = study_of(records, prior_model)
    except BadRecord as error:  # too short for blocks and bands; the search says whether at all
        return Suspicion((), True, False, f"no suspects are told: {error}")
    catalogue = Catalogue(study)
    members, ruled_out = likely(scored(study, catalogue))
    told = [m for m in members if m.name != NOTHING and m.suspect is not None]
    if members[0].name == NOTHING:
        told = []  # a list of what is possible all the same would be no answer
    friction = rms(np.concatenate([opposing(c, study.model)[~c.rests] for c in study.courses]))
    return Suspicion(
        tuple(_found(study, catalogue, m, friction) for m in told),
        any(m.name == NOTHING for m in members),
        ruled_out,
    )


def _found(study: Study, catalogue: Catalogue, member: Likely, friction: float) -> SuspectFound:
    assert member.suspect is not None
    if member.name == OUTSIDE:
        suspect, says, confirm = (
            member.suspect,
            _OUTSIDE_SAYS,
            "the same motion again: does it repeat?",
        )
        values: tuple[dict[str, float], dict[str, tuple[float, float]]] = ({}, {})
    else:
        suspect = refined(study, catalogue, member.suspect)
        entry = CAUSES.get(member.name) or SIGNALS[member.name]
        says, confirm = entry.says, entry.confirm
        values = _values(study, suspect)
    force = catalogue.force_of(suspect)
    return SuspectFound(
        member.name, says, member.probability, *values, _units(member.name, values[0]),
        force, force / max(friction, 1e-300), confirm,
    )  # fmt: skip


def _values(
    study: Study, suspect: Suspect
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Sizes and their intervals."""
    wide = float(student.ppf(0.975, len(suspect.by_block) - 1))
    shape = suspect.form.shape
    values, intervals = {}, {}
    if shape.sure is not None:
        off = abs(math.log(max(float(suspect.amplitude[0]), 0.1)))
        off = min(off + wide * float(suspect.error[0]) + suspect.doubt, 3.0)
        for name, value in shape.values.items():
            values[name] = value
            if value == 0.0:
                continue  # a form without this, and no size
            ends = value * math.exp(-off), value * math.exp(off)
            intervals[name] = (min(ends), max(ends))
        return values, intervals
    names = shape.freed or shape.amplitudes
    for name, size, error in zip(names, suspect.amplitude, suspect.error, strict=True):
        told, says = _told(study, suspect.name, name)
        reach = wide * float(error)
        ends = told(float(size) - reach), told(float(size) + reach)
        values[says] = told(float(size))
        intervals[says] = (min(ends), max(ends))
    beside = {n: float(v) for n, v in shape.values.items() if n not in values}
    return values | beside, intervals


def _told(study: Study, suspect: str, name: str) -> tuple[Callable[[float], float], str]:
    """How an amplitude is told: a function of it, and the name of what comes out."""
    factors: dict[str, Callable[[float], float]] = {
        # balances are told in the recorded command, see `Signal.relative`
        "scale_of_u": lambda size: 1.0 / max(1.0 - size, _LEAST_FACTOR),
        "scale_of_i": lambda size: 1.0 / max(1.0 + size, _LEAST_FACTOR),
        "scale_of_x": lambda size: 1.0 + size,
    }
    if suspect in factors:  # by which the true signal is larger than the recorded one
        return factors[suspect], suspect
    if name in study.model.values and name in study.values:
        value = study.model.values[name]
        return lambda size: value * (1.0 + size), name
    return lambda size: size, name


def _units(name: str, values: Mapping[str, float]) -> dict[str, str]:
    known = {p.name: p.unit for p in CAUSES[name].parameters} if name in CAUSES else {}
    return {n: known.get(n.partition(".")[0], UNITS.get(n, "1")) for n in values}
