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
from scipy.optimize import minimize_scalar
from scipy.stats import f as fisher

from .causes import CAUSES
from .causes.cause import Shape
from .course import Course, Noise
from .drive_model import DriveModel
from .evidence import Columns, Prior, conditioned, evidence_of, fit, gain, side_by_side, weigh
from .regression import Added, Filter, edges, filters, response, sensitivities, surprises
from .rivals import rivals
from .threads import in_threads

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

PRICE = 7.0  # of the first name, in natural logarithms of the odds
NEXT_PRICE = 11.0  # of each further one: two things wrong at once are rarer than one
RIVALS_PRICE = 5.0  # what has a shape for everything has to be better by so much
_FREED = 0.3  # relative spread of a value that may be anything
_MORE_MASS = 0.2  # spread of an unknown mass, relative to all that moves
NEARLY = 0.8  # share of what anything explains that causes have to explain to be believed
_LEFT_OVER = 0.12  # share of a rival's evidence that a name beside it has to bring
_KEPT = 4  # sets of each size that are grown
_LOOKED_AT = 40  # sets of each size that are looked at closely
LARGEST = 4  # members of a set
MOST_CAUSES = 8  # of a set of causes alone: a real machine has more than one fault
MOST_CANCELLED = 4.0  # squares of what members bring, over that of what they bring together
NEAR = 3.0  # sets whose odds differ by less, in natural logarithms, cannot be told apart


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
        The signal (column 0), the adjustable values (next) and the candidates.
    model : DriveModel
        Around which it is linear.
    names : tuple of str
        Adjustable values.
    prior : Prior
        Of their relative changes from those of `model`.
    free : ndarray
        Spreads of values that may be anything.
    candidates : list of Candidate
    """

    columns: Columns
    model: DriveModel
    names: tuple[str, ...]
    prior: Prior
    free: Vector
    candidates: list[Candidate]


def state_problem(
    courses: Sequence[Course],
    model: DriveModel,
    believed: DriveModel,
    noise: Noise,
    found: Sequence[Candidate] = (),
) -> Problem:
    """The problem around a model's values, whose priors are those believed.

    What was `found` before is tried again with the values it had, beside the points of the grids.
    """
    made = filters(courses, model, noise)
    nothing = Added.nothing(courses)
    signal = surprises(courses, model, made, nothing)
    names = model.adjustable
    blocks = [signal[:, None], sensitivities(courses, model, made, nothing)]
    at = 1 + len(names)
    candidates = []
    asked = [
        (cause, values)
        for cause in CAUSES.values()
        if not cause.beyond(courses, model)
        for values in cause.grid(courses, model)
    ]
    asked += [
        (CAUSES[c.name], c.shape.values) for c in found if not c.is_rival and CAUSES[c.name].refined
    ]
    shapes = in_threads(lambda one: one[0].at(courses, model, one[1]), asked)
    named = [
        (cause.name, s, False)
        for (cause, _), s in zip(asked, shapes, strict=True)
        if not s.freed or s.freed in names  # a value that is certain is no cause
    ]
    named += [(r.name, shape, True) for r in rivals(courses, model) for shape in r.shapes]
    shown = in_threads(lambda n: None if n[1].freed else response(courses, made, n[1]), named)
    for (name, shape, is_rival), block in zip(named, shown, strict=True):
        if block is None:
            column = 1 + names.index(shape.freed or "")
            candidates.append(Candidate(name, shape, np.array([column])))
            continue
        count = len(shape.amplitudes)
        blocks.append(block)
        candidates.append(Candidate(name, shape, np.arange(at, at + count), is_rival))
        at += count
    columns = Columns(tuple(blocks), tuple(edges(courses)))
    mean = np.array([believed.values[n] / model.values[n] - 1.0 for n in names])
    spread = np.array([believed.tolerance[n] for n in names]) / math.sqrt(3.0)
    prior = Prior(np.arange(1, len(names) + 1), mean, spread)
    free = free_spreads(model)
    return Problem(columns, model, names, prior, free, candidates)


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


def choose(problem: Problem, used: Mask | None = None, largest: int = LARGEST) -> Choice:
    """The set of causes that explains the used stretches best.

    Two searches: among causes, and among causes and rivals. What causes explain nearly as well as
    anything does is theirs, since their equations are idealized and the rivals fit everything; what
    rivals explain beyond is added to it.
    """
    products = problem.columns.products(used)
    empty = _nothing(problem, products)
    causes = [c for c in problem.candidates if not c.is_rival]
    rivals_too = [c for c in problem.candidates if c.is_rival]
    most = largest if largest < LARGEST else MOST_CAUSES
    named = _search(problem, products, empty, causes, most)
    free = _search(problem, products, empty, problem.candidates, largest)
    best = free[0]
    chosen: Explanation | None = None
    if named[0].score - empty.score >= NEARLY * (best.score - empty.score):
        causes_alone = pruned(problem, products, named[0])
        more = _search(problem, products, causes_alone, rivals_too, 2)[0]
        # where rivals are needed all the same, the causes have to be worth their names
        if not more.rivals or more.score > best.score:
            chosen = _ordered(problem, products, more)
    chosen = chosen or pruned(problem, products, best)
    alone = {}
    for only in (named, free):
        for e in only:
            if len(e.members) == 1:
                alone[e.names[0]] = e.gains[0]
    others = sorted([*named, *free], key=lambda e: -e.score)
    return Choice(chosen, others, alone)


def _nothing(problem: Problem, products: Matrix) -> Explanation:
    base = conditioned(products, [problem.prior])
    return Explanation((), (problem.prior,), base.evidence, ())


def again(problem: Problem, names: Sequence[str]) -> Explanation:
    """The explanation by these names, however many."""
    products = problem.columns.products()
    explanation = _nothing(problem, products)
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
        ranked = [e for e in ranked[:_LOOKED_AT] if _stands(problem, products, e)]
        beam = ranked[:_KEPT]
        seen += ranked if size == 0 else ranked[: 4 * _KEPT]
        if not beam or beam[0].score < max(e.score for e in seen) - NEXT_PRICE:
            break
    return sorted(seen, key=lambda e: -e.score)


def _stands(problem: Problem, products: Matrix, explanation: Explanation) -> bool:
    """Whether values that may be anything are still such as a drive can have.

    A mass or a resistance below zero is none. And a large change that others cancel can fit
    anything, far beyond where a value acts linearly.
    """
    freed = [int(m.columns[0]) for m in explanation.members if m.shape.freed]
    if not freed:
        return True
    fitted = fit(products, list(explanation.priors))
    if np.any(fitted.amplitude[np.isin(fitted.columns, freed)] <= -1.0):
        return False
    return _cancelled(problem, products, explanation) < MOST_CANCELLED


def _cancelled(problem: Problem, products: Matrix, explanation: Explanation) -> float:
    """Squares of what the members bring, over the square of what they bring together."""
    freed = [int(m.columns[0]) - 1 for m in explanation.members if m.shape.freed]
    spread = problem.prior.spread.copy()
    spread[freed] = 1e-9 * spread[freed]  # what is a member's is not the values'
    values = Prior(problem.prior.columns, problem.prior.mean, spread)
    left = conditioned(products, [values]).products
    fitted = fit(products, list(explanation.priors))
    amplitude = dict(zip(fitted.columns.tolist(), fitted.amplitude, strict=True))
    parts = []
    for m in explanation.members:
        part = np.zeros(len(products))
        mean = problem.prior.mean[int(m.columns[0]) - 1] if m.shape.freed else 0.0
        part[m.columns] = [amplitude[int(c)] - mean for c in m.columns]
        parts.append(part)
    whole = np.sum(parts, axis=0)
    alone = sum(float(p @ left @ p) for p in parts)
    return alone / max(float(whole @ left @ whole), 1e-300)


def pruned(problem: Problem, products: Matrix, best: Explanation) -> Explanation:
    """An explanation, in order, without the members that later ones made needless."""
    best = _ordered(problem, products, best)
    while len(best.members) > 1:
        rivals_gains = sum(g for m, g in zip(best.members, best.gains, strict=True) if m.is_rival)
        needless = [
            k
            for k, (m, g) in enumerate(zip(best.members, best.gains, strict=True))
            if g < NEXT_PRICE + (RIVALS_PRICE if m.is_rival else _LEFT_OVER * rivals_gains)
        ]
        if not needless:
            break
        best = _ordered(problem, products, _without(problem, best, needless[-1]))
    return best


def _ordered(problem: Problem, products: Matrix, best: Explanation) -> Explanation:
    """The members in the order of what the evidence would lose without each."""
    whole = evidence_of(products, best.priors)
    loses = [
        whole - evidence_of(products, _without(problem, best, k).priors)
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
    left = conditioned(products, list(start.priors))
    found: dict[str, list[tuple[float, Candidate, tuple[Prior, ...]]]] = {}
    for c in candidates:
        if c.name in start.names:
            continue
        if c.shape.freed:
            k = int(c.columns[0]) - 1
            first = start.priors[0]
            if first.spread[k] != problem.prior.spread[k]:
                continue
            spread = first.spread.copy()
            spread[k] = problem.free[k]
            freed = (Prior(first.columns, first.mean, spread), *start.priors[1:])
            bring = evidence_of(products, freed) - left.evidence
            found.setdefault(c.name, []).append((bring, c, freed))
            continue
        if c.shape.sure is not None:
            mean, spread = np.ones(len(c.columns)), np.full(len(c.columns), c.shape.sure)
            bring = gain(left.products, c.columns, mean, spread)
        else:
            weighed = weigh(left.products, c.columns)
            mean, spread, bring = np.zeros(len(c.columns)), weighed.spread, weighed.gain
        priors = (*start.priors, Prior(c.columns, mean, spread))
        found.setdefault(c.name, []).append((bring, c, priors))
    out = {}
    for name, options in found.items():
        best = max(options, key=lambda o: o[0])
        # one of many shapes was to be picked as well
        brings = float(np.logaddexp.reduce([o[0] for o in options])) - math.log(len(options))
        price = NEXT_PRICE if start.members else PRICE
        if best[1].is_rival:
            price += RIVALS_PRICE
        else:
            # what a shapeless force leaves over of a large structure is no sign of a cause
            price += _LEFT_OVER * sum(
                g for m, g in zip(start.members, start.gains, strict=True) if m.is_rival
            )
        out[name] = Explanation(
            (*start.members, best[1]),
            best[2],
            start.score + brings - price,
            (*start.gains, brings),
        )
    return out


def refine(
    problem: Problem,
    explanation: Explanation,
    courses: Sequence[Course],
    model: DriveModel,
    made: Sequence[Filter],
) -> tuple[Problem, Explanation]:
    """The explanation with its causes' nonlinear values found between the points of their grids."""
    for k, m in enumerate(explanation.members):
        if not (m.is_rival or m.shape.freed) and CAUSES[m.name].refined:
            problem, explanation = _refined_member(problem, explanation, k, courses, model, made)
    return problem, explanation


