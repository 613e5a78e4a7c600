"""Which causes explain a study, if any: a search over small sets, weighed by evidence.

All sets of a size are not tried: the best few of each size are kept and grown. A set pays for each
member what naming one of so many costs, so that records without an effect are left without a name.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from .causes import CAUSES
from .causes.cause import Shape
from .course import Course
from .drive_model import DriveModel
from .evidence import (
    Columns,
    Prior,
    conditioned,
    evidence_of,
    fit,
    fit_within,
    gain,
    side_by_side,
    weigh,
)
from .regression import (
    Added,
    Noise,
    calibrated,
    edges,
    filters,
    fitted_noise,
    leftovers,
    responses,
    sensitivities,
    whitened,
)
from .rivals import rivals

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

PRICE = 7.0  # of the first name, in natural logarithms of the odds
NEXT_PRICE = 11.0  # of each further one: two things wrong at once are rarer than one
_BESIDE = 0.02  # of the largest name's evidence, that a further one has to bring
RIVALS_PRICE = 5.0  # what has a shape for everything has to be better by so much
_FREED = 0.3  # relative spread of a value that may be anything
_MORE_MASS = 2.0  # spread of an unknown mass, relative to all that moves
_KEPT = 4  # sets of each size that are grown
_LOOKED_AT = 40  # sets of each size that are looked at closely
LARGEST = 7  # members of a set: real machines have several things wrong at once
_BESIDE_NOISE = 3  # causes that noise is sought beside
MOST_CANCELLED = 1.5  # squares of what members bring, over that of what they bring together
FREE_RANGE = (0.3, 3.0)  # of a value that may be wrong, to the believed one
_ANY = 1.0  # relative spread of values that take all they can, where noise is sought
_MUCH = 0.1  # of what is left, that one more cause has to explain there
_HELD = 1e-3  # of its spread, to one that stands at the end of what is believed
OWN = (0.6, 1.6)  # amplitude of a cause whose shape has its size in it
_PER_AMPLITUDE = 3.0  # evidence that one amplitude more in a form has to bring
_INEXACT = 1e-3  # the same as a share of all that the form brings: no form is just right
_ROUGHLY = (0.3, 3.0)  # the same at a point of a grid, next to the size


@dataclass(frozen=True)
class Candidate:
    """A shape of a cause, or of a rival, as columns of the problem."""

    name: str
    shape: Shape
    columns: npt.NDArray[np.int64]
    is_rival: bool = False


@dataclass(frozen=True)
class Problem:
    """Everything that is compared, linear in its amplitudes.

    Attributes
    ----------
    columns : Columns
        The signal (column 0), the adjustable values (next), the calibrations and the candidates.
    model : DriveModel
        Around which it is linear.
    names : tuple of str
        Adjustable values.
    prior : Prior
        Of their relative changes from those of `model`, and of the calibrations.
    low, high : ndarray
        How far these may change: tolerances are hard.
    free : ndarray
        Spreads of values that may be anything.
    candidates : list of Candidate
    believed : DriveModel
    noise : Noise
        That makes the columns white.
    """

    columns: Columns
    model: DriveModel
    names: tuple[str, ...]
    prior: Prior
    low: Vector
    high: Vector
    free: Vector
    candidates: list[Candidate]
    believed: DriveModel
    noise: Noise


def state_problem(
    courses: Sequence[Course],
    model: DriveModel,
    believed: DriveModel,
    noise: Noise,
    found: Sequence[Candidate] | None = None,
) -> Problem:
    """The problem around a model's values, whose priors are those believed.

    What was `found` before is tried again with the values it had, beside the points of the grids.
    Where nothing is known of that, noise is sought beside all that the candidates can explain.
    """
    names = model.adjustable
    nothing = Added.nothing(courses)
    left = leftovers(courses, model, nothing)
    parts = [[y[:, :, None] for y in left], sensitivities(courses, model, nothing)]
    asked = [
        (cause, values)
        for cause in CAUSES.values()
        if not cause.beyond(courses, model)
        for values in cause.grid(courses, model)
    ]
    before = [(CAUSES[c.name], c.shape.values) for c in found or () if not c.shape.freed]
    asked += [one for one in before if one not in asked]
    shapes = [cause.at(courses, model, values) for cause, values in asked]
    named = [
        (cause.name, s, False)
        for (cause, _), s in zip(asked, shapes, strict=True)
        if set(s.freed) <= set(names)  # a value that is certain is no cause
    ]
    named += [(r.name, shape, True) for r in rivals(courses, model) for shape in r.shapes]
    shown = [None if s.freed else responses(courses, model, s) for _, s, _ in named]
    candidates = []
    at = 1 + len(names) + len(calibrated(courses))
    for (name, shape, is_rival), part in zip(named, shown, strict=True):
        if part is None:
            columns_of = [1 + names.index(n) for n in shape.freed]
            candidates.append(Candidate(name, shape, np.array(columns_of)))
            continue
        count = len(shape.amplitudes)
        parts.append(part)
        candidates.append(Candidate(name, shape, np.arange(at, at + count), is_rival))
        at += count
    prior = _prior(courses, model, believed)
    if found is None:
        own = [c for c in candidates if not (c.is_rival or c.shape.freed)]
        last = max((int(c.columns[-1]) for c in own), default=len(prior.mean))
        count = int(np.searchsorted(np.cumsum([p[0].shape[2] for p in parts]), last + 1)) + 1
        noise = _least_noise(courses, model, noise, parts[:count], prior, own)
    made = filters(courses, noise)
    blocks = tuple(whitened(made, part) for part in parts)
    return Problem(
        Columns(blocks, tuple(edges(courses))),
        model,
        names,
        prior,
        *bounds(believed, model, (), courses),
        free_spreads(model),
        candidates,
        believed,
        noise,
    )


def _prior(courses: Sequence[Course], model: DriveModel, believed: DriveModel) -> Prior:
    """Of relative changes of values, and of calibrations, around a model."""
    mean = believed_changes(believed, model, courses)
    spread = np.array([believed.tolerance[n] for n in model.adjustable]) / math.sqrt(3.0)
    spread = np.append(spread, [d.spread for d in calibrated(courses).values()])
    return Prior(np.arange(1, len(mean) + 1), mean, spread)


def _least_noise(
    courses: Sequence[Course],
    model: DriveModel,
    noise: Noise,
    parts: Sequence[Sequence[Matrix]],
    prior: Prior,
    causes: Sequence[Candidate],
) -> Noise:
    """The noise beside all that free values and a few causes, taken greedily, can explain.

    An autoregression fitted to an effect foretells it and hides it, a periodic one most of all.

    Parameters
    ----------
    parts : sequence of list of ndarray, shape (windows, channels, m)
        What is left of each record's balances, first; then the columns, in their order.
    causes : sequence of Candidate
        Those with columns of their own.
    """
    plain = filters(courses, replace(noise, weights=np.zeros_like(noise.weights)))
    columns = np.column_stack([whitened(plain, part) for part in parts])
    products = columns.T @ columns
    values = len(model.adjustable)
    spread = prior.spread.copy()
    spread[:values] = np.maximum(spread[:values], _ANY)
    taken = [replace(prior, spread=spread)]
    for _ in range(_BESIDE_NOISE):
        left = conditioned(products, taken)
        explained = [_explained(*left.of(c.columns)) for c in causes]
        best = int(np.argmax(explained))
        if explained[best] < _MUCH * left.squares:
            break
        chosen = causes[best].columns
        size = np.sqrt(left.squares / np.maximum(np.diag(left.of(chosen)[0]), 1e-300))
        taken.append(Prior(chosen, np.zeros(len(chosen)), 10.0 * size))
    fitted = fit(products, taken)
    amplitude = np.zeros(columns.shape[1])
    amplitude[0] = -1.0
    amplitude[fitted.columns] = fitted.amplitude
    ends = np.cumsum([p[0].shape[2] for p in parts])
    sizes = np.split(amplitude, ends[:-1])
    rest = [
        -np.sum([part[r] @ size for part, size in zip(parts, sizes, strict=True)], axis=0)
        for r in range(len(courses))
    ]
    return fitted_noise(courses, model, rest)


def _explained(inner: Matrix, signal: Vector) -> float:
    """Squares of the signal that columns take away by least squares, see `Conditioned.of`."""
    ridge = (1e-9 * np.trace(inner) + 1e-300) * np.eye(len(signal))
    return float(signal @ np.linalg.solve(inner + ridge, signal))


def believed_changes(believed: DriveModel, model: DriveModel, courses: Sequence[Course]) -> Vector:
    """Changes that lead from a model and a calibration back to what was believed."""
    values = [believed.values[n] / model.values[n] - 1.0 for n in model.adjustable]
    return np.array([*values, *(-courses[0].calibration[n] for n in calibrated(courses))])


def bounds(
    believed: DriveModel, model: DriveModel, freed: Collection[str], courses: Sequence[Course]
) -> tuple[Vector, Vector]:
    """How far values and calibrations may still change: to the ends of what is believed.

    Tolerances are hard, and a freed value has a range, too.
    """
    low, high = [], []
    for n in model.adjustable:
        tolerance = believed.tolerance[n]
        ends = (1.0 - tolerance, 1.0 + tolerance)
        if n in freed:
            ends = _free_range(n)
        ratio = believed.values[n] / model.values[n]
        low.append(ends[0] * ratio - 1.0)
        high.append(ends[1] * ratio - 1.0)
    for n, doubt in calibrated(courses).items():
        now = courses[0].calibration[n]
        low.append(doubt.low - now)
        high.append(doubt.high - now)
    return np.array(low), np.array(high)


def _free_range(name: str) -> tuple[float, float]:
    """Of a value that may be wrong, to the believed one; a mass may be anything."""
    return (0.1, math.inf) if name == "m" else FREE_RANGE


def free_spreads(model: DriveModel) -> Vector:
    """Relative spread of each adjustable value when it may be anything."""
    mass = _MORE_MASS * model.inertia / model.values["m"]
    return np.array([mass if n == "m" else _FREED for n in model.adjustable])


@dataclass(frozen=True)
class Explanation:
    """A set of candidates with the spreads under which it was weighed.

    Attributes
    ----------
    members : tuple of Candidate
        In order of gain.
    priors : tuple of Prior
        Of the adjustable values first, then of each member that has columns of its own.
    score : float
        Evidence less the price of the names.
    gains : tuple of float
        Evidence that each member brought when it was taken in.
    """

    members: tuple[Candidate, ...]
    priors: tuple[Prior, ...]
    score: float
    gains: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(m.name for m in self.members)

    @property
    def causes(self) -> tuple[str, ...]:
        return tuple(m.name for m in self.members if not m.is_rival)

    @property
    def rivals(self) -> tuple[str, ...]:
        return tuple(m.name for m in self.members if m.is_rival)


@dataclass(frozen=True)
class Choice:
    """The best explanation, and those it cannot be told from.

    Attributes
    ----------
    best : Explanation
    others : list of Explanation
        All that were looked at, best first.
    alone : mapping of str to float
        Evidence of each name by itself over nothing.
    """

    best: Explanation
    others: list[Explanation]
    alone: Mapping[str, float] = field(default_factory=dict)


def choose(problem: Problem, largest: int = LARGEST) -> Choice:
    """The set of causes that explains the records best.

    Of causes only; what each shapeless rival explains by itself is told beside it.
    """
    products = problem.columns.products()
    empty = nothing_in(problem)
    causes = [c for c in problem.candidates if not c.is_rival]
    named = _search(problem, products, empty, causes, largest)
    free = _search(problem, products, empty, [c for c in problem.candidates if c.is_rival], 1)
    chosen = pruned(problem, products, named[0])
    alone = {}
    for only in (named, free):
        for e in only:
            if len(e.members) == 1:
                alone[e.names[0]] = e.gains[0]
    others = sorted([*named, *free], key=lambda e: -e.score)
    return Choice(chosen, others, alone)


def nothing_in(problem: Problem) -> Explanation:
    """The explanation without a name."""
    products = problem.columns.products()
    priors = within_bounds(problem, products, (), ())
    return Explanation((), priors, evidence_of(products, priors), ())


def strongest_alone(problem: Problem) -> float:
    """Evidence that the strongest cause brings by itself, in natural logarithms."""
    left = conditioned(problem.columns.products(), nothing_in(problem).priors)
    causes = [c for c in problem.candidates if not c.is_rival]
    return max((bring_of(c.shape, *left.of(c.columns))[0] for c in causes), default=0.0)


def within_bounds(
    problem: Problem, products: Matrix, members: Sequence[Candidate], own: Sequence[Prior]
) -> tuple[Prior, ...]:
    """Priors of values and members, in which values that would leave their bounds are held there.

    Parameters
    ----------
    own : sequence of Prior
        Of the members that have columns of their own.
    """
    freed = [int(c) - 1 for m in members if m.shape.freed for c in m.columns]
    mean, spread = problem.prior.mean.copy(), problem.prior.spread.copy()
    spread[freed] = problem.free[freed]
    low, high = problem.low.copy(), problem.high.copy()
    low[freed], high[freed] = -np.inf, np.inf
    found = fit_within(products, [Prior(problem.prior.columns, mean, spread), *own], low, high)
    held = (found <= low) | (found >= high)
    mean[held] = found[held]
    spread[held] *= _HELD
    return (Prior(problem.prior.columns, mean, spread), *own)


def grown(problem: Problem, start: Explanation) -> dict[str, Explanation]:
    """The explanation with one more name, for each name there is, in a form that stands."""
    products = problem.columns.products()
    more = _grow(problem, products, start, problem.candidates)
    return {n: e for n, e in more.items() if stands(problem, products, e)}


def beside(problem: Problem, start: Explanation, member: Candidate) -> Explanation:
    """The explanation with one more candidate, or as it is where that is in it already."""
    found = _grow(problem, problem.columns.products(), start, [member])
    return found.get(member.name, start)


def loosened(problem: Problem, explanation: Explanation, name: str) -> Explanation:
    """The explanation with all forms of a cause beside it, together, of any amplitudes.

    What a cause has in a form that is only nearly right, it has here. Forms that have their size
    in them are left out: with other amplitudes they are another cause.
    """
    forms = [
        c.columns
        for c in problem.candidates
        if c.name == name and not c.shape.freed and c.shape.sure is None
    ]
    columns = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *forms]))
    taken = np.concatenate([p.columns for p in explanation.priors[1:]] or [columns[:0]])
    columns = np.setdiff1d(columns, taken)
    if not len(columns):
        return explanation
    products = problem.columns.products()
    spread = weigh(*conditioned(products, explanation.priors).of(columns)).spread
    own = (*explanation.priors[1:], Prior(columns, np.zeros(len(columns)), spread))
    return replace(explanation, priors=within_bounds(problem, products, explanation.members, own))


def with_one_value(problem: Problem, explanation: Explanation) -> Explanation | None:
    """The explanation with one value wrong where it has several, if it has.

    Which values are wrong can be told once they are adjusted only: they act together.
    """
    several = [k for k, m in enumerate(explanation.members) if len(m.shape.freed) > 1]
    if not several:
        return None
    name = explanation.members[several[0]].name
    ones = [c for c in problem.candidates if c.name == name and len(c.shape.freed) == 1]
    rest = without(problem, explanation, several[0])
    return _grow(problem, problem.columns.products(), rest, ones).get(name)


def again(problem: Problem, names: Sequence[str]) -> Explanation:
    """The explanation by these names, however many."""
    products = problem.columns.products()
    explanation = nothing_in(problem)
    for name in names:
        mine = [c for c in problem.candidates if c.name == name]
        explanation = _grow(problem, products, explanation, mine).get(name, explanation)
    return _ordered(problem, products, explanation)


def _search(
    problem: Problem,
    products: Matrix,
    start: Explanation,
    candidates: Sequence[Candidate],
    largest: int,
) -> list[Explanation]:
    """Explanations grown from one by up to `largest` more names, best first."""
    beam, seen = [start], [start]
    for size in range(largest):
        grown: dict[frozenset[str], Explanation] = {}
        for e in beam:
            for name, more in _grow(problem, products, e, candidates).items():
                key = frozenset((*e.names, name))
                if key not in grown or grown[key].score < more.score:
                    grown[key] = more
        ranked = sorted(grown.values(), key=lambda e: -e.score)
        ranked = [e for e in ranked[:_LOOKED_AT] if stands(problem, products, e)]
        beam = ranked[:_KEPT]
        seen += ranked if size == 0 else ranked[: 4 * _KEPT]
        if not beam or beam[0].score < max(e.score for e in seen) - NEXT_PRICE:
            break
    return sorted(seen, key=lambda e: -e.score)


def stands(problem: Problem, products: Matrix, explanation: Explanation) -> bool:
    """Whether values that may be anything are still such as a drive can have.

    A mass or a resistance below zero is none. And a large change that others cancel can fit
    anything, far beyond where a value acts linearly.
    """
    for k, m in enumerate(explanation.members):
        if (
            m.shape.sure is not None
            and not _ROUGHLY[0] < own_size(problem, products, explanation, k) < _ROUGHLY[1]
        ):
            return False
    if not can_be(problem, explanation):
        return False
    freed = any(m.shape.freed for m in explanation.members)
    if not freed and len(explanation.members) < 2:
        return True
    return cancelled(problem, products, explanation) < MOST_CANCELLED


def can_be(problem: Problem, explanation: Explanation) -> bool:
    """Whether values that may be anything are within the range of what can be wrong."""
    fitted = amplitudes(problem, explanation)
    for m in explanation.members:
        if not m.shape.freed:
            continue
        for n, c in zip(m.shape.freed, m.columns, strict=True):
            size = (1.0 + fitted[c]) * problem.model.values[n] / problem.believed.values[n]
            low, high = _free_range(n)
            if not low < size < high:
                return False
    return True


def _beside(explanation: Explanation, member: int) -> list[Prior]:
    """Priors of all but a member's own, values held or not as they are with it."""
    gone = explanation.members[member].columns
    return [p for p in explanation.priors if not np.array_equal(p.columns, gone)]


