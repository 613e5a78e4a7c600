"""Scores of hypotheses: how well each explains the residuals of a model on held-out blocks.

A hypothesis is a column in addition to those of the model's values. Changes of values have a cost
by their tolerances. The score is the log-likelihood of held-out blocks, less that without it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

from ...solver.arrays import Matrix, Vector
from .balance import moving, responses
from .bands import products
from .causes import CAUSES, EVERY, OUTSIDE, SIGNALS
from .causes.cause import Form
from .causes.free_curves import free_curves
from .fit import Fit, Priors, Study, base_columns, base_fit, fitted, less_noise, noise_of, trusted

_AROUND_ONE = 0.5  # largest deviation of the amplitude of a form of known size from one
_REFINED = 3  # halvings of a grid's spacing


class Gain(NamedTuple):
    """What a fit removes from another one's squares of a balance, on held-out blocks."""

    share: float  # in the used bands of the balance
    interval: tuple[float, float]  # 90 %, by leaving out one block at a time (jackknife)


@dataclass(frozen=True)
class Hypothesis:
    """A possible error of the model in its best form.

    Amplitudes are those of the form's own columns, or relative changes of the values that it frees.
    """

    form: Form
    amplitude: Vector  # shape (m,)
    error: Vector
    score: float  # gain in the log-likelihood of held-out blocks, less the cost of values [nats]
    gain: Gain  # in the balance of forces or of voltages, in which the share is larger
    doubt: float = 0.0  # last spacing of the grid of its size, as a logarithm
    lead: float = 0.0  # score less that of the best one of another entry [nats]
    certain: bool = False  # whether it is named
    alike: tuple[str, ...] = ()  # others of its entry that explain the data as well

    @property
    def name(self) -> str:
        return self.form.name


