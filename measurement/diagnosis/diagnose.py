"""Diagnosis of a drive's model from records: errors of the model, and their causes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...orchestration.loop.parameter_file import TURNS, ParameterFile, read_parameters
from ...orchestration.loop.shown import length
from ..records.examine import check_identifiable
from ..records.reading import read_drive_records
from ..records.record import Record
from .balance import Added
from .building import alternatives, explained
from .causes import CAUSES
from .diagnosis import (
    EXPLAINED,
    NONE,
    PARTLY,
    UNDECIDED,
    UNEXPLAINED,
    Curves,
    Diagnosis,
    Level,
    holds,
)
from .drive import Drive, commanded, drive_of
from .explained import Explained, built, outside
from .found_cause import found_cause, level, suspect_found
from .held_out import HeldOut, held_out
from .modelled_record import ModelledRecord, jumps_of, opposing
from .next_experiment import next_experiment
from .noise_floor import AT_FLOOR, NoiseFloor, Remainder, noise_floor, remainder
from .residuals import Residual, residual, rms
from .scores import OUTSIDE
from .study import study_of


def diagnose(
    data: Sequence[Path | str],
    params: Path | str | None = None,
    law: str | None = None,
    mapping: Mapping[str, str] | None = None,
    progress: Callable[[str], None] = lambda doing: None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
    take: str | None = None,
) -> Diagnosis:
    """Find the errors of a simulation of recorded runs, their causes, and the possible improvement.

    Parameters
    ----------
    data : sequence of path-like
        Files of measured data with ``time`` [s], ``u`` [V] and ``x`` [m], perhaps ``i`` [A];
        ``i`` alone is taken as the command, see `commanded`.
    params : path-like, optional
        The prior model, see `drive_of`; the nominal axis by default.
    law : str, optional
        Friction law, instead of the law in the file.
    mapping : mapping of str to str, optional
        Names of columns, from the name in the file to our name.
    progress : function of what is being done, optional
    units : mapping of str to str, optional
        Unit of a column (our name); default: the unit in the file, else SI.
    lead : float, optional
        Lead of the screw, travel per turn [m], if the parameter file has no `p`.
    take : str, optional
        A cause of the catalogue to include in the model in any case; its gain on held-out
        data is measured like that of any other.

    Raises
    ------
    BadRecord, BadParameters
        If an input cannot be used; the message says why in one line.
    """
    told = (ParameterFile() if params is None else read_parameters(params)).with_lead(lead)
    records = read_drive_records(data, mapping, units, lead or told.lead)
    return diagnose_records(records, drive_of(told, law), progress, take)


def diagnose_records(
    records: Sequence[Record],
    prior_model: Drive,
    progress: Callable[[str], None] = lambda doing: None,
    take: str | None = None,
) -> Diagnosis:
    """Like `diagnose`, for records in memory; `prior` of the result has the records' command."""
    began = time.perf_counter()
    records, prior_model, notes = commanded(records, prior_model)
    notes += [TURNS] * prior_model.turns + check_identifiable(records)
    progress("fitting values")
    study = study_of(records, prior_model)
    progress("searching for causes")
    found = explained(study, take)
    progress("testing on held-out data")
    held = held_out(found)
    corrected = _corrected(found)
    lowest = noise_floor(found, corrected.left, held.position("noise"))
    friction = _friction(study.courses, study.model, held)
    causes = tuple(found_cause(found, held, m, friction) for m in found.built)
    suspects = tuple(suspect_found(found, m, friction) for m in found.suspects)
    _, interval = held.gain(held.none, held.all)
    before, fitted, final = (level(held, name) for name in ("prior", "none", "all"))
    remains = remainder(found, held.all, lowest, friction)
    better = holds(interval, fitted, final)
    settled = better and not remains.something and not remains.hidden
    either = alternatives(found, held) if settled else {}
    verdict = _verdict(found, remains, better, either)
    free = outside(found) if verdict in (PARTLY, UNEXPLAINED) else None
    notes += jumps_of(study.courses) + _notes(found, held, lowest)
    if held.why:
        notes.append(f"no position is predicted: {held.why}")
    first = found.sets[-1][0]
    if verdict == NONE and first.suspect:
        size = f"; --take {first.name} gives its size" if first.name in CAUSES else ""
        notes.append(
            f"the most probable is {first.name}, {100 * first.probability:.0f} %, but 3 in "
            f"100 faultless records look like this or worse{size}"
        )
    quiet = not found.built and not remains.something
    done = verdict == EXPLAINED and not either
    suspects = () if verdict == NONE else suspects
    return Diagnosis(
        verdict=verdict,
        where=_where(before, lowest.level),
        floor=lowest.level,
        baseline_residual=before,
        adjusted_residual=fitted,
        final_residual=final,
        friction=friction,
        left_of_friction=max(final.force, held.all.by_current_rms) / friction,
        unseen=remains.unseen,
        gain_interval=interval,
        held_out=held.parts,
        causes=causes,
        suspects=suspects,
        alternatives=either,
        unnamed=(free.form.lives,) if free else (),
        next_experiment=None if done else next_experiment(found, quiet),
        prior=prior_model,
        adjusted=built(study, [], found.catalogue.without([]).amplitude[0])[1],
        corrected=corrected.model,
        command=records[0].command,
        command_shift=corrected.courses[0].calibration["command_shift"],
        adjustments={
            n: corrected.model.values[n] / prior_model.values[n] - 1.0
            for n in prior_model.adjustable
        },
        noise=lowest.told(study.courses[0].channels),
        records=tuple(r.name for r in records),
        curves=_curves(study.courses, prior_model, held, corrected),
        seconds=time.perf_counter() - began,
        notes=tuple(notes),
    )


