"""Given records of a drive and the model its user believes: what is wrong with it, and why."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from ..plant import ball_screw, direct_drive
from ..records.drive_record import DriveRecord, read_drive_records
from ..records.tellable import check_tellable
from .along_record import LAWS
from .believed import read_believed
from .causes import CAUSES
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
    OutOfReach,
    holds,
)
from .drive_model import DriveModel
from .evidence import conditioned, fit
from .held_out import HeldOut, gained, judged, with_values
from .load_cell import witness
from .regression import Added, filters, response
from .residuals import Residual, floor, residual
from .rivals import rivals
from .search import Found, Situation, added_by, search
from .selection import (
    NEAR,
    PRICE,
    Candidate,
    Choice,
    Explanation,
    Problem,
    amplitudes,
    p_value,
    restricted_to,
    scores,
)

Vector = npt.NDArray[np.float64]

_SMALLEST = 0.05  # of the friction: size at which a cause is asked to show
_SEEN = 5.0  # standard deviations
_FREED_SHOWN = 0.1  # of a value that may be wrong
UNITS = {p.name: p.unit for p in (*ball_screw.PARAMETERS, *direct_drive.PARAMETERS)} | {
    name: unit
    for law in LAWS.values()
    for name, unit in zip(law.parameters, law.units, strict=True)
}
# A trial of `ballscrew rig` that tells a cause from those it is mistaken for.
TRIALS_FOR = {
    "direction_asymmetry": ("viscous", "the same speeds both ways, several of them"),
    "load_bias": ("viscous", "the same speeds both ways, several of them"),
    "position_periodic_friction": ("2.3.1/1", "slow steady motion over many turns, both ways"),
    "position_trend_friction": ("2.3.1/16", "slow steady motion over the whole travel, both ways"),
    "torque_ripple": ("2.3.1/1", "slow steady motion over many turns, both ways"),
    "nonlinear_viscous": ("viscous", "constant speeds up to the highest"),
    "stribeck_mismatch": ("2.3.1", "constant speeds, close together where the curve bends"),
    "presliding_hysteresis": ("presliding", "a slow staircase of the force below break-away"),
    "compliance": ("presliding", "a slow staircase of the force below break-away"),
    "backlash": ("2.4/1", "slow reversals with the current recorded"),
    "unmodelled_inertia": ("2.6/9", "the fastest sine: force against acceleration"),
    "input_delay": ("2.10/1", "a step of the command with the current recorded"),
    "friction_drift": ("viscous/1", "the same constant speed, again and again"),
    "resistance_drift": ("viscous/1", "the same constant speed again and again, current recorded"),
    "voltage_saturation": ("viscous/60", "the highest speed, voltage at the motor recorded"),
    "parameter_error": ("2.3.1", "constant speeds both ways"),
    "unexplained": ("2.3.1", "constant speeds both ways over the whole travel"),
}


def diagnose(
    data: Sequence[Path | str],
    params: Path | str | None = None,
    law: str | None = None,
    mapping: Mapping[str, str] | None = None,
    progress: Callable[[str], None] = lambda doing: None,
) -> Diagnosis:
    """What a simulation of recorded runs gets wrong, why, and how much better it can be.

    Parameters
    ----------
    data : sequence of path-like
        CSV, MAT or Parquet files with ``time`` [s], ``u`` [V] and ``x`` [m], perhaps ``i`` [A].
    params : path-like, optional
        The believed model, see `read_believed`; the nominal axis by default.
    law : str, optional
        Friction law, in place of the file's.
    mapping : mapping of str to str, optional
        ``theirs -> ours`` names of columns.
    progress : function of what is being done, optional

    Raises
    ------
    BadRecord, BadParameters
        With one line that says what cannot be used and why.
    """
    believed = read_believed(params, law)
    return diagnose_records(read_drive_records(data, mapping), believed, progress)


def diagnose_records(
    records: Sequence[DriveRecord],
    believed: DriveModel,
    progress: Callable[[str], None] = lambda doing: None,
) -> Diagnosis:
    """As `diagnose`, of records in memory."""
    began = time.perf_counter()
    notes = check_tellable(records)
    progress("looking for causes")
    found = search(records, believed)
    progress("judging on data held out")
    return _concluded(records, believed, found, notes, began)


def _level(found: Residual) -> Level:
    return Level(found.force_rms, found.position_rms)


def _concluded(
    records: Sequence[DriveRecord],
    believed: DriveModel,
    found: Found,
    notes: list[str],
    began: float,
) -> Diagnosis:
    situation, problem, best = found.situation, found.problem, found.choice.best
    courses, noise = situation.courses, situation.noise
    names = best.causes
    held = judged(situation, problem, names, len(best.members))
    nothing = Added.nothing(courses)
    baseline = residual(courses, believed, noise, nothing)
    lowest = floor(courses, situation.model, noise)
    causes = tuple(
        _found_cause(situation, problem, found.choice, name, held) for name in held.order
    )
    whole = gained(held.none, held.all, held.limits)
    adjusted, final = _level(held.none), _level(held.all)
    verdict = NONE
    if best.rivals or (causes and not holds(whole.interval, adjusted, final)):
        verdict = PARTLY if causes else UNEXPLAINED
    elif causes:
        verdict = EXPLAINED
    fitted = amplitudes(problem, best)
    in_the_plant = amplitudes(problem, restricted_to(problem, best, set(names)))
    members = [m for m in best.members if not m.is_rival]
    named = added_by(members, in_the_plant, courses)
    on_block = [m for m in members if not CAUSES[m.name].on_screw]
    unnamed = added_by([m for m in best.members if m.is_rival], fitted, courses)
    model = with_values(problem, in_the_plant)
    mended = residual(courses, model, noise, named)
    cell = witness(courses, believed, model, added_by(on_block, in_the_plant, courses).force)
    if cell is None and any("force" in r.signals for r in records):
        notes.append("the load cell's `force` is not used: the model does not say where it sits")
    predicted = np.concatenate([opposing(c, believed) for c in courses])
    lives = {r.name: r.lives for r in rivals(courses[:1], situation.model)}
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
    return Diagnosis(
        verdict=verdict,
        where=_where(found, _level(baseline), _level(lowest), lives),
        floor=_level(lowest),
        baseline_residual=_level(baseline),
        adjusted_residual=adjusted,
        final_residual=final,
        gain_interval=whole.interval,
        held_out=held.parts,
        causes=causes,
        unnamed=tuple(lives[n] for n in best.rivals),
        out_of_reach=_out_of_reach(courses, situation.model, problem, best),
        next_experiment=_next_experiment(causes, best),
        believed=believed,
        mended=model,
        adjustments={n: model.values[n] / believed.values[n] - 1.0 for n in problem.names},
        noise={
            "unmodelled_force_N": noise.rms,
            "its_memory_s": noise.memory,
            **{
                {"x": "position_m", "i": "current_A"}[c]: float(math.sqrt(v))
                for c, v in zip(courses[0].channels, noise.channels, strict=True)
            },
        },
        alone={n: float(g) for n, g in found.choice.alone.items() if n in CAUSES},
        load_cell=cell,
        records=tuple(r.name for r in records),
        curves=curves,
        seconds=time.perf_counter() - began,
        notes=tuple(notes),
    )


def _found_cause(
    situation: Situation,
    problem: Problem,
    choice: Choice,
    name: str,
    held: HeldOut,
) -> FoundCause:
    best = choice.best
    k = best.names.index(name)
    member = best.members[k]
    cause = CAUSES[name]
    place = best.causes.index(name)
    gain = held.gain(name)
    # as the plant has it: a rival may hold part of what a cause could say
    own = restricted_to(problem, best, set(best.causes))
    values, intervals = _values_of(situation, problem, own, place)
    units = {p.name: p.unit for p in cause.parameters}
    if member.shape.freed:
        units = {member.shape.freed: UNITS.get(member.shape.freed, "")}
    confused = []
    for other in choice.others:
        if best.score - other.score > NEAR or len(other.members) != len(best.members):
            continue
        different = set(other.names) - set(best.names)
        if len(different) == 1 and member.name not in other.names:
            confused += [n for n in different if n in CAUSES]
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
        p_value=p_value(problem, own, place),
        chosen_again=float(np.mean([member.name in names for names in held.chosen])),
        confused_with=tuple(dict.fromkeys(confused)),
        confirm=cause.confirm,
    )


def _values_of(
    situation: Situation, problem: Problem, best: Explanation, k: int
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """A member's numbers and their 95 % intervals, as wide as the stretches say they must be."""
    member = best.members[k]
    shape = member.shape
    fitted = fit(problem.columns.products(), list(best.priors))
    where = [int(np.flatnonzero(fitted.columns == c)[0]) for c in member.columns]
    wide = scores(problem, best, k).widening()
    quantile = float(student.ppf(0.975, max(problem.columns.stretches - len(where), 1)))
    amplitude = fitted.amplitude[where]
    spread = np.sqrt(np.diag(fitted.covariance))[where] * wide
    if shape.freed:
        value = problem.model.values[shape.freed]
        now = value * (1.0 + float(amplitude[0]))
        error = quantile * value * float(spread[0])
        return {shape.freed: now}, {shape.freed: (now - error, now + error)}
    values = {n: float(v) for n, v in shape.values.items()}
    intervals: dict[str, tuple[float, float]] = {}
    cause = CAUSES[member.name]
    if cause.refined:
        value = values[cause.refined]
        error = min(quantile * wide * _log_spread(situation, problem, best, k), 3.0)
        intervals[cause.refined] = (value * math.exp(-error), value * math.exp(error))
    if shape.sure is None:
        for name, a, e in zip(shape.amplitudes, amplitude, spread, strict=True):
            values[name] = float(a)
            intervals[name] = (float(a - quantile * e), float(a + quantile * e))
    return values, intervals