def _refined_member(
    problem: Problem,
    explanation: Explanation,
    k: int,
    courses: Sequence[Course],
    model: DriveModel,
    made: Sequence[Filter],
) -> tuple[Problem, Explanation]:
    member = explanation.members[k]
    cause = CAUSES[member.name]
    key = cause.refined or ""
    points = sorted(c.shape.values[key] for c in problem.candidates if c.name == member.name)
    here = points.index(member.shape.values[key])
    low = points[max(here - 1, 0)] * (0.7 if here == 0 else 1.0)
    high = points[min(here + 1, len(points) - 1)] * (1.4 if here + 1 == len(points) else 1.0)
    others = _without(problem, explanation, k)
    used = np.concatenate([[0], *(p.columns for p in others.priors)]).astype(np.int64)
    base = problem.columns.of(used)
    inner = problem.columns.products()[np.ix_(used, used)]
    moved, at = side_by_side(others.priors), len(used)

    fixed = dict(member.shape.values)
    if member.shape.sure is None:
        # how it is linear depends on how large it is
        fitted = fit(problem.columns.products(), list(explanation.priors))
        size = fitted.amplitude[np.isin(fitted.columns, member.columns)]
        fixed |= dict(zip(member.shape.amplitudes, size.tolist(), strict=True))

    def bring(value: float) -> tuple[float, Shape, Matrix, Vector]:
        shape = cause.at(courses, model, {**fixed, key: value})
        columns = response(courses, made, shape)
        cross = base.T @ columns
        products = np.block([[inner, cross], [cross.T, columns.T @ columns]])
        rest = conditioned(products, moved).products
        mine = np.arange(at, at + columns.shape[1])
        if shape.sure is not None:
            spread = np.full(len(mine), 0.02)  # between the grid's points the size is the value's
            return gain(rest, mine, np.ones(len(mine)), spread), shape, columns, spread
        weighed = weigh(rest, mine)
        return weighed.gain, shape, columns, weighed.spread

    found = minimize_scalar(
        lambda q: -bring(math.exp(q))[0],
        bounds=(math.log(low), math.log(high)),
        method="bounded",
        options={"xatol": 0.02 * math.log(high / low), "maxiter": 10},
    )
    between, at_point = bring(math.exp(float(found.x))), bring(member.shape.values[key])
    # where the evidence has several peaks, the search may have come down on a lower one
    _, shape, columns, spread = between if between[0] > at_point[0] else at_point
    candidate = replace(member, shape=shape)
    problem = replace(
        problem,
        columns=problem.columns.exchanged(int(candidate.columns[0]), columns),
        candidates=[candidate if c is member else c for c in problem.candidates],
    )
    mean = np.full(len(spread), 1.0 if shape.sure is not None else 0.0)
    priors = (*others.priors, Prior(candidate.columns, mean, spread))
    members = tuple(candidate if j == k else m for j, m in enumerate(explanation.members))
    return problem, replace(explanation, members=members, priors=priors)


