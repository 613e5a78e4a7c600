"""A suspect for the result: its numbers, their intervals and units, and its size in newtons."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from scipy.stats import t as student

from .causes import CAUSES
from .diagnosis import FoundCause, Level, SuspectFound
from .drive import Drive
from .explained import Explained
from .held_out import HeldOut
from .residuals import Residual
from .scores import Suspect, own_columns
from .sets import Likely
from .signals import CURRENT_GAIN, SIGNALS
from .study import Study

Numbers = dict[str, float]
Ends = dict[str, tuple[float, float]]

_EXACT = 0.04  # smallest relative error of a size: laws and shapes are not exact
_OUTSIDE_SAYS = (
    "an unknown cause, not in the catalogue: friction or force that only a free curve describes"
)
_AGAIN = "repeat the same motion: does the error repeat?"


def level(held: HeldOut, name: str) -> Level:
    """Residual of one of the models "prior", "none" and "all"."""
    found: Residual = getattr(held, name)
    return Level(found.force_rms, held.position(name))


def suspect_found(found: Explained, member: Likely, friction: float) -> SuspectFound:
    """A member of a set as a result; `friction` is the root mean square friction [N]."""
    suspect = member.suspect
    assert suspect is not None
    force = found.catalogue.force_of(suspect)
    entry = CAUSES.get(member.name) or SIGNALS.get(member.name)
    values, intervals = ({}, {}) if entry is None else _values(found.study, suspect)
    return SuspectFound(
        name=member.name,
        says=entry.says if entry else _OUTSIDE_SAYS,
        probability=member.probability,
        parameters=values,
        intervals=intervals,
        units=_units(member.name, values, found.study.model),
        force=force,
        of_friction=force / friction,
        confirm=entry.confirm if entry else _AGAIN,
    )


def found_cause(found: Explained, held: HeldOut, member: Likely, friction: float) -> FoundCause:
    """An included cause, and its gain on held-out data."""
    before = held.without[member.name]
    gain, interval = held.gain(before, held.all)
    return FoundCause(
        **vars(suspect_found(found, _as_fitted(found, member), friction)),
        certain=member.certain,
        gain_heldout=gain,
        gain_interval=interval,
        gain_alone=held.gain(held.none, held.alone[member.name])[0],
        before=before.force_rms,
        after=held.all.force_rms,
    )


def _as_fitted(found: Explained, member: Likely) -> Likely:
    """The member with its amplitudes when all named causes are included."""
    suspect, forms = member.suspect, found.forms
    assert suspect is not None
    form = suspect.form
    fit = found.catalogue.without([f for f in forms if f is not form] + [form])
    own = own_columns(form)
    amplitude, error = fit.amplitude[0][own], fit.error[0][own]
    changed = Suspect(**{**vars(suspect), "amplitude": amplitude, "error": error})
    return Likely(member.name, member.probability, changed)


def _values(study: Study, suspect: Suspect) -> tuple[Numbers, Ends]:
    """Values and their 95 % intervals, computed by leaving out one block at a time."""
    wide = float(student.ppf(0.975, len(suspect.by_block) - 1))
    shape = suspect.form.shape
    values: Numbers = {}
    intervals: Ends = {}
    if shape.sure is not None:
        off = abs(math.log(max(float(suspect.amplitude[0]), 0.1)))
        off = min(off + wide * float(suspect.error[0]) + suspect.doubt + _EXACT, 3.0)
        for name, value in shape.values.items():
            values[name] = value
            if value == 0.0:
                continue  # this form does not have the effect; zero is not a size
            ends = value * math.exp(-off), value * math.exp(off)
            intervals[name] = (min(ends), max(ends))
        return values, intervals
    names = shape.freed or shape.amplitudes
    for name, size, error in zip(names, suspect.amplitude, suspect.error, strict=True):
        told, says = _told(study, suspect.name, name)
        reach = wide * float(error) + _EXACT * abs(float(size))
        ends = told(float(size) - reach), told(float(size) + reach)
        values[says] = told(float(size))
        intervals[says] = (min(ends), max(ends))
    beside = {n: float(v) for n, v in shape.values.items() if n not in values}
    return values | beside, intervals


def _told(study: Study, suspect: str, name: str) -> tuple[Callable[[float], float], str]:
    """Function from an amplitude to the reported value, and the name of that value."""
    course = study.courses[0]
    factors: dict[str, Callable[[float], float]] = {
        "scale_of_u": lambda size: 1.0 + size,
        "scale_of_i": lambda size: 1.0 + course.calibration[CURRENT_GAIN] + size,
        "scale_of_x": lambda size: 1.0 + size,
    }
    if suspect in factors:  # ratio of the true signal to the recorded one
        return factors[suspect], suspect
    if name in study.model.values and name in study.values:
        value = study.model.values[name]
        return lambda size: value * (1.0 + size), name
    return lambda size: size, name


def _units(name: str, values: Mapping[str, float], model: Drive) -> dict[str, str]:
    if name not in CAUSES:
        return dict.fromkeys(values, "1")
    known = model.units | {p.name: p.unit for p in CAUSES[name].parameters}
    return {n: known[n.partition(".")[0]] for n in values}