def _log_spread(situation: Situation, problem: Problem, best: Explanation, k: int) -> float:
    """Standard error of the logarithm of a refined value, everything else adjusted."""
    member = best.members[k]
    cause = CAUSES[member.name]
    key = cause.refined or ""
    value = member.shape.values[key]
    made = filters(situation.courses, situation.model, situation.noise)
    fitted = amplitudes(problem, best)[member.columns]
    sides = [
        response(
            situation.courses,
            made,
            cause.at(
                situation.courses,
                situation.model,
                {**member.shape.values, key: value * math.exp(s)},
            ),
        )
        @ fitted
        for s in (0.05, -0.05)
    ]
    slope = (sides[0] - sides[1]) / 0.1
    used = np.concatenate([p.columns for p in best.priors]).astype(np.int64)
    scale = np.concatenate([p.spread for p in best.priors])
    others = problem.columns.of(used)
    if member.shape.sure is not None:  # its amplitude is one
        keep = ~np.isin(used, member.columns)
        others, scale = others[:, keep], scale[keep]
    inner = others.T @ others + np.diag(scale**-2.0)
    cross = others.T @ slope
    information = float(slope @ slope - cross @ np.linalg.solve(inner, cross))
    return 1.0 / math.sqrt(max(information, 1e-12))