def amplitudes(problem: Problem, explanation: Explanation, used: Mask | None = None) -> Vector:
    """Most likely amplitudes of all columns, zero where an explanation has none, shape (c,)."""
    fitted = fit(problem.columns.products(used), list(explanation.priors))
    out = np.zeros(problem.columns.count)
    out[fitted.columns] = fitted.amplitude
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
    others = _without(problem, explanation, member)
    products = problem.columns.products()
    fitted = fit(products, list(others.priors))
    mine = np.isin(fitted.columns, columns)  # a freed value stays where it was believed to be
    amplitude = fitted.amplitude.copy()
    amplitude[mine] = 0.0
    mean = np.concatenate([p.mean for p in others.priors])
    amplitude[mine] = mean[mine]
    rest = fitted.columns[~mine]
    precision = np.diag(np.concatenate([p.spread for p in others.priors])[~mine] ** -2.0)
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


def p_value(problem: Problem, explanation: Explanation, member: int) -> float:
    """Chance of as large an effect of a member by accident, the others given.

    Standard errors are as wide as the stretches' scatter says, and never narrower than white noise
    would make them. Times the number of causes that were looked at.
    """
    found = scores(problem, explanation, member)
    count, m = found.by_stretch.shape
    if count <= m + 1:
        return 1.0
    amplitude = found.estimate()
    size = float(amplitude @ found.information @ amplitude) / found.widening() ** 2
    value = float(fisher.sf(size / m, m, count - m))
    return min(1.0, value * len({c.name for c in problem.candidates if not c.is_rival}))


def restricted_to(
    problem: Problem, explanation: Explanation, names: Collection[str]
) -> Explanation:
    """The explanation with the members of these names only."""
    for k in reversed(range(len(explanation.members))):
        if explanation.members[k].name not in names:
            explanation = _without(problem, explanation, k)
    return explanation


def _without(problem: Problem, explanation: Explanation, member: int) -> Explanation:
    members = tuple(c for k, c in enumerate(explanation.members) if k != member)
    base = explanation.priors[0]
    gone = explanation.members[member]
    if gone.shape.freed:
        spread = base.spread.copy()
        k = int(gone.columns[0]) - 1
        spread[k] = problem.prior.spread[k]
        priors = (Prior(base.columns, base.mean, spread), *explanation.priors[1:])
        return Explanation(members, priors, explanation.score, ())
    kept = tuple(p for p in explanation.priors[1:] if not np.array_equal(p.columns, gone.columns))
    return Explanation(members, (base, *kept), explanation.score, ())