def own_size(problem: Problem, products: Matrix, explanation: Explanation, member: int) -> float:
    """Amplitude of a cause whose shape has its size in it, as the data alone have it."""
    column = explanation.members[member].columns[:1]
    inner, signal = conditioned(products, _beside(explanation, member)).of(column)
    return float(signal[0] / max(inner[0, 0], 1e-300))


def evidence_brought(problem: Problem, before: Explanation, after: Explanation) -> float:
    """By how much one explanation is more likely than another, in natural logarithms."""
    products = problem.columns.products()
    return evidence_of(products, after.priors) - evidence_of(products, before.priors)


def cancelled(problem: Problem, products: Matrix, explanation: Explanation) -> float:
    """Squares of what the members bring, over the square of what they bring together."""
    freed = [int(c) - 1 for m in explanation.members if m.shape.freed for c in m.columns]
    spread = problem.prior.spread.copy()
    spread[freed] = 1e-9 * spread[freed]  # what is a member's is not the values'
    values = Prior(problem.prior.columns, problem.prior.mean, spread)
    columns = np.concatenate([m.columns for m in explanation.members])
    left, _ = conditioned(products, [values]).of(columns)
    fitted = fit(products, explanation.priors)
    amplitude = dict(zip(fitted.columns.tolist(), fitted.amplitude, strict=True))
    alone, whole, at = 0.0, np.zeros(len(columns)), 0
    for m in explanation.members:
        mean = problem.prior.mean[m.columns - 1] if m.shape.freed else 0.0
        mine = np.array([amplitude[int(c)] for c in m.columns]) - mean
        for own in np.diag(mine) if m.shape.freed else mine[None, :]:  # values may cancel, too
            part = np.zeros(len(columns))
            part[at : at + len(mine)] = own
            alone += float(part @ left @ part)
            whole += part
        at += len(mine)
    return alone / max(float(whole @ left @ whole), 1e-300)


