"""Given records of a drive and the model its user believes: what is wrong with it, and why."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from ..identification.fitted_law import LAWS
from ..orchestration.parameter_file import ParameterFile, read_parameters
from ..plant import ball_screw, direct_drive
from ..records.drive_record import DriveRecord, read_drive_records
from ..records.tellable import check_tellable
from .acceptance import SWINGS, Accepted, accepted, taken_back
from .believed import believed as believed_of
from .believed import lead_of, with_lead
from .causes import CAUSES
from .causes.cause import Shape
from .commanded import commanded
from .course import Course, opposing
from .diagnosis import (
    EXPLAINED,
    NONE,
    PARTLY,
    UNEXPLAINED,
    Curves,
    Diagnosis,
    FoundCause,
    Level,
    NextExperiment,
    NotNamed,
    OutOfReach,
    holds,
)
from .drive_model import DriveModel
from .evidence import Conditioned, Prior, conditioned, fit
from .faultless import RecordKind, p_value
from .held_out import HeldOut, gained, gained_ahead, judged, laps_of, parts_of, with_values
from .load_cell import witness
from .next_experiment import UNNAMED, motion_for, reach_of, trial_for
from .plausibility import at_ends, crossed
from .regression import Added, filters, responses, whitened
from .residuals import Residual, floor, repetition, residual
from .rivals import LIVES
from .search import Found, Situation, added_by, only_first, search
from .search import adjusted as values_adjusted
from .selection import (
    Candidate,
    Explanation,
    Problem,
    amplitudes,
    bring_of,
    own_size,
    scores,
    strongest_alone,
    without,
)

Vector = npt.NDArray[np.float64]

_SMALLEST = 0.05  # of the friction: size at which a cause is asked to show
_SEEN = 5.0  # standard deviations
_FREED_SHOWN = 0.1  # of a value that may be wrong
_EXACT = 0.04  # relative, to which no size is known: laws and shapes are not exact
_AS_GOOD_A_FORM = 0.9  # of what a cause brings, that its other form brings in its place
_AT_FLOOR = 2.0  # times the floor: more is not explained
UNITS = {p.name: p.unit for p in (*ball_screw.PARAMETERS, *direct_drive.PARAMETERS)} | {
    name: unit
    for law in LAWS.values()
    for name, unit in zip(law.parameters, law.units, strict=True)
}


def diagnose(
    data: Sequence[Path | str],
    params: Path | str | None = None,
    law: str | None = None,
    mapping: Mapping[str, str] | None = None,
    progress: Callable[[str], None] = lambda doing: None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
) -> Diagnosis:
    """What a simulation of recorded runs gets wrong, why, and how much better it can be.

    Parameters
    ----------
    data : sequence of path-like
        CSV, MAT or Parquet files with ``time`` [s], ``u`` [V] and ``x`` [m], perhaps ``i`` [A];
        ``i`` alone is taken as the command, see `commanded`.
    params : path-like, optional
        The believed model, see `read_believed`; the nominal axis by default.
    law : str, optional
        Friction law, in place of the file's.
    mapping : mapping of str to str, optional
        ``theirs -> ours`` names of columns.
    progress : function of what is being done, optional
    units : mapping of str to str, optional
        Unit of a column (our name); default what the file says, else SI.
    lead : float, optional
        Way of the screw per turn [m], where the parameter file has no `p`.

    Raises
    ------
    BadRecord, BadParameters
        With one line that says what cannot be used and why.
    """
    told = with_lead(ParameterFile() if params is None else read_parameters(params), lead)
    records = read_drive_records(data, mapping, units, lead_of(told, lead))
    return diagnose_records(records, believed_of(told, law), progress)


def diagnose_records(
    records: Sequence[DriveRecord],
    believed: DriveModel,
    progress: Callable[[str], None] = lambda doing: None,
) -> Diagnosis:
    """As `diagnose`, of records in memory; `believed` of the result takes the command they have."""
    began = time.perf_counter()
    records, believed, notes = commanded(records, believed)
    notes += check_tellable(records)
    progress("looking for causes")
    found = search(records, believed)
    progress("judging on data held out")
    return _concluded(records, believed, found, notes, began)


def _level(found: Residual) -> Level:
    return Level(found.force_rms, found.position_rms)


class _Judgement(NamedTuple):
    """What of an explanation data held out let stand."""

    holds_up: Accepted
    held: HeldOut
    baseline: Residual
    laps: list[float]


def _judgement(believed: DriveModel, found: Found) -> _Judgement:
    """Take names back until what is left gains for certain, each of them and all together."""
    situation, problem = found.situation, found.problem
    courses = situation.courses
    laps = laps_of(courses)
    folds = parts_of(courses, laps)
    holds_up = accepted(problem, found.choice.best, folds, courses)
    held = judged(situation, problem, holds_up.explanation, folds, bool(laps))
    baseline = residual(courses, believed, Added.nothing(courses))
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
                f"the model as believed leaves less {no_less[0]} than the one with it, "
                "on data held out"
            )
        if not worse:
            break
        holds_up = taken_back(problem, holds_up, worse[-1], reason, folds)
        held = judged(situation, problem, holds_up.explanation, folds, bool(laps))
    return _Judgement(holds_up, held, baseline, laps)


def _concluded(
    records: Sequence[DriveRecord],
    believed: DriveModel,
    found: Found,
    notes: list[str],
    began: float,
) -> Diagnosis:
    judgement = _judgement(believed, found)
    single = None if judgement.held.order else only_first(found, believed)
    if single:
        # too many causes together may leave none; the first of them is judged alone then
        first = _judgement(believed, single)
        refused = judgement.holds_up.refused
        # of a swing alone an error of the others' laws may be the source
        unsure = {r.name for r in refused if r.like} | set(SWINGS)
        if first.held.order and not unsure & set(first.held.order):
            more = [r for r in refused if r.name not in first.held.order]
            kept = [r for r in first.holds_up.refused if r.name not in {m.name for m in more}]
            holds_up = replace(first.holds_up, refused=(*more, *kept))
            judgement, found = first._replace(holds_up=holds_up), single
    holds_up, held, baseline, laps = judgement
    situation, problem = found.situation, found.problem
    courses, noise = situation.courses, situation.noise
    best = holds_up.explanation
    nothing = Added.nothing(courses)
    kind = _kind(situation, problem)
    causes = tuple(
        _found_cause(situation, problem, holds_up, held, kind, name) for name in held.order
    )
    whole = gained(held.none, held.all, held.limits)
    adjusted, final = _level(held.none), _level(held.all)
    fitted = amplitudes(problem, best)
    members = list(best.members)
    named = added_by(members, fitted, courses)
    on_block = [m for m in members if not CAUSES[m.name].on_screw]
    free = [m for m in holds_up.freest.members if m.is_rival]
    unnamed = added_by(free, amplitudes(problem, holds_up.freest), courses)
    model = with_values(problem, fitted)
    mended = residual(courses, model, named)
    lowest = _level(floor(courses, situation.model))
    if laps:
        lowest = Level(max(lowest.force, repetition(mended, courses, laps)), lowest.position)
    verdict = _verdict(bool(causes), bool(free), holds(whole.interval, adjusted, final))
    if verdict == EXPLAINED and final.force > _AT_FLOOR * lowest.force:
        verdict = PARTLY
        notes.append(_above_floor(final, lowest, bool(laps)))
    own = [f"{c.own_offset:+.3g} N in {c.record.name}" for c in courses if c.offset_name]
    if own:
        notes.append(f"offsets beyond that of {courses[0].record.name}: {', '.join(own)}")
    ends = at_ends(problem, best, courses)
    if ends:
        notes.append(
            f"at the end of what they can be: {', '.join(ends)}. A tolerance is too narrow, or "
            "something without a name is made up for"
        )
    cell = witness(courses, believed, model, added_by(on_block, fitted, courses).force)
    if cell is None and any("force" in r.signals for r in records):
        notes.append("the load cell's `force` is not used: the model does not say where it sits")
    predicted = np.concatenate([opposing(c, believed) for c in courses])
    curves = Curves(
        time=np.concatenate([c.time for c in courses]),
        record=np.repeat(np.arange(len(courses)), [len(c.x) for c in courses]),
        x=np.concatenate([c.x for c in courses]),
        v=np.concatenate([c.v for c in courses]),
        force=predicted + baseline.force,
        predicted=predicted,
        before=baseline.force,
        after=mended.force,
        position_before=baseline.position,
        position_after=mended.position,
        cause=np.concatenate(named.force),
        shape=np.concatenate(unnamed.force),
        telling=baseline.telling,
    )
    strongest = strongest_alone(problem)
    return Diagnosis(
        verdict=verdict,
        where=_where(found, verdict, _level(baseline), lowest),
        floor=lowest,
        baseline_residual=_level(baseline),
        adjusted_residual=adjusted,
        final_residual=final,
        gain_interval=whole.interval,
        held_out=held.parts,
        causes=causes,
        not_named=holds_up.refused,
        unnamed=tuple(LIVES[m.name] for m in free),
        out_of_reach=_out_of_reach(courses, situation.model, problem, best),
        next_experiment=_next_experiment(holds_up.refused, bool(free), courses, model),
        believed=believed,
        adjusted=model
        if not members
        else values_adjusted(courses, believed, believed, nothing).model,
        mended=model,
        command=records[0].command,
        command_shift=courses[0].calibration["command_shift"],
        adjustments={n: model.values[n] / believed.values[n] - 1.0 for n in problem.names},
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
        curves=curves,
        seconds=time.perf_counter() - began,
        notes=tuple(notes),
    )


def _verdict(causes: bool, structure: bool, better: bool) -> str:
    """By whether there are causes, structure beside them, and a gain on data held out."""
    if not causes:
        return UNEXPLAINED if structure else NONE
    return EXPLAINED if better and not structure else PARTLY


def _above_floor(final: Level, lowest: Level, repeated: bool) -> str:
    known = "its laps differ by" if repeated else "the instruments show"
    more = "" if repeated else "; laps of one motion would show what of it repeats"
    return (
        f"what is left, {final.force:.3g} N, is more than {lowest.force:.3g} N, which is what "
        f"{known}: a part of it may have a cause{more}"
    )


def _kind(situation: Situation, problem: Problem) -> RecordKind:
    model, course = problem.model, situation.courses[0]
    return RecordKind(
        noise=float(situation.noise.sizes[0]) / model.friction_scale,
        inertia=model.inertia,
        step=course.step,
        current=float(course.has_current),
        classical=float(model.law == "classical"),
    )


def _found_cause(
    situation: Situation,
    problem: Problem,
    holds_up: Accepted,
    held: HeldOut,
    kind: RecordKind,
    name: str,
) -> FoundCause:
    best = holds_up.explanation
    k = best.names.index(name)
    member = best.members[k]
    cause = CAUSES[name]
    gain = held.gain(name)
    values, intervals = _values_of(situation, problem, best, k)
    units = {p.name: p.unit for p in cause.parameters}
    if member.shape.freed:
        units = {n: UNITS.get(n, "") for n in member.shape.freed}
    return FoundCause(
        name=member.name,
        says=cause.says,
        parameters=values,
        intervals=intervals,
        units={n: units.get(n.partition(".")[0], "") for n in values},
        gain_heldout=gain.share,
        gain_interval=gain.interval,
        gain_alone=held.gain_alone(name).share,
        before=_level(held.without[name]),
        after=_level(held.all),
        evidence=best.gains[k],
        p_value=p_value(best.gains[k], kind),
        confirm=cause.confirm,
    )


def _values_of(
    situation: Situation, problem: Problem, best: Explanation, k: int
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """A member's numbers and their 95 % intervals, as wide as the stretches say they must be."""
    member = best.members[k]
    shape = member.shape
    products = problem.columns.products()
    fitted = fit(products, best.priors)
    where = [int(np.flatnonzero(fitted.columns == c)[0]) for c in member.columns]
    doubtful = fit(products, _reopened(problem, best)).covariance
    wide = scores(problem, best, k).widening()
    quantile = float(student.ppf(0.975, max(problem.columns.stretches - len(where), 1)))
    amplitude = fitted.amplitude[where]
    errors = quantile * wide * np.sqrt(np.diag(doubtful))[where]
    if shape.freed:
        before = np.array([problem.model.values[n] for n in shape.freed])
        now = before * (1.0 + amplitude)
        freed = {
            n: (float(a - e), float(a + e))
            for n, a, e in zip(shape.freed, now, before * errors + _EXACT * now, strict=True)
        }
        return dict(zip(shape.freed, now.tolist(), strict=True)), freed
    values = {n: float(v) for n, v in shape.values.items()}
    intervals: dict[str, tuple[float, float]] = {}
    cause = CAUSES[member.name]
    refined = cause.refined_of(values)
    if refined:
        value = values[refined]
        error = _EXACT + quantile * wide * _log_spread(situation, problem, best, k)
        if shape.sure is not None:  # by which the shape would be larger or smaller, were it free
            error += abs(math.log(max(own_size(problem, products, best, k), 0.1)))
        if cause.way:  # what is over before samples tell of it is known no better
            error += math.log1p(crossed(situation.courses) / cause.way(problem.model, values))
        error = min(error, 3.0)
        intervals[refined] = (value * math.exp(-error), value * math.exp(error))
    if shape.sure is None:
        forms = np.array([amplitude, *_in_other_forms(problem, best, k)])
        low, high = forms.min(axis=0), forms.max(axis=0)
        for j, (name, a, e) in enumerate(zip(shape.amplitudes, amplitude, errors, strict=True)):
            values[name] = float(a)
            e += _EXACT * abs(a)
            intervals[name] = (float(low[j] - e), float(high[j] + e))
    return values, intervals


