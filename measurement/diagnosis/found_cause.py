"""A hypothesis for the result: its numbers, their intervals and units, and its size in newtons."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from scipy.stats import t as student

from .causes import CAUSES, EVERY
from .causes.values import CURRENT_GAIN
from .diagnosis import Finding
from .drive import Drive
from .rule import Explained
from .scores import Hypothesis, own_columns
from .study import Study

Numbers = dict[str, float]
Ends = dict[str, tuple[float, float]]

_EXACT = 0.04  # smallest relative error of a size: laws and shapes are not exact
_OUTSIDE_SAYS = (
    "an unknown cause, not in the catalogue: friction or force that only a free curve describes"
)
_AGAIN = "repeat the same motion: does the error repeat?"


def finding(found: Explained, h: Hypothesis, friction: float) -> Finding:
    """A hypothesis as a result; `friction` is the root mean square friction [N]."""
    gain = h.gain
    if any(h is b for b in found.built):
        others = [f for f in found.forms if f is not h.form]
        fit, own = found.catalogue.without([*others, h.form]), own_columns(h.form)
        h = replace(h, amplitude=fit.amplitude[0][own], error=fit.error[0][own])
        gain = found.gain(others)
    cause = EVERY.get(h.name)
    values, intervals = _values(found.study, h) if cause else ({}, {})
    force = found.catalogue.force_of(h)
    return Finding(
        name=h.name,
        says=cause.says if cause else _OUTSIDE_SAYS,
        alike=h.alike,
        score=h.score,
        lead=h.lead,
        share=h.gain.share,
        parameters=values,
        intervals=intervals,
        units=_units(h.name, values, found.study.model),
        force=force,
        of_friction=force / friction,
        confirm=cause.confirm if cause else _AGAIN,
        certain=h.certain,
        gain_heldout=gain.share,
        gain_interval=gain.interval,
        before=gain.before,
        after=gain.after,
    )


def _values(study: Study, suspect: Hypothesis) -> tuple[Numbers, Ends]:
    """Values and their 95 % intervals, computed by leaving out one block at a time."""
    wide = float(student.ppf(0.975, len(study.bands.parts) - 1))
    form = suspect.form
    values: Numbers = {}
    intervals: Ends = {}
    if form.sure is not None:
        off = abs(math.log(max(float(suspect.amplitude[0]), 0.1)))
        off = min(off + wide * float(suspect.error[0]) + suspect.doubt + _EXACT, 3.0)
        for name, value in form.values.items():
            values[name] = value
            if value == 0.0:
                continue  # this form does not have the effect; zero is not a size
            ends = value * math.exp(-off), value * math.exp(off)
            intervals[name] = (min(ends), max(ends))
        return values, intervals
    names = form.freed or form.amplitudes
    for name, size, error in zip(names, suspect.amplitude, suspect.error, strict=True):
        reported, says = _reported(study, suspect.name, name)
        reach = wide * float(error) + _EXACT * abs(float(size))
        ends = reported(float(size) - reach), reported(float(size) + reach)
        values[says] = reported(float(size))
        intervals[says] = (min(ends), max(ends))
    beside = {n: float(v) for n, v in form.values.items() if n not in values}
    return values | beside, intervals


def _reported(study: Study, suspect: str, name: str) -> tuple[Callable[[float], float], str]:
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