def pruned(problem: Problem, products: Matrix, best: Explanation) -> Explanation:
    """An explanation, in order, without the members that later ones made needless."""
    best = _ordered(problem, products, best)
    while len(best.members) > 1:
        needless = [k for k, g in enumerate(best.gains) if g < NEXT_PRICE]
        if not needless:
            break
        best = _ordered(problem, products, without(problem, best, needless[-1]))
    return best


def _ordered(problem: Problem, products: Matrix, best: Explanation) -> Explanation:
    """The members in the order of what the evidence would lose without each."""
    whole = evidence_of(products, best.priors)
    loses = [
        whole - evidence_of(products, without(problem, best, k).priors)
        for k in range(len(best.members))
    ]
    order = sorted(range(len(loses)), key=lambda k: -loses[k])
    return replace(
        best,
        members=tuple(best.members[k] for k in order),
        gains=tuple(float(loses[k]) for k in order),
    )


def _grow(
    problem: Problem, products: Matrix, start: Explanation, candidates: Sequence[Candidate]
) -> dict[str, Explanation]:
    """The explanation with one more name, for each name."""
    left = conditioned(products, start.priors)
    found: dict[str, list[tuple[float, Candidate, tuple[Prior, ...]]]] = {}
    for c in candidates:
        if c.name in start.names:
            continue
        if c.shape.freed:
            if any(np.isin(c.columns, m.columns).any() for m in start.members if m.shape.freed):
                continue
            freed = within_bounds(problem, products, (*start.members, c), start.priors[1:])
            bring = evidence_of(products, freed) - left.evidence
            found.setdefault(c.name, []).append((bring, c, freed))
            continue
        bring, mean, spread = bring_of(c.shape, *left.of(c.columns))
        priors = (*start.priors, Prior(c.columns, mean, spread))
        found.setdefault(c.name, []).append((bring, c, priors))
    out = {}
    for name, options in found.items():
        # of forms that explain alike, the simplest
        most = max(o[0] for o in options)
        options.sort(key=lambda o: price_of_form(o[1], most) - o[0])
        best = next(
            (o for o in options if _apart(problem, products, start, o[1], o[2])), options[0]
        )
        # one of many shapes was to be picked as well
        brings = float(np.logaddexp.reduce([o[0] for o in options])) - math.log(len(options))
        price = max(NEXT_PRICE, _BESIDE * max(start.gains)) if start.members else PRICE
        if best[1].is_rival:
            price += RIVALS_PRICE
        members = (*start.members, best[1])
        out[name] = Explanation(
            members,
            within_bounds(problem, products, members, best[2][1:]),
            start.score + brings - price,
            (*start.gains, brings),
        )
    return out