def _in_other_forms(problem: Problem, best: Explanation, k: int) -> list[Vector]:
    """A member's amplitudes, were its cause of another form that explains nearly as much.

    Each other form's force is told in the member's own amplitudes, by least squares.
    """
    member = best.members[k]
    left = conditioned(problem.columns.products(), without(problem, best, k).priors)
    own, *_ = bring_of(member.shape, *left.of(member.columns))
    mine = _whole_force(problem.model, member.shape)
    out = []
    for c in problem.candidates:
        same = c.name == member.name and not c.is_rival and c is not member
        if not same or c.shape.freed or c.shape.sure is not None:
            continue
        inner, signal = left.of(c.columns)
        brings, mean, spread = bring_of(c.shape, inner, signal)
        if brings > _AS_GOOD_A_FORM * own:
            precise = np.diag(spread**-2.0)
            found = np.linalg.solve(inner + precise, signal + precise @ mean)
            force = _whole_force(problem.model, c.shape) @ found
            out.append(np.asarray(np.linalg.lstsq(mine, force, rcond=None)[0], dtype=np.float64))
    return out


def _whole_force(model: DriveModel, shape: Shape) -> Vector:
    """Force and command of a shape along all records, shape (n, amplitudes) [N]."""
    parts = [np.concatenate(shape.force)] if shape.force is not None else []
    if shape.command is not None:
        parts.append(model.per_command * np.concatenate(shape.command))
    return np.asarray(np.sum(parts, axis=0))


