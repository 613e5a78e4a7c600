"""A cause that was named: its numbers, intervals and other forms."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from ..identification.fitted_law import LAWS
from ..plant import ball_screw, direct_drive
from .acceptance import Accepted
from .causes import CAUSES
from .causes.cause import Shape
from .diagnosis import FoundCause, Level
from .drive_model import DriveModel
from .evidence import Prior, conditioned, fit
from .explanation import Explanation, amplitudes, bring_of, own_size, scores, without
from .faultless import RecordKind, p_value
from .held_out import HeldOut
from .plausibility import crossed
from .problem import Problem
from .regression import filters, responses, whitened
from .residuals import Residual
from .search import Situation

Vector = npt.NDArray[np.float64]

SMALLEST = 0.05  # of the friction: size at which a cause is asked to show
SEEN = 5.0  # standard deviations
FREED_SHOWN = 0.1  # of a value that may be wrong
_EXACT = 0.04  # relative, to which no size is known: laws and shapes are not exact
_AS_GOOD_A_FORM = 0.9  # of what a cause brings, that its other form brings in its place
UNITS = {p.name: p.unit for p in (*ball_screw.PARAMETERS, *direct_drive.PARAMETERS)} | {
    name: unit
    for law in LAWS.values()
    for name, unit in zip(law.parameters, law.units, strict=True)
}


def level(found: Residual) -> Level:
    return Level(found.force_rms, found.position_rms)


def found_cause(
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
        before=level(held.without[name]),
        after=level(held.all),
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
    mine = whole_force(problem.model, member.shape)
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
            force = whole_force(problem.model, c.shape) @ found
            out.append(np.asarray(np.linalg.lstsq(mine, force, rcond=None)[0], dtype=np.float64))
    return out


def whole_force(model: DriveModel, shape: Shape) -> Vector:
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