def _apart(
    problem: Problem,
    products: Matrix,
    start: Explanation,
    member: Candidate,
    priors: tuple[Prior, ...],
) -> bool:
    """Whether values that may be anything together do not only cancel each other."""
    if len(member.shape.freed) < 2:
        return True
    alone = Explanation((member,), priors, start.score, (0.0,))
    return cancelled(problem, products, alone) < MOST_CANCELLED


def price_of_form(candidate: Candidate, most: float) -> float:
    """What a form of a cause has to bring more than a simpler one, the best bringing `most`."""
    each = max(_PER_AMPLITUDE, _INEXACT * most)
    return 0.0 if candidate.is_rival else each * len(candidate.columns)


def bring_of(shape: Shape, inner: Matrix, signal: Vector) -> tuple[float, Vector, Vector]:
    """Evidence that a shape brings, with the mean and the spread of its amplitudes."""
    if shape.sure is not None:
        mean, spread = np.ones(len(signal)), np.full(len(signal), shape.sure)
        return gain(inner, signal, mean, spread), mean, spread
    weighed = weigh(inner, signal)
    return weighed.gain, np.zeros(len(signal)), weighed.spread


def amplitudes(problem: Problem, explanation: Explanation, used: Mask | None = None) -> Vector:
    """Most likely amplitudes of all columns, zero where an explanation has none, shape (c,).

    From all stretches or those used, shape (stretches,).
    """
    columns = np.concatenate([[0], *(p.columns for p in explanation.priors)]).astype(np.int64)
    if used is None:
        products = problem.columns.products()[np.ix_(columns, columns)]
    else:
        products = problem.columns.by_stretch(columns)[used].sum(axis=0)
    out = np.zeros(problem.columns.count)
    out[columns[1:]] = fit(products, side_by_side(explanation.priors)).amplitude
    return out