def _where(found: Found, baseline: Level, lowest: Level, lives: Mapping[str, str]) -> str:
    """Where the residual lives, and how large it is, in one sentence."""
    size = (
        f"{baseline.force:.3g} N rms in force (noise alone: {lowest.force:.3g} N) and "
        f"{_length(baseline.position)} in position over a second ({_length(lowest.position)})"
    )
    alone = {n: g for n, g in found.first_alone.items() if n in lives}
    if not alone or max(alone.values()) < PRICE:
        return (
            f"The model as believed leaves {size}; none of it has a structure beyond noise and "
            "values within their tolerances."
        )
    best = max(alone, key=lambda n: alone[n])
    return (
        f"The model as believed leaves {size}; what noise does not explain of it lives "
        f"{lives[best]}."
    )


def _length(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm" if metres >= 1e-4 else f"{1e6 * metres:.3g} um"


def _out_of_reach(
    courses: Sequence[Course], model: DriveModel, problem: Problem, best: Explanation
) -> tuple[OutOfReach, ...]:
    """Causes that would not have shown had they been as large as a twentieth of the friction."""
    left = conditioned(problem.columns.products(), list(best.priors)).products
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


def _shows(
    candidate: Candidate, left: npt.NDArray[np.float64], size: float, model: DriveModel
) -> float:
    """Standard deviations by which a candidate whose force is of this size stands out."""
    norms = np.sqrt(np.maximum(np.diag(left)[candidate.columns], 0.0))
    shape = candidate.shape
    if shape.freed:
        return float(_FREED_SHOWN * norms[0])
    forces = []
    if shape.force is not None:
        forces.append(np.concatenate(shape.force))
    if shape.command is not None:
        forces.append(model.per_command * np.concatenate(shape.command))
    rms = np.sqrt(np.mean(sum(forces) ** 2, axis=0))
    return (
        float(np.max(norms * size / np.maximum(rms, 1e-300), initial=0.0))
        if np.any(rms > 0)
        else 0.0
    )


def _next_experiment(causes: tuple[FoundCause, ...], best: Explanation) -> NextExperiment | None:
    """What would tell apart what this record cannot."""
    for cause in causes:
        if cause.confused_with:
            trial, says = TRIALS_FOR.get(cause.name, TRIALS_FOR["unexplained"])
            return NextExperiment(
                trial,
                f"{cause.name} cannot be told from {' or '.join(cause.confused_with)} here: {says} "
                f"({cause.confirm})",
            )
    if best.rivals:
        trial, says = TRIALS_FOR["unexplained"]
        return NextExperiment(trial, f"structure is left that no cause has: {says}")
    return None
