"""Diagnosis of a drive's model from records: its errors, their causes, and the next experiment."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

from ...orchestration.loop.parameter_file import TURNS
from ...solver.arrays import Mask, Vector
from ...solver.files import finite_or_null, write_json
from ..records.examine import check_identifiable
from ..records.record import Record
from .balance import residual
from .causes import CAUSES, EVERY
from .causes.command import CURRENT_GAIN
from .experiment import NextExperiment, next_experiment
from .fit import Study, study_of
from .held_out import HeldOut, Level, Verdict, held_out, holds
from .model import TOLERANCE, Drive, commanded
from .motion import jumps_of, opposing
from .rule import built, explained
from .scores import Hypothesis, own_columns

ANSWERED = ("none", "explained")  # verdicts with exit code 0; with the others it is 1

_OUTSIDE = (
    "an unknown cause, not in the catalogue: friction or force that only a free curve describes"
)
_AGAIN = "repeat the same motion: does the error repeat?"


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
    notes: tuple[str, ...]  # warnings

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


def diagnose_records(
    records: Sequence[Record],
    prior_model: Drive,
    progress: Callable[[str], None] = lambda doing: None,
    take: str | None = None,
) -> Diagnosis:
    """Find the errors of a simulation of recorded runs.

    `take` is a cause to include in the model in any case; its gain is measured like that of any
    other. `prior` of the result has the records' command. Raises `BadRecord`.
    """
    began = time.perf_counter()
    records, prior_model, notes = commanded(records, prior_model)
    notes += [TURNS] * prior_model.turns + check_identifiable(records)
    progress("fitting values")
    study = study_of(records, prior_model)
    progress("searching for causes")
    found = explained(study, take)
    progress("testing on held-out data")
    held = held_out(found)
    (courses, corrected), names = found.corrected, prior_model.adjustable
    done = held.verdict == "explained" and not held.alternatives
    quiet = not (found.built or held.something or found.doubtful)
    noise = {"force_N": held.floor.force}
    if courses[0].has_current:
        noise["voltage_N"] = held.floor.by_current
    return Diagnosis(
        verdict=held.verdict,
        floor=held.level("noise"),
        baseline_residual=held.level("prior"),
        adjusted_residual=held.level("none"),
        final_residual=held.level("all"),
        friction=held.friction,
        unseen=held.unseen,
        gain_interval=held.gain_interval,
        held_out=f"{len(study.bands.blocks)} parts",
        causes=tuple(_finding(held, h) for h in found.built),
        suspects=tuple(_finding(held, h) for h in found.suspects),
        alternatives=held.alternatives,
        unnamed=(found.outside.form.lives,) if found.outside else (),
        next_experiment=None if done else next_experiment(found, quiet),
        prior=prior_model,
        adjusted=built(study, [], found.catalogue.without([]).amplitude[0])[1],
        corrected=corrected,
        command=records[0].command,
        command_shift=courses[0].calibration["command_shift"],
        adjustments={n: corrected.values[n] / prior_model.values[n] - 1.0 for n in names},
        noise=noise,
        records=tuple(r.name for r in records),
        curves=_curves(held, prior_model),
        seconds=time.perf_counter() - began,
        notes=(*notes, *jumps_of(study.courses), *_notes(held)),
    )


def _curves(held: HeldOut, prior_model: Drive) -> Curves:
    free, (courses, corrected) = held.found.outside, held.found.corrected
    predicted = np.concatenate([opposing(c, prior_model) for c in courses])
    along = held.found.study.courses
    unnamed = free.form.added_to(along, free.amplitude) if free else along
    shape = np.concatenate([c.added_force for c in unnamed])
    return Curves(
        time=np.concatenate([c.time for c in courses]),
        record=np.repeat(np.arange(len(courses)), [len(c.x) for c in courses]),
        x=np.concatenate([c.x for c in courses]),
        v=np.concatenate([c.v for c in courses]),
        force=predicted + held.prior.force,
        predicted=predicted,
        before=held.prior.force,
        after=residual(courses, corrected).force,
        position_before=held.positions["prior"],
        position_after=held.positions["all"],
        cause=np.concatenate([c.added_force for c in courses]),
        shape=np.where(held.prior.telling, shape, np.nan),
        telling=held.prior.telling,
    )


def _notes(held: HeldOut) -> Iterator[str]:
    found, left, floor = held.found, held.all, held.floor
    study = found.study
    if held.unrepeated:
        yield (
            f"the residual, {left.force_rms:.3g} N, is more than twice {floor.force:.3g} N, the "
            "noise from differences between laps and the uncertain motion: a part of it may have "
            "a cause"
        )
    if held.contradicts:
        yield (
            "the motor's forces computed from the voltage and from the current differ by "
            f"{left.by_current_rms:.3g} N, but noise only makes {floor.by_current:.3g} N: check "
            "the units and signs of u and i, and the values of R and ke"
        )
    if own := [f"{c.own_offset:+.3g} N in {c.record.name}" for c in study.courses if c.offset_name]:
        yield f"additional offsets to that of {study.courses[0].record.name}: {', '.join(own)}"
    if ends := study.at_ends(found.fit.amplitude[0]):
        yield (
            f"at their limit: {', '.join(ends)}. A tolerance is too narrow, "
            "or they compensate for an unknown cause"
        )
    if held.why:
        yield f"no position is predicted: {held.why}"
    for first in found.doubtful[:1]:
        yield (
            f"the best score is {first.score:.0f}, of {first.name} with "
            f"{100 * first.gain.share:.2g} % of the squares: above noise, but too low to be found"
        )


# -- a hypothesis as a result --------------------------------------------------------------------


def _finding(held: HeldOut, h: Hypothesis) -> Finding:
    """A hypothesis with its values and sizes."""
    found, gain = held.found, h.gain
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
        of_friction=force / held.friction,
        confirm=cause.confirm if cause else _AGAIN,
        certain=h.certain,
        gain_heldout=gain.share,
        gain_interval=gain.interval,
    )


def _values(study: Study, h: Hypothesis) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Values and 95 % intervals by leaving out one block at a time, and by a value's tolerance."""
    wide = float(stdtrit(len(study.bands.blocks) - 1, 0.975))
    form, values, intervals = h.form, {}, {}
    if form.sure is not None:
        off = abs(math.log(max(float(h.amplitude[0]), 0.1)))
        off = min(off + wide * float(h.error[0]) + h.doubt + TOLERANCE, 3.0)
        for name, value in form.values.items():
            if value != 0.0:  # else this form does not have the effect; zero is not a size
                ends = sorted((value * math.exp(-off), value * math.exp(off)))
                intervals[name] = (ends[0], ends[1])
        return dict(form.values), intervals
    names = form.freed or form.amplitudes
    for name, size, error in zip(names, h.amplitude.tolist(), h.error.tolist(), strict=True):
        reported, says = _reported(study, h.name, name)
        reach = wide * error + TOLERANCE * abs(size)
        ends = sorted((reported(size - reach), reported(size + reach)))
        values[says], intervals[says] = reported(size), (ends[0], ends[1])
    return values | {n: float(v) for n, v in form.values.items() if n not in values}, intervals


def _reported(study: Study, suspect: str, name: str) -> tuple[Callable[[float], float], str]:
    """Function from an amplitude to the reported value, and the name of that value."""
    if suspect in ("scale_of_u", "scale_of_i", "scale_of_x"):  # the true signal over the recorded
        known = study.courses[0].calibration[CURRENT_GAIN] if suspect == "scale_of_i" else 0.0
        return lambda size: 1.0 + known + size, suspect
    if name in study.model.values and name in study.values:
        return lambda size: study.model.values[name] * (1.0 + size), name
    return lambda size: size, name