@dataclass(frozen=True)
class Scores:
    """What each stretch says of a member's amplitudes, the other members given.

    Attributes
    ----------
    by_stretch : ndarray, shape (stretches, m)
    information : ndarray, shape (m, m)
    pieces : ndarray, shape (stretches, m, m)
        Of it, what each stretch brings.
    """

    by_stretch: Matrix
    information: Matrix
    pieces: npt.NDArray[np.float64]

    def estimate(self) -> Vector:
        """Amplitudes by least squares, without a prior."""
        total = self.by_stretch.sum(axis=0)
        return np.asarray(np.linalg.lstsq(self.information, total, rcond=None)[0])

    def widening(self) -> float:
        """By how much standard errors are larger than white noise would make them.

        From the scatter of what the stretches say once the member itself is in the model.
        """
        left = self.by_stretch - np.einsum("sij,j->si", self.pieces, self.estimate())
        found = float(np.trace(np.linalg.lstsq(self.information, left.T @ left, rcond=None)[0]))
        return math.sqrt(max(found / self.information.shape[0], 1.0))


def scores(problem: Problem, explanation: Explanation, member: int) -> Scores:
    """The scores of a member at the fit without it."""
    columns = explanation.members[member].columns
    if explanation.members[member].shape.sure is None:
        priors: Sequence[Prior] = without(problem, explanation, member).priors
    else:  # without a shape of its size, values would go to their bounds and stay there
        priors = _beside(explanation, member)
    products = problem.columns.products()
    fitted = fit(products, priors)
    mine = np.isin(fitted.columns, columns)  # a freed value stays where it was believed to be
    amplitude = fitted.amplitude.copy()
    amplitude[mine] = 0.0
    mean = np.concatenate([p.mean for p in priors])
    amplitude[mine] = mean[mine]
    rest = fitted.columns[~mine]
    precision = np.diag(np.concatenate([p.spread for p in priors])[~mine] ** -2.0)
    cross = products[np.ix_(rest, columns)]
    share = np.linalg.solve(products[np.ix_(rest, rest)] + precision, cross)
    weights = np.zeros((problem.columns.count, len(columns)))
    weights[columns, np.arange(len(columns))] = 1.0
    weights[rest] -= share
    left = np.zeros(problem.columns.count)
    left[0] = 1.0
    left[fitted.columns] -= amplitude
    used = np.unique(np.concatenate([[0], fitted.columns, columns]))
    inner = problem.columns.by_stretch(used)
    by_stretch = np.einsum("im,sij,j->sm", weights[used], inner, left[used])
    information = products[np.ix_(columns, columns)] - cross.T @ share
    pieces = np.einsum("im,sij,jk->smk", weights[used], inner, weights[used])
    return Scores(by_stretch, information, pieces)


def restricted_to(
    problem: Problem, explanation: Explanation, names: Collection[str]
) -> Explanation:
    """The explanation with the members of these names only."""
    for k in reversed(range(len(explanation.members))):
        if explanation.members[k].name not in names:
            explanation = without(problem, explanation, k)
    return explanation


def without(
    problem: Problem, explanation: Explanation, member: int, products: Matrix | None = None
) -> Explanation:
    """The explanation without one of its members."""
    products = problem.columns.products() if products is None else products
    members = tuple(c for k, c in enumerate(explanation.members) if k != member)
    gains = tuple(g for k, g in enumerate(explanation.gains) if k != member)
    gone = explanation.members[member].columns
    own = [p for p in explanation.priors[1:] if not np.array_equal(p.columns, gone)]
    priors = within_bounds(problem, products, members, own)
    return Explanation(members, priors, explanation.score, gains)