class Catalogue:
    """Columns of a study's signal, values and forms, and their products."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.base = base_columns(study)
        self.forms: list[Form] = []
        self._fits: dict[tuple[int, ...], Fit] = {}  # by the forms that are fitted
        self._new = [self.base]  # columns without products
        self.lines: list[list[Matrix]] = []
        self.with_values: Vector = np.zeros(0)
        self.count = self.values = self.base[0].shape[2]
        courses, model = study.courses, study.model
        for name, cause in EVERY.items():
            for way in [] if cause.beyond(courses, model) else cause.mechanisms:
                for values in way.grid(courses, model):
                    if not way.cuts_noise(courses, values):
                        self.add(name, way.at(courses, model, values))
        for form in free_curves(courses, model):
            self.add(OUTSIDE, form)
        self.extend()
        self.noise, own = noise_of(study, self.base), self.with_values[..., : self.values]
        own[...] = less_noise(own, self.noise)

    def without(self, forms: Sequence[Form]) -> Fit:
        """Fit of the model's own values with these forms only."""
        known = tuple(map(id, forms))
        if known not in self._fits:
            alone = self.study, self.base, self.noise
            self._fits[known] = self.fit(forms[-1:], forms[:-1])[0] if forms else base_fit(*alone)
        return self._fits[known]

    def add(self, name: str, form: Form) -> None:
        """Add a form; one that frees a value without a tolerance, or is not finite, is left out."""
        study = self.study
        if form.freed:
            if set(form.freed) <= set(study.values):
                freed = [1 + study.values.index(n) for n in form.freed]
                self.forms.append(replace(form, name=name, columns=np.array(freed)))
            return
        part = responses(study.courses, study.model, form)
        if all(np.isfinite(p).all() for p in part):
            at = np.arange(self.count, self.count + len(form.amplitudes))
            self._new.append(part)
            self.count += len(at)
            self.forms.append(replace(form, name=name, columns=at))

    def extend(self) -> None:
        """Compute the products of the forms that were added since."""
        if not self._new:
            return
        columns = [np.concatenate(each, axis=2) for each in zip(*self._new, strict=True)]
        used, old, self._new = np.flatnonzero(self.study.bands.used), self.lines, []
        new = self.lines = [[b[k] for k in used] for b in self.study.bands.lines(columns)]
        if old:
            pairs = (zip(*blocks, strict=True) for blocks in zip(old, new, strict=True))
            self.lines = [list(map(np.hstack, of_bands)) for of_bands in pairs]
        first = [[b[:, : self.values] for b in block] for block in self.lines]
        more = products(first, new)
        self.with_values = np.concatenate([self.with_values, more], axis=3) if old else more

    def _products(self, forms: Sequence[Form], beside: Sequence[Form]) -> Vector:
        """Products of signal, values and forms, shape (blocks, used bands, N, columns, columns)."""
        own = [[] if f.freed else f.columns.tolist() for f in forms]
        more = [c for f in beside if not f.freed for c in f.columns.tolist()]
        m, k, v = len(own[0]), len(more), self.values
        size = v + k + m
        blocks, bands = self.with_values.shape[:2]
        out = np.zeros((blocks, bands, len(forms), size, size))
        columns = np.array([[*range(v), *more, *mine] for mine in own])
        out[..., :v, :] = np.moveaxis(self.with_values[:, :, :, columns], 2, 3)
        out[..., v:, :v] = np.swapaxes(out[..., :v, v:], 3, 4)
        for q, block in enumerate(self.lines):
            for b, line in enumerate(block):
                chosen = line[:, columns[:, v:].ravel()].reshape(len(line), len(forms), k + m)
                if k + m == 1:
                    out[q, b, :, v, v] = np.einsum("rn,rn->n", chosen[:, :, 0], chosen[:, :, 0])
                elif k + m:
                    each = chosen.transpose(1, 2, 0)
                    out[q, b, :, v:, v:] = each @ each.transpose(0, 2, 1)
        return out

    def fit(self, forms: Sequence[Form], beside: Sequence[Form] = ()) -> list[Fit]:
        """One fit per form, each together with the model's values and the forms in `beside`."""
        study = self.study
        out: dict[int, Fit] = {}
        sizes = [0 if f.freed else len(f.columns) for f in forms]
        for m in sorted(set(sizes)):
            those = [k for k, size in enumerate(sizes) if size == m]
            # in groups, to limit memory
            for begin in range(0, len(those), 64):
                some = those[begin : begin + 64]
                stated = [self._priors([*beside, forms[k]]) for k in some]
                prior = Priors(*map(np.array, zip(*stated, strict=True)))
                own = self._products([forms[k] for k in some], beside)
                fit = fitted(own, study.bands, prior, study.exact)
                out |= {k: fit.one(j) for j, k in enumerate(some)}
        return [out[k] for k in range(len(forms))]

    def force_of(self, found: Hypothesis) -> float:
        """Root mean square effect of a hypothesis on a balance of forces or of voltages [N].

        It is taken where the fit counts the balance: elsewhere, a free curve may be anything.
        """
        study, form = self.study, found.form
        if form.freed:
            parts = [b[:, :, form.columns] for b in self.base]
        else:
            parts = responses(study.courses, study.model, form)
        each = np.concatenate([p @ found.amplitude for p in parts])
        moves = [moving(c, study.model) > 0.0 for c in study.courses]
        return float(np.sqrt(np.mean(each[np.concatenate(moves)] ** 2, axis=0)).max())

    def _priors(self, forms: Sequence[Form]) -> Priors:
        """Priors of values and forms, shape (columns,)."""
        parts = [self.study.priors([n for form in forms for n in form.freed])]
        for form in (f for f in forms if not f.freed):
            one = (0.0, 0.0, math.inf)
            if form.sure is not None:
                one = (1.0, form.sure**-2.0, _AROUND_ONE)
            parts += [Priors(*map(np.array, one))] * len(form.columns)
        return Priors(*map(np.hstack, zip(*parts, strict=True)))


def own_columns(form: Form) -> slice | npt.NDArray[np.int64]:
    """Columns of a form's own amplitudes in a fit: the last, or those of the freed values."""
    return form.columns - 1 if form.freed else slice(-len(form.columns), None)


def scored(
    catalogue: Catalogue, built: Sequence[Hypothesis] = (), only: str = ""
) -> list[Hypothesis]:
    """Every hypothesis in its best form, in addition to those `built`, the best first.

    With `only`, the one of this name.
    """
    known = [s.form for s in built]
    base = catalogue.without(known)
    others = {s.name for s in built}
    forms = [f for f in catalogue.forms if (f.name == only if only else f.name not in others)]
    tried: dict[str, list[tuple[Form, Fit]]] = {}
    for form, fit in zip(forms, catalogue.fit(forms, known), strict=True):
        tried.setdefault(form.name, []).append((form, fit))
    doubts = _between(catalogue, tried, known)
    best = []
    for name, pairs in tried.items():
        if some := [h for pair in pairs if (h := _hypothesis(catalogue.study, *pair, base))]:
            best.append(replace(max(some, key=lambda h: h.score), doubt=doubts.get(name, 0.0)))
    return sorted(best, key=lambda h: -h.score)


def gain_of(study: Study, before: Matrix, after: Matrix) -> Gain:
    """What is removed from squares, shape (blocks, used bands), of the balance that loses more."""
    of_force = study.bands.of_force
    balances = [b for b in (of_force, ~of_force) if b.any()]
    gains = [_gain(before[:, b].sum(axis=1), after[:, b].sum(axis=1)) for b in balances]
    return max(gains, key=lambda g: g.share)


