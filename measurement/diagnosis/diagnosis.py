"""The result of a diagnosis: errors, causes, their certainty, and the next experiment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from ...solver.arrays import Mask, Vector
from ...solver.files import finite_or_null, write_json
from .causes import CAUSES, EVERY
from .causes.command import CURRENT_GAIN
from .experiment import NextExperiment
from .fit import Study
from .model import Drive
from .rule import Explained
from .scores import Hypothesis, own_columns

Verdict = Literal["none", "explained", "partly", "unexplained", "undecided"]
ANSWERED = ("none", "explained")  # verdicts with exit code 0; with the others it is 1

_EXACT = 0.04  # smallest relative error of a size: laws and shapes are not exact
_OUTSIDE = (
    "an unknown cause, not in the catalogue: friction or force that only a free curve describes"
)
_AGAIN = "repeat the same motion: does the error repeat?"


@dataclass(frozen=True)
class Level:
    """A residual in the two domains, root mean square."""

    force: float  # at frequencies at which the record gives forces [N]
    position: float | None  # of the prediction from the start of each second, if known [m]

    def to_dict(self) -> dict[str, float | None]:
        """Its content in `diagnosis.json`."""
        return {"force_N": self.force, "position_m": self.position}


def holds(gain_interval: tuple[float, float], before: Level, after: Level) -> bool:
    """Whether the corrected model is certainly better on held-out data than the one before.

    The lower end of the removed share of the mean square in force is above zero, and the residual
    in position does not grow.
    """
    better = gain_interval[0] > 0.0
    if before.position is None or after.position is None:
        return better
    return better and after.position <= before.position


@dataclass(frozen=True)
class Finding:
    """A cause that is built in, or one that may be true in its place or beside it."""

    name: str
    says: str
    alike: tuple[str, ...]  # others of its entry of the catalogue that explain as much: one answer
    score: float  # gain in the log-likelihood of held-out blocks [nats]
    lead: float  # score less that of the best one of another entry [nats]
    share: float  # removed share of the squares on held-out blocks, when it was found
    parameters: Mapping[str, float]  # its values, SI; empty for one outside the catalogue
    intervals: Mapping[str, tuple[float, float]]  # 95 %, by leaving out one block at a time
    units: Mapping[str, str]
    force: float  # rms effect on a balance of forces, or of voltages converted to a force [N]
    of_friction: float  # the same as a share of the friction
    confirm: str  # experiment that would confirm it
    certain: bool  # whether it is named
    gain_heldout: float  # share that it removes from its balance, beside the other causes
    gain_interval: tuple[float, float]  # 90 %, by leaving out one block at a time


@dataclass(frozen=True)
class Curves:
    """Signals along the records, end to end, shape (n,) each."""

    time: Vector  # within each record [s]
    record: npt.NDArray[np.int64]  # number of the record
    x: Vector  # [m]
    v: Vector  # [m/s]
    force: Vector  # friction and all other opposing forces, by the record [N]
    predicted: Vector  # the same by the prior model [N]
    before: Vector  # force residual of the prior model [N]
    after: Vector  # force residual of the corrected model [N]
    position_before: Vector  # position residual of the prior model; NaN if not known [m]
    position_after: Vector  # position residual of the corrected model, held out [m]
    cause: Vector  # force of the named causes together [N]
    shape: Vector  # force without a known cause; NaN where forces are not known [N]
    telling: Mask  # samples at which forces are known


@dataclass(frozen=True)
class Diagnosis:
    """Errors of a model on records, their causes, and the next experiment.

    Of the residuals, `baseline_residual` is that of the prior model, `adjusted_residual` that with
    values adjusted within their tolerances, `final_residual` that with the causes; the last two are
    on held-out data.
    """

    verdict: Verdict
    floor: Level  # residual of noise
    baseline_residual: Level
    adjusted_residual: Level
    final_residual: Level
    friction: float  # root mean square along the records [N]
    unseen: float  # largest fault that would not be seen: twice the noise, or what is left
    gain_interval: tuple[float, float]  # 90 %, of the removed share of the squares
    held_out: str  # what was held out, one at a time: "4 laps", "5 parts"
    causes: tuple[Finding, ...]  # included, also errors of signals, in the order of finding
    suspects: tuple[Finding, ...]  # in addition to or instead of those, the best one first
    alternatives: Mapping[str, tuple[str, ...]]  # suspects that explain as much as a cause
    unnamed: tuple[str, ...]  # how a residual without a known cause varies
    next_experiment: NextExperiment | None
    prior: Drive
    adjusted: Drive  # within the tolerances, and no cause
    corrected: Drive  # values fitted together with the causes
    command: str  # kind of the records' `u`
    command_shift: float  # the command acts before its stamp by this, in sampling intervals
    adjustments: Mapping[str, float]  # relative changes of the prior values
    noise: Mapping[str, float]  # rms residual of each balance due to noise [N]
    records: tuple[str, ...]
    curves: Curves
    seconds: float  # computing time [s]
    notes: tuple[str, ...] = field(default_factory=tuple)  # warnings

    @property
    def confirmed(self) -> bool:
        """Whether what is built in is certainly better on held-out data."""
        levels = self.adjusted_residual, self.final_residual
        return not self.causes or holds(self.gain_interval, *levels)

    def to_dict(self) -> dict[str, Any]:
        """Content of ``diagnosis.json``."""
        told = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _APART}
        for name, value in told.items():
            if isinstance(value, Level | NextExperiment):
                told[name] = value.to_dict()
        lists = {n: [vars(c) for c in told[n]] for n in ("causes", "suspects")}
        plain: dict[str, Any] = finite_or_null(told | lists)
        return plain

    def found(self) -> list[tuple[str, dict[str, float]]]:
        """Names and values of the plant's causes, as input of `with_causes`."""
        return [(c.name, dict(c.parameters)) for c in self.causes if c.name in CAUSES]

    def save(self, folder: Path) -> None:
        """Write ``diagnosis.json`` and the commands of the next experiment; see `write_json`."""
        write_json(folder / "diagnosis.json", self.to_dict())
        if self.next_experiment is not None:
            self.next_experiment.save(folder)