def _reopened(problem: Problem, best: Explanation) -> list[Prior]:
    """Priors in which a value held at the end of its tolerance is as doubtful as it was before."""
    values = best.priors[0]
    spread = np.maximum(values.spread, problem.prior.spread)
    return [Prior(values.columns, values.mean, spread), *best.priors[1:]]


def _log_spread(situation: Situation, problem: Problem, best: Explanation, k: int) -> float:
    """Standard error of the logarithm of a refined value, everything else adjusted."""
    member = best.members[k]
    cause = CAUSES[member.name]
    key = cause.refined_of(member.shape.values) or ""
    value = member.shape.values[key]
    made = filters(situation.courses, problem.noise)
    fitted = amplitudes(problem, best)[member.columns]
    sides = [
        whitened(
            made,
            responses(
                situation.courses,
                situation.model,
                cause.at(
                    situation.courses,
                    situation.model,
                    {**member.shape.values, key: value * math.exp(s)},
                ),
            ),
        )
        @ fitted
        for s in (0.05, -0.05)
    ]
    slope = (sides[0] - sides[1]) / 0.1
    priors = _reopened(problem, best)
    used = np.concatenate([p.columns for p in priors]).astype(np.int64)
    scale = np.concatenate([p.spread for p in priors])
    others = problem.columns.of(used)
    if member.shape.sure is not None:  # its amplitude is one
        keep = ~np.isin(used, member.columns)
        others, scale = others[:, keep], scale[keep]
    inner = others.T @ others + np.diag(scale**-2.0)
    cross = others.T @ slope
    information = float(slope @ slope - cross @ np.linalg.solve(inner, cross))
    return 1.0 / math.sqrt(max(information, 1e-12))