def _gain(before: Vector, after: Vector) -> Gain:
    """The gain of squares by block, shape (blocks,)."""
    n = len(before)
    whole, left = max(float(before.sum()), 1e-300), float(after.sum())
    each = (left - after) / np.maximum(whole - before, 1e-100)
    error = math.sqrt((n - 1) / n * float(np.sum((each - each.mean()) ** 2)))
    share, reach = 1.0 - left / whole, float(stdtrit(n - 1, 0.95)) * error
    return Gain(share, (share - reach, share + reach))


def smaller_by(study: Study, form: Form, amplitude: Vector) -> Vector:
    """Factor by which a form makes the signal of each used band smaller."""
    of_force = study.bands.of_force
    smaller = EVERY[form.name].smaller if form.name in EVERY else None
    if smaller is None:
        return np.ones(len(of_force))
    factor = max(smaller(study.courses, form, amplitude), np.finfo(float).eps)
    return np.where(of_force & study.courses[0].by_current, 1.0, factor)


def _hypothesis(study: Study, form: Form, fit: Fit, base: Fit) -> Hypothesis | None:
    own = own_columns(form)
    amplitude = fit.amplitude[0][own]
    if not np.isfinite(fit.held).all() or not _can_be(study, form, amplitude):
        return None
    score = float(fit.held.sum() - base.held.sum() - fit.cost[0] + base.cost[0])
    smaller = smaller_by(study, form, amplitude)  # both are in terms of the recorded signals
    counts = study.bands.counts[:, study.bands.used]
    score += float(np.sum(counts * trusted(counts) * np.log(smaller)))
    gain = gain_of(study, base.squares[0], fit.squares[0] / smaller**2)
    if gain.share <= 0.0:
        return None  # it removes no force: its score comes only from other weights of the bands
    return Hypothesis(form, amplitude, fit.error[0][own], score, gain)


def _between(
    catalogue: Catalogue, tried: dict[str, list[tuple[Form, Fit]]], known: Sequence[Form]
) -> dict[str, float]:
    """Try forms between grid points by halving around the best; return the last spacings.

    A form next to the true one may have an amplitude that no machine has, see `_can_be`. If all
    forms have such amplitudes, the best of all is used.
    """
    study = catalogue.study

    def rank(pair: tuple[Form, Fit]) -> tuple[bool, float]:
        form, fit = pair
        can_be = form.freed or _can_be(study, form, fit.amplitude[0][own_columns(form)])
        return bool(can_be), float(fit.held.sum() - fit.cost[0])

    best = {name: max(pairs, key=rank)[0] for name, pairs in tried.items()}
    steps = {n: s for n, f in best.items() if (s := _spacing(f, [g for g, _ in tried[n]]))}
    for _ in range(_REFINED):
        before = len(catalogue.forms)
        for name in steps:
            steps[name] *= 0.5
            values = best[name].values
            key = CAUSES[name].mechanism(values).refined
            for side in (-steps[name], steps[name]):
                moved = {**values, key: values[key] * math.exp(side)}
                if not CAUSES[name].mechanism(moved).cuts_noise(study.courses, moved):
                    catalogue.add(name, CAUSES[name].at(study.courses, study.model, moved))
        catalogue.extend()
        new = catalogue.forms[before:]
        for form, fit in zip(new, catalogue.fit(new, known), strict=True):
            tried[form.name].append((form, fit))
        best = {name: max(tried[name], key=rank)[0] for name in steps}
    return steps


def _spacing(form: Form, forms: Sequence[Form]) -> float:
    """Distance of a form to the nearest one on its grid, as a logarithm; zero without a grid."""
    cause, own = CAUSES.get(form.name), form.values
    name = cause.mechanism(own).refined if cause else ""
    if not name or own[name] <= 0.0:
        return 0.0
    alike = [f.values for f in forms if f.values.keys() == own.keys()]
    alike = [v for v in alike if all(v[k] == w for k, w in own.items() if k != name)]
    grid = np.array([float(v[name]) for v in alike])
    near = np.abs(np.log(grid[(grid > 0.0) & (grid != own[name])] / own[name]))
    return float(near.min()) if len(near) else 0.0


def _can_be(study: Study, form: Form, amplitude: Vector) -> bool:
    """Whether a machine can have these sizes; values wrong together are so in one direction."""
    if form.sure is not None:
        return not np.isclose(abs(amplitude[0] - 1.0), _AROUND_ONE)
    if form.freed:
        least = study.prior_model.tolerance["m"] if form.name == "unmodelled_inertia" else -0.9
        return bool(np.all(amplitude > least) and np.ptp(np.sign(amplitude)) < 2.0)
    # a signal that is recorded with a factor keeps its sign
    return form.name not in SIGNALS or bool(np.all(amplitude > -1.0))
