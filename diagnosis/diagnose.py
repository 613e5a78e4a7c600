"""Given records of a drive and the model its user believes: what is wrong with it, and why."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..orchestration.parameter_file import ParameterFile
from ..orchestration.parameter_reading import read_parameters
from ..records.bad_record import BadRecord
from ..records.drive_record import DriveRecord, read_drive_records
from ..records.identifiable import check_identifiable
from .acceptance import SWINGS, Accepted, accepted, taken_back
from .balance import Added
from .causes import CAUSES
from .commanded import commanded
from .contests import freest_beside
from .diagnosis import EXPLAINED, NONE, PARTLY, UNEXPLAINED, Curves, Diagnosis, holds
from .drive_model import DriveModel
from .explanation import amplitudes, nothing_in
from .faultless import RecordKind, p_value
from .found_cause import found_cause, level
from .held_out import HeldOut, gained, gained_ahead, judged, laps_of, parts_of, with_values
from .load_cell import validation_signal
from .modelled_record import ModelledRecord, opposing
from .noise_floor import noise_floor
from .nonparametric import LIVES
from .plausibility import at_ends
from .prior_model import lead_of, prior_model_from, with_lead
from .problem import Candidate, Problem, driven_by, values_alone
from .remaining import above_floor, below_floor, next_experiment, out_of_reach, where_residual_is
from .residuals import Residual, after_the_start, residual, rms
from .search import Found, Situation, added_by, adjusted, only_first, search, taking
from .selection import strongest_alone
from .suspicion import Suspicion, suspicion


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
    """What a simulation of recorded runs gets wrong, why, and how much better it can be.

    Parameters
    ----------
    data : sequence of path-like
        CSV, MAT or Parquet files with ``time`` [s], ``u`` [V] and ``x`` [m], perhaps ``i`` [A];
        ``i`` alone is taken as the command, see `commanded`.
    params : path-like, optional
        The prior model, see `read_prior_model`; the nominal axis by default.
    law : str, optional
        Friction law, in place of the file's.
    mapping : mapping of str to str, optional
        ``theirs -> ours`` names of columns.
    progress : function of what is being done, optional
    units : mapping of str to str, optional
        Unit of a column (our name); default what the file says, else SI.
    lead : float, optional
        Way of the screw per turn [m], where the parameter file has no `p`.
    take : str, optional
        A cause of the catalogue to be built in, whatever the data say for it; what it gains on
        data held out is measured as of any other.

    Raises
    ------
    BadRecord, BadParameters
        With one line that says what cannot be used and why.
    """
    told = with_lead(ParameterFile() if params is None else read_parameters(params), lead)
    records = read_drive_records(data, mapping, units, lead_of(told, lead))
    return diagnose_records(records, prior_model_from(told, law), progress, take)


def diagnose_records(
    records: Sequence[DriveRecord],
    prior_model: DriveModel,
    progress: Callable[[str], None] = lambda doing: None,
    take: str | None = None,
) -> Diagnosis:
    """As `diagnose`, of records in memory; `prior` of the result takes the command they have."""
    began = time.perf_counter()
    records, prior_model, notes = commanded(records, prior_model)
    notes += check_identifiable(records)
    progress("looking for suspects")
    suspects = suspicion(records, prior_model)
    notes += [suspects.because] if suspects.because else []
    progress("looking for causes")
    found = search(records, prior_model)
    progress("judging on data held out")
    found, judgement = _standing(prior_model, found)
    if take is not None:
        found, judgement = _taken(prior_model, found, judgement, take)
    return _concluded(records, prior_model, found, judgement, suspects, notes, began)


class _Judgement(NamedTuple):
    """What of an explanation data held out let stand."""

    holds_up: Accepted
    held: HeldOut
    baseline: Residual
    laps: list[float]


def _taken(
    prior_model: DriveModel, found: Found, before: _Judgement, name: str
) -> tuple[Found, _Judgement]:
    """The end of a search with this cause in it, and what it gains.

    Raises
    ------
    BadRecord
        If these records cannot show the cause.
    """
    after = taking(found, prior_model, (name,))
    if after is None:
        why = CAUSES[name].beyond(found.situation.courses, prior_model) or "no form of it fits"
        raise BadRecord(f"these records cannot show {name}: {why}")
    situation, problem, best = after.situation, after.problem, after.choice.best
    laps = laps_of(situation.courses)
    folds = parts_of(situation.courses, laps)
    freest, _ = freest_beside(problem, best, folds)
    refused = tuple(r for r in before.holds_up.refused if r.name != name)
    holds_up = Accepted(best, refused, freest)
    held = judged(situation, problem, best, folds, bool(laps))
    baseline = residual(situation.courses, prior_model, Added.nothing(situation.courses))
    return after, _Judgement(holds_up, held, baseline, laps)


def _judgement(prior_model: DriveModel, found: Found) -> _Judgement:
    """Take names back until what is left gains for certain, each of them and all together."""
    situation, problem = found.situation, found.problem
    courses = situation.courses
    laps = laps_of(courses)
    folds = parts_of(courses, laps)
    holds_up = accepted(problem, found.choice.best, folds, courses)
    held = judged(situation, problem, holds_up.explanation, folds, bool(laps))
    baseline = residual(courses, prior_model, Added.nothing(courses))
    while held.order:
        worse = [
            n
            for n in held.order
            # nothing else looks like a swing, and one goes on all over the record
            if not (held.gain(n).sure if n in SWINGS else held.gain(n).certain)
            or not (n in SWINGS or held.gain_alone(n).certain)
        ]
        reason = "the force left on data held out may be no less with it, or with it alone"
        no_less = [
            domain
            for domain, loses in (
                ("force", held.all.force_rms >= baseline.force_rms),
                ("position over a second", gained_ahead(baseline, held.all, held.limits).loses),
            )
            if loses
        ]
        if not worse and no_less:
            worse = held.order
            reason = (
                f"the prior model leaves less {no_less[0]} than the one with it, on data held out"
            )
        if not worse:
            break
        holds_up = taken_back(problem, holds_up, worse[-1], reason, folds)
        held = judged(situation, problem, holds_up.explanation, folds, bool(laps))
    return _Judgement(holds_up, held, baseline, laps)


def _concluded(
    records: Sequence[DriveRecord],
    prior_model: DriveModel,
    found: Found,
    judgement: _Judgement,
    suspects: Suspicion,
    notes: list[str],
    began: float,
) -> Diagnosis:
    situation, problem = found.situation, found.problem
    courses, noise = situation.courses, situation.noise
    holds_up, held, baseline = judgement.holds_up, judgement.held, judgement.baseline
    kind = _kind(situation, problem)
    corrected = _corrected(situation, problem, holds_up)
    if not held.order:  # values leave the least force then: nothing else is claimed of the model
        situation, left = _least_force(prior_model, found, judgement)
        courses, held = situation.courses, replace(held, none=left, all=left)
        nothing = Added.nothing(courses)
        baseline = residual(courses, prior_model, nothing)
        found_at_last = residual(courses, situation.model, nothing)
        corrected = corrected._replace(model=situation.model, residual=found_at_last)
    causes = tuple(
        found_cause(situation, problem, holds_up, held, kind, name) for name in held.order
    )
    whole = gained(held.none, held.all, held.limits)
    fitted, final = level(held.none), level(held.all)
    model, free = corrected.model, corrected.free
    lowest = noise_floor(
        courses, situation.model, situation.noise, corrected.residual, judgement.laps
    )
    at_floor = lowest.has(held.all)
    better = holds(whole.interval, fitted, final)
    verdict = _verdict(bool(causes), at_floor, better and not free)
    if verdict == NONE and suspects.none_ruled_out:
        verdict = UNEXPLAINED
        notes.append(
            "what is left is within twice the noise, and yet not like noise: of faultless records "
            "98 in 100 look more faultless than this"
        )
    notes += above_floor(held.all, lowest, bool(judgement.laps))
    friction = _friction(courses, model, held)
    if verdict == NONE:
        notes.append(below_floor(lowest, friction, [LIVES[m.name] for m in free]))
        free = []
    unnamed = tuple(LIVES[m.name] for m in free)
    notes += _of_the_fit(problem, holds_up, courses)
    cell = validation_signal(courses, prior_model, model, corrected.on_block.force)
    if cell is None and any("force" in r.signals for r in records):
        notes.append("the load cell's `force` is not used: the model does not say where it sits")
    strongest = strongest_alone(problem)
    return Diagnosis(
        verdict=verdict,
        where=where_residual_is(found.first_alone, verdict, unnamed, level(baseline), lowest.level),
        floor=lowest.level,
        baseline_residual=level(baseline),
        adjusted_residual=fitted,
        final_residual=final,
        left_of_friction=max(final.force, held.all.by_current_rms) / friction,
        gain_interval=whole.interval,
        held_out=held.parts,
        causes=causes,
        suspects=() if verdict == NONE else suspects.suspects,
        not_named=holds_up.refused,
        unnamed=unnamed,
        out_of_reach=out_of_reach(courses, situation.model, problem, holds_up.explanation),
        next_experiment=next_experiment(holds_up.refused, bool(free), courses, model),
        prior=prior_model,
        adjusted=_adjusted(prior_model, holds_up, corrected, courses),
        corrected=model,
        command=records[0].command,
        command_shift=courses[0].calibration["command_shift"],
        adjustments={n: model.values[n] / prior_model.values[n] - 1.0 for n in problem.names},
        noise={
            f"{channel}_{unit}": float(size)
            for channel, unit, size in zip(
                courses[0].channels, ("N", "V"), noise.sizes, strict=False
            )
        },
        alone={n: float(g) for n, g in found.choice.alone.items() if n in CAUSES},
        evidence=strongest,
        kind=kind,
        p_value=p_value(strongest, kind),
        load_cell=cell,
        records=tuple(r.name for r in records),
        curves=_curves(courses, prior_model, baseline, corrected),
        seconds=time.perf_counter() - began,
        notes=tuple(notes),
    )


def _least_force(
    prior_model: DriveModel, found: Found, judgement: _Judgement
) -> tuple[Situation, Residual]:
    """Values that leave the least force, and what those of other data leave of each part."""
    before = found.situation
    nothing = Added.nothing(before.courses)
    after = adjusted(before.courses, before.model, prior_model, nothing, coloured=False)
    problem = values_alone(found.problem, after.courses, after.model, driven_by(after.noise))
    # values that no motion alike tells would be off by their tolerances, and that is no fault
    folds = parts_of(after.courses, judgement.laps, mixed=True)
    held = judged(after, problem, nothing_in(problem), folds, bool(judgement.laps))
    return after, after_the_start(held.none, after.courses)


def _standing(prior_model: DriveModel, found: Found) -> tuple[Found, _Judgement]:
    """What was found as judged, or its first cause alone where nothing else is left."""
    judgement = _judgement(prior_model, found)
    single = None if judgement.held.order else only_first(found, prior_model)
    if not single:
        return found, judgement
    # too many causes together may leave none; the first of them is judged alone then
    first = _judgement(prior_model, single)
    refused = judgement.holds_up.refused
    # of a swing alone an error of the others' laws may be the source
    unsure = {r.name for r in refused if r.like} | set(SWINGS)
    if not first.held.order or unsure & set(first.held.order):
        return found, judgement
    more = [r for r in refused if r.name not in first.held.order]
    kept = [r for r in first.holds_up.refused if r.name not in {m.name for m in more}]
    holds_up = replace(first.holds_up, refused=(*more, *kept))
    return single, first._replace(holds_up=holds_up)


class _Corrected(NamedTuple):
    """The corrected model, what it leaves, and the forces in it that the prior one lacks.

    `free` is the structure without a name; `on_block` is what a load cell feels of `named`.
    """

    model: DriveModel
    residual: Residual
    named: Added
    on_block: Added
    free: list[Candidate]
    unnamed: Added


def _corrected(situation: Situation, problem: Problem, holds_up: Accepted) -> _Corrected:
    courses = situation.courses
    fitted = amplitudes(problem, holds_up.explanation)
    members = list(holds_up.explanation.members)
    named = added_by(members, fitted, courses)
    on_block = [m for m in members if not CAUSES[m.name].on_screw]
    free = [m for m in holds_up.freest.members if m.is_rival]
    model = with_values(problem, fitted)
    return _Corrected(
        model=model,
        residual=residual(courses, model, named),
        named=named,
        on_block=added_by(on_block, fitted, courses),
        free=free,
        unnamed=added_by(free, amplitudes(problem, holds_up.freest), courses),
    )


def _of_the_fit(
    problem: Problem, holds_up: Accepted, courses: Sequence[ModelledRecord]
) -> list[str]:
    """What to say of fitted offsets, and of values at the end of what they can be."""
    notes = []
    own = [f"{c.own_offset:+.3g} N in {c.record.name}" for c in courses if c.offset_name]
    if own:
        notes.append(f"offsets beyond that of {courses[0].record.name}: {', '.join(own)}")
    ends = at_ends(problem, holds_up.explanation, courses)
    if ends:
        notes.append(
            f"at the end of what they can be: {', '.join(ends)}. A tolerance is too narrow, or "
            "something without a name is made up for"
        )
    return notes


def _adjusted(
    prior_model: DriveModel,
    holds_up: Accepted,
    corrected: _Corrected,
    courses: list[ModelledRecord],
) -> DriveModel:
    """The prior model with its own values fitted, without any cause."""
    if not holds_up.explanation.members:
        return corrected.model
    return adjusted(courses, prior_model, prior_model, Added.nothing(courses)).model


def _curves(
    courses: Sequence[ModelledRecord],
    prior_model: DriveModel,
    baseline: Residual,
    corrected: _Corrected,
) -> Curves:
    predicted = np.concatenate([opposing(c, prior_model) for c in courses])
    return Curves(
        time=np.concatenate([c.time for c in courses]),
        record=np.repeat(np.arange(len(courses)), [len(c.x) for c in courses]),
        x=np.concatenate([c.x for c in courses]),
        v=np.concatenate([c.v for c in courses]),
        force=predicted + baseline.force,
        predicted=predicted,
        before=baseline.force,
        after=corrected.residual.force,
        position_before=baseline.position,
        position_after=corrected.residual.position,
        cause=np.concatenate(corrected.named.force),
        shape=np.concatenate(corrected.unnamed.force),
        telling=baseline.telling,
    )


def _friction(courses: Sequence[ModelledRecord], model: DriveModel, held: HeldOut) -> float:
    """Root mean square of the friction where samples tell anything [N]."""
    along = np.concatenate([opposing(c, model) for c in courses])
    return max(rms(along[held.all.telling]), 1e-300)


def _verdict(causes: bool, at_floor: bool, enough: bool) -> str:
    """By whether there are causes, whether noise is all that is left, and whether they do."""
    if not causes:
        return NONE if at_floor else UNEXPLAINED
    return EXPLAINED if enough and at_floor else PARTLY


def _kind(situation: Situation, problem: Problem) -> RecordKind:
    model, course = problem.model, situation.courses[0]
    return RecordKind(
        noise=float(situation.noise.sizes[0]) / model.friction_scale,
        inertia=model.inertia,
        step=course.step,
        current=float(course.has_current),
        classical=float(model.law == "classical"),
    )