_APART = ("prior", "adjusted", "corrected", "command", "command_shift", "curves")
"""Fields of a `Diagnosis` that are written to other files."""


# -- a hypothesis as a result --------------------------------------------------------------------


def finding(found: Explained, h: Hypothesis, friction: float) -> Finding:
    """A hypothesis with its values and sizes; `friction` is the root mean square friction [N]."""
    gain = h.gain
    if any(h is b for b in found.built):
        others = [f for f in found.forms if f is not h.form]
        fit, own = found.catalogue.without([*others, h.form]), own_columns(h.form)
        h = replace(h, amplitude=fit.amplitude[0][own], error=fit.error[0][own])
        gain = found.gain(others)
    cause, force = EVERY.get(h.name), found.catalogue.force_of(h)
    values, intervals = _values(found.study, h) if cause else ({}, {})
    units = dict.fromkeys(values, "1")
    if h.name in CAUSES:
        known = found.study.model.units | {p.name: p.unit for p in CAUSES[h.name].parameters}
        units = {n: known[n.partition(".")[0]] for n in values}
    return Finding(
        name=h.name,
        says=cause.says if cause else _OUTSIDE,
        alike=h.alike,
        score=h.score,
        lead=h.lead,
        share=h.gain.share,
        parameters=values,
        intervals=intervals,
        units=units,
        force=force,
        of_friction=force / friction,
        confirm=cause.confirm if cause else _AGAIN,
        certain=h.certain,
        gain_heldout=gain.share,
        gain_interval=gain.interval,
    )


def _values(study: Study, h: Hypothesis) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Values and their 95 % intervals, computed by leaving out one block at a time."""
    wide = float(student.ppf(0.975, len(study.bands.parts) - 1))
    form, values, intervals = h.form, {}, {}
    if form.sure is not None:
        off = abs(math.log(max(float(h.amplitude[0]), 0.1)))
        off = min(off + wide * float(h.error[0]) + h.doubt + _EXACT, 3.0)
        for name, value in form.values.items():
            if value != 0.0:  # else this form does not have the effect; zero is not a size
                ends = sorted((value * math.exp(-off), value * math.exp(off)))
                intervals[name] = (ends[0], ends[1])
        return dict(form.values), intervals
    for name, size, error in zip(
        form.freed or form.amplitudes, h.amplitude.tolist(), h.error.tolist(), strict=True
    ):
        reported, says = _reported(study, h.name, name)
        reach = wide * error + _EXACT * abs(size)
        ends = sorted((reported(size - reach), reported(size + reach)))
        values[says], intervals[says] = reported(size), (ends[0], ends[1])
    return values | {n: float(v) for n, v in form.values.items() if n not in values}, intervals


def _reported(study: Study, suspect: str, name: str) -> tuple[Callable[[float], float], str]:
    """Function from an amplitude to the reported value, and the name of that value."""
    if suspect in ("scale_of_u", "scale_of_i", "scale_of_x"):  # the true signal over the recorded
        known = study.courses[0].calibration[CURRENT_GAIN] if suspect == "scale_of_i" else 0.0
        return lambda size: 1.0 + known + size, suspect
    if name in study.model.values and name in study.values:
        value = study.model.values[name]
        return lambda size: value * (1.0 + size), name
    return lambda size: size, name