def _verdict(
    found: Explained, remains: Remainder, better: bool, either: Mapping[str, tuple[str, ...]]
) -> str:
    """Verdict from what is left, and from whether the causes are certain.

    A cause with one alternative explains the error, too, if only noise is left with either.
    """
    certain = [m.certain for m in found.built]
    if better and not remains.something and not remains.hidden and found.built:
        if sum(map(len, either.values())) <= 1 and OUTSIDE not in sum(either.values(), ()):
            return EXPLAINED
        return PARTLY if any(certain) else UNDECIDED
    if any(certain):
        return PARTLY
    if remains.something or (found.built and not better):
        return UNEXPLAINED
    return UNDECIDED if remains.hidden else NONE


@dataclass(frozen=True)
class _Corrected:
    """The corrected model, its residual on all data, and the forces missing in the prior model.

    `unnamed` is a free curve through the residual.
    """

    courses: list[ModelledRecord]
    model: Drive
    left: Residual
    named: Added
    unnamed: Added


def _corrected(found: Explained) -> _Corrected:
    study, forms = found.study, found.forms
    amplitude = found.fit.amplitude[0]
    courses, model, named = built(study, forms, amplitude)
    free, nothing = outside(found), Added.nothing(courses)
    unnamed = nothing.more(free.form.shape, free.amplitude) if free else nothing
    left = residual(courses, model, named)
    return _Corrected(courses, model, left, named, unnamed)


def _curves(
    courses: Sequence[ModelledRecord],
    prior_model: Drive,
    held: HeldOut,
    corrected: _Corrected,
) -> Curves:
    predicted = np.concatenate([opposing(c, prior_model) for c in courses])
    return Curves(
        time=np.concatenate([c.time for c in courses]),
        record=np.repeat(np.arange(len(courses)), [len(c.x) for c in courses]),
        x=np.concatenate([c.x for c in courses]),
        v=np.concatenate([c.v for c in courses]),
        force=predicted + held.prior.force,
        predicted=predicted,
        before=held.prior.force,
        after=corrected.left.force,
        position_before=held.positions["prior"],
        position_after=held.positions["all"],
        cause=np.concatenate(corrected.named.force),
        shape=np.where(held.prior.telling, np.concatenate(corrected.unnamed.force), np.nan),
        telling=held.prior.telling,
    )


def _friction(courses: Sequence[ModelledRecord], model: Drive, held: HeldOut) -> float:
    """Root mean square of the friction over samples at which forces are known [N]."""
    along = np.concatenate([opposing(c, model) for c in courses])
    return max(rms(along[held.all.telling]), 1e-300)


# -- sentences -------------------------------------------------------------------------------


def _where(baseline: Level, lowest: Level) -> str:
    """How large the residual is, in one sentence."""
    size = (
        f"The prior model leaves {baseline.force:.3g} N rms in force (noise alone: "
        f"{lowest.force:.3g} N)"
    )
    if baseline.position is not None and lowest.position is not None:
        size += (
            f" and {length(baseline.position)} in position over a second "
            f"({length(lowest.position)})"
        )
    return f"{size}."


def _notes(found: Explained, held: HeldOut, lowest: NoiseFloor) -> list[str]:
    study, left = found.study, held.all
    notes = []
    if lowest.repeated and left.force_rms > AT_FLOOR * lowest.force:
        notes.append(
            f"the residual, {left.force_rms:.3g} N, is more than twice {lowest.force:.3g} N, the "
            "noise from differences between laps and the uncertain motion: a part of it may have "
            "a cause"
        )
    elif found.none_ruled_out:
        notes.append("the residual is not like noise: of 100 faultless records 97 look better")
    if not lowest.has_current(left):
        notes.append(
            "the motor's forces computed from the voltage and from the current differ by "
            f"{left.by_current_rms:.3g} N, but noise only makes {lowest.by_current:.3g} N: check "
            "the units and signs of u and i, and the values of R and ke"
        )
    own = [f"{c.own_offset:+.3g} N in {c.record.name}" for c in study.courses if c.offset_name]
    if own:
        notes.append(
            f"additional offsets to that of {study.courses[0].record.name}: {', '.join(own)}"
        )
    ends = study.at_ends(found.fit.amplitude[0])
    if ends:
        notes.append(
            f"at their limit: {', '.join(ends)}. A tolerance is too narrow, "
            "or they compensate for an unknown cause"
        )
    return notes