def _where(found: Found, verdict: str, baseline: Level, lowest: Level) -> str:
    """Where the residual lives, and how large it is, in one sentence."""
    size = (
        f"{baseline.force:.3g} N rms in force (noise alone: {lowest.force:.3g} N) and "
        f"{_length(baseline.position)} in position over a second ({_length(lowest.position)})"
    )
    alone = {n: g for n, g in found.first_alone.items() if n in LIVES}
    if verdict == NONE or not alone:
        return (
            f"The model as believed leaves {size}; none of it has a structure beyond noise and "
            "values within their tolerances."
        )
    best = max(alone, key=lambda n: alone[n])
    return (
        f"The model as believed leaves {size}; what noise does not explain of it lives "
        f"{LIVES[best]}."
    )


def _length(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm" if metres >= 1e-4 else f"{1e6 * metres:.3g} um"


def _out_of_reach(
    courses: Sequence[Course], model: DriveModel, problem: Problem, best: Explanation
) -> tuple[OutOfReach, ...]:
    """Causes that would not have shown had they been as large as a twentieth of the friction."""
    left = conditioned(problem.columns.products(), best.priors)
    size = _SMALLEST * model.friction_scale
    out = []
    for cause in CAUSES.values():
        if cause.name in best.causes:
            continue
        because = cause.beyond(courses, model)
        if because:
            out.append(OutOfReach(cause.name, because))
            continue
        mine = [c for c in problem.candidates if c.name == cause.name]
        shown = [_shows(c, left, size, model) for c in mine]
        if not shown:
            out.append(OutOfReach(cause.name, "the motion gives it nothing to show at"))
        elif max(shown) < _SEEN:
            out.append(
                OutOfReach(
                    cause.name,
                    f"at {100 * _SMALLEST:.0f} % of the friction it would stand out by "
                    f"{max(shown):.2g} standard deviations only, and {_SEEN:g} are asked for",
                )
            )
    return tuple(out)


def _shows(candidate: Candidate, left: Conditioned, size: float, model: DriveModel) -> float:
    """Standard deviations by which a candidate whose force is of this size stands out."""
    norms = np.sqrt(np.maximum(np.diag(left.of(candidate.columns)[0]), 0.0))
    shape = candidate.shape
    if shape.freed:
        return float(_FREED_SHOWN * norms.max())
    rms = np.sqrt(np.mean(_whole_force(model, shape) ** 2, axis=0))
    return (
        float(np.max(norms * size / np.maximum(rms, 1e-300), initial=0.0))
        if np.any(rms > 0)
        else 0.0
    )


def _next_experiment(
    refused: Sequence[NotNamed], structure: bool, courses: Sequence[Course], model: DriveModel
) -> NextExperiment | None:
    """What would tell apart what this record cannot."""
    for r in refused:
        if r.like:
            motion = motion_for(r.name, reach_of(courses), model)
            says = f"{r.name} cannot be told from {r.like} here ({CAUSES[r.name].confirm})"
            return NextExperiment(says, motion, trial_for(r.name))
    if structure:
        motion = motion_for(UNNAMED, reach_of(courses), model)
        return NextExperiment("structure is left that no cause has", motion, trial_for(UNNAMED))
    return None
