"""Scores of suspects: how well each explains the residuals of a model on held-out blocks.

A suspect is a column in addition to those of the model's values. Changes of values have a cost by
their tolerances. The score is the log-likelihood of held-out blocks, less that without the suspect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Matrix, Vector
from .balance import responses
from .bands import EDGES, moving, products
from .causes import CAUSES
from .causes.cause import Shape, Smaller
from .modelled_record import ModelledRecord
from .nonparametric import rivals
from .signals import SIGNALS
from .study import (
    Fit,
    Priors,
    Study,
    base_columns,
    base_fit,
    fitted,
    noise_products,
    trusted,
)

OUTSIDE = "outside the catalogue"

_OFTEN, _DEEP = 0.2, 1.25  # a limit cuts noise: least share of cut samples, most excess
_LEAST = 1e-4  # smallest factor by which a suspect makes the signal smaller
_AROUND_ONE, _SPREADS = 0.5, 10.0  # amplitude limits of a shape of known size
_FEW = 20.0  # a band with no more numbers than this does not count in `band_share`
_AT_END = 0.99
_REFINED = 3  # halvings of a grid's spacing


@dataclass(frozen=True)
class Form:
    """One shape of a suspect: its own columns, or values that it frees.

    Attributes
    ----------
    smaller : function or None
        As in `Cause`.
    lives : str
        With what a free curve varies; empty for causes.
    """

    name: str
    shape: Shape
    columns: npt.NDArray[np.int64]
    smaller: Smaller | None
    lives: str = ""

    @property
    def freed(self) -> tuple[str, ...]:
        return self.shape.freed


@dataclass(frozen=True)
class Suspect:
    """A suspect in its best form.

    Attributes
    ----------
    name : str
        Name of a cause or signal, or `OUTSIDE`.
    form : Form
    amplitude, error : ndarray, shape (m,)
        Of the form's own columns, or relative changes of the values that it frees.
    score : float
        Gain in the log-likelihood of held-out blocks, less the additional cost of values.
    by_block : ndarray, shape (blocks,)
    share : float
        Removed share of the squares of a balance on held-out blocks: of forces or of voltages,
        whichever is larger.
    band_share : float
        The same for the band with the largest removed share.
    cost : float
        Cost of values that differ from the prior ones.
    doubt : float
        Last spacing of the grid of its size, as a logarithm.
    """

    name: str
    form: Form
    amplitude: Vector
    error: Vector
    score: float
    by_block: Vector
    share: float
    band_share: float
    cost: float
    doubt: float = 0.0


@dataclass(frozen=True)
class Scored:
    """All suspects of a study, the best first.

    Attributes
    ----------
    beside : mapping of str to float
        Score of each suspect in addition to the first.
    unlike_noise : tuple of float
        Logarithms of ratios of the residual without any suspect: its size over friction, for forces
        and for voltages; its largest block over its median block, for all bands of forces; its slow
        bands over its fastest band.
    """

    suspects: list[Suspect]
    base: Fit
    beside: dict[str, float]
    unlike_noise: tuple[float, float, float, float]


class Catalogue:
    """Columns of a study's signal, values and forms, and their products."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.base = base_columns(study)
        self.parts = [self.base]
        self.forms: list[Form] = []
        self.count = self.values = self.base[0].shape[2]
        courses, model = study.courses, study.model
        for cause in CAUSES.values():
            if not cause.beyond(courses, model):
                for values in cause.grid(courses, model):
                    if _cuts_noise(courses, values):
                        continue
                    shape = cause.at(courses, model, values)
                    if len(shape.freed) < 2 or _goes_together(shape.freed):
                        self.add(cause.name, shape, cause.smaller)
        for signal in SIGNALS.values():
            for values in signal.grid(courses, model):
                self.add(signal.name, signal.at(courses, model, values), signal.smaller)
        for lives, shape in rivals(courses, model):
            self.add(OUTSIDE, shape, lives=lives)
        self.lines = self._lines(self.parts)
        first = [[b[:, : self.values] for b in block] for block in self.lines]
        self.with_values = products(first, self.lines)
        own = self.with_values[..., : self.values]
        own -= noise_products(study, self.base, own)

    def without(self, forms: Sequence[Form]) -> Fit:
        """Fit of the model's own values with these forms only."""
        return self.fit([forms[-1]], forms[:-1])[0] if forms else base_fit(self.study, self.base)

    def _lines(self, parts: Sequence[Sequence[Matrix]]) -> list[list[Matrix]]:
        together = [np.concatenate(each, axis=2) for each in zip(*parts, strict=True)]
        used = np.flatnonzero(self.study.bands.used)
        return [[block[k] for k in used] for block in self.study.bands.lines(together)]

    def add(self, name: str, shape: Shape, smaller: Smaller | None = None, lives: str = "") -> None:
        """Add a form."""
        study = self.study
        if shape.freed:
            if not set(shape.freed) <= set(study.values):
                return  # a value without a tolerance is no cause
            freed = [1 + study.values.index(n) for n in shape.freed]
            self.forms.append(Form(name, shape, np.array(freed), None, lives))
            return
        part = responses(study.courses, study.model, shape)
        if not all(np.isfinite(p).all() for p in part):
            return
        at = np.arange(self.count, self.count + len(shape.amplitudes))
        self.parts.append(part)
        self.count += len(at)
        self.forms.append(Form(name, shape, at, smaller, lives))

    def extend(self, forms: int) -> None:
        """Compute the products of the forms added after the first `forms`."""
        new = [f for f in self.forms[forms:] if not f.freed]
        if not new:
            return
        lines = self._lines(self.parts[-len(new) :])
        self.lines = [
            [np.concatenate(pair, axis=1) for pair in zip(a, b, strict=True)]
            for a, b in zip(self.lines, lines, strict=True)
        ]
        first = [[b[:, : self.values] for b in block] for block in self.lines]
        self.with_values = np.concatenate([self.with_values, products(first, lines)], axis=3)

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
        out: list[Fit | None] = [None] * len(forms)
        sizes = [0 if f.freed else len(f.columns) for f in forms]
        for m in sorted(set(sizes)):
            those = [k for k, size in enumerate(sizes) if size == m]
            # in groups, to limit memory
            for begin in range(0, len(those), 64):
                some = those[begin : begin + 64]
                stated = [self._stated([*beside, forms[k]]) for k in some]
                prior = Priors(*(np.array(s) for s in zip(*stated, strict=True)))
                own = self._products([forms[k] for k in some], beside)
                fit = fitted(own, study.bands, prior, study.exact)
                for j, k in enumerate(some):
                    out[k] = fit.one(j)
        return [f for f in out if f is not None]

    def force_of(self, suspect: Suspect) -> float:
        """Root mean square effect of a suspect on a balance of forces or of voltages [N].

        It is taken where the fit counts the balance: elsewhere, a free curve may be anything.
        """
        shape = suspect.form.shape
        if shape.freed:
            parts = [b[:, :, suspect.form.columns] for b in self.base]
        else:
            parts = responses(self.study.courses, self.study.model, shape)
        each = np.concatenate([p @ suspect.amplitude for p in parts])
        moves = [moving(c, self.study.model) > 0.0 for c in self.study.courses]
        return float(np.sqrt(np.mean(each[np.concatenate(moves)] ** 2, axis=0)).max())

    def _stated(self, forms: Sequence[Form]) -> Priors:
        """Priors of values and forms, shape (columns,)."""
        mean, spread = self.study.prior()
        most, spread = self.study.most(spread), spread.copy()
        own_mean: list[float] = []
        own_precision: list[float] = []
        own_most: list[float] = []
        for form in forms:
            if form.freed:
                for name, column in zip(form.freed, form.columns, strict=True):
                    spread[column - 1] = max(self.study.model.free_spread(name), spread[column - 1])
                    most[column - 1] = np.inf
                continue
            sure = form.shape.sure
            own_mean += [0.0 if sure is None else 1.0] * len(form.columns)
            own_precision += [0.0 if sure is None else sure**-2.0] * len(form.columns)
            own_most += [np.inf if sure is None else _most_off(sure)] * len(form.columns)
        return Priors(
            np.append(mean, own_mean),
            np.append(spread**-2.0, own_precision),
            np.append(most, own_most),
        )


def _cuts_noise(courses: Sequence[ModelledRecord], values: Mapping[str, float]) -> bool:
    """Whether a limit cuts many samples by little, so that it only removes noise of a command."""
    if "voltage_limit" not in values:
        return False
    asked = np.abs(np.concatenate([c.u for c in courses])) / values["voltage_limit"]
    cut = asked > 1.0
    return bool(cut.mean() > _OFTEN and np.median(asked[cut]) < _DEEP)


def _goes_together(names: Sequence[str]) -> bool:
    """Whether values are usually wrong together: a motor's constants, levels of friction."""
    return {n.partition("_")[0] for n in names} in ({"kt", "ke"}, {"Fc", "Fs"}, {"Fc"})


def _most_off(sure: float) -> float:
    """Largest deviation of an amplitude from one."""
    return min(_AROUND_ONE, _SPREADS * sure)


def _can_be(study: Study, form: Form, amplitude: Vector) -> bool:
    """Whether a machine can have these sizes."""
    if form.shape.sure is not None:
        return bool(abs(amplitude[0] - 1.0) < _AT_END * _most_off(form.shape.sure))
    if form.name in SIGNALS:
        return bool(np.all(amplitude > -1.0))
    if form.freed:
        least = study.prior_model.tolerance["m"] if form.name == "unmodelled_inertia" else -0.9
        return bool(np.all(amplitude > least))
    return True


def own_columns(form: Form) -> slice | npt.NDArray[np.int64]:
    """Columns of a form's own amplitudes in a fit: the last, or those of the freed values."""
    return form.columns - 1 if form.freed else slice(-len(form.columns), None)


def scored(catalogue: Catalogue, named: Sequence[Suspect] = ()) -> Scored:
    """Every suspect in its best form, in addition to the named ones, the best first."""
    known = [s.form for s in named]
    base = catalogue.without(known)
    others = {s.name for s in named}
    best = _best(catalogue, [f for f in catalogue.forms if f.name not in others], known, base)
    suspects = sorted(best.values(), key=lambda s: -s.score)
    beside: dict[str, float] = {}
    first = next((s for s in suspects if s.name != OUTSIDE), None)
    if first:
        forms = [s.form for s in suspects if s is not first and s.name != OUTSIDE]
        own = catalogue.without([*known, first.form])
        fits = catalogue.fit(forms, [*known, first.form])
        for form, fit in zip(forms, fits, strict=True):
            beside[form.name] = float(fit.held.sum() - own.held.sum() - fit.cost[0] + own.cost[0])
    return Scored(suspects, base, beside, _unlike_noise(catalogue.study, base))


def in_best_form(catalogue: Catalogue, suspect: Suspect, beside: Sequence[Suspect]) -> Suspect:
    """The suspect in the form that scores best together with others."""
    forms = [f for f in catalogue.forms if f.name == suspect.name]
    known = [s.form for s in beside]
    best = _best(catalogue, forms, known, catalogue.without(known))
    return best.get(suspect.name, suspect)


def _best(
    catalogue: Catalogue, forms: Sequence[Form], known: Sequence[Form], base: Fit
) -> dict[str, Suspect]:
    """The best form of each suspect, in addition to known forms; `base` is the fit of those."""
    tried: dict[str, list[tuple[Form, Fit]]] = {}
    for form, fit in zip(forms, catalogue.fit(forms, known), strict=True):
        tried.setdefault(form.name, []).append((form, fit))
    doubts = _between(catalogue, tried, known)
    best: dict[str, Suspect] = {}
    for name, pairs in tried.items():
        for form, fit in pairs:
            suspect = _suspect(catalogue.study, form, fit, base)
            if suspect and (name not in best or suspect.score > best[name].score):
                best[name] = replace(suspect, doubt=doubts.get(name, 0.0))
    return best


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
    steps: dict[str, float] = {}
    for name, form in best.items():
        step = _spacing(form, [f for f, _ in tried[name]])
        if step:
            steps[name] = step
    for _ in range(_REFINED):
        before = len(catalogue.forms)
        for name in steps:
            steps[name] *= 0.5
            cause, values = CAUSES[name], best[name].shape.values
            key = cause.refined_of(values) or ""
            for side in (-steps[name], steps[name]):
                moved = {**values, key: values[key] * math.exp(side)}
                if _cuts_noise(study.courses, moved):
                    continue
                shape = cause.at(study.courses, study.model, moved)
                catalogue.add(name, shape, cause.smaller)
        catalogue.extend(before)
        new = catalogue.forms[before:]
        for form, fit in zip(new, catalogue.fit(new, known), strict=True):
            tried[form.name].append((form, fit))
        best = {name: max(tried[name], key=rank)[0] for name in steps}
    return steps


def _spacing(form: Form, forms: Sequence[Form]) -> float:
    """Distance of a form to the nearest one on its grid, as a logarithm; zero without a grid."""
    cause = CAUSES.get(form.name)
    name = cause.refined_of(form.shape.values) if cause else None
    if name is None or form.shape.values[name] <= 0.0:
        return 0.0
    own = form.shape.values
    alike = [f.shape.values for f in forms if f.shape.values.keys() == own.keys()]
    alike = [v for v in alike if all(v[k] == w for k, w in own.items() if k != name)]
    grid = np.array([float(v[name]) for v in alike])
    near = np.abs(np.log(grid[(grid > 0.0) & (grid != own[name])] / own[name]))
    return float(near.min(initial=np.inf)) if len(near) else 0.0


def _unlike_noise(study: Study, base: Fit) -> tuple[float, float, float, float]:
    of_force, exact = _of_forces(study), study.exact
    counts, squares = study.bands.counts[:, study.bands.used], base.squares[0]

    def size(some: npt.NDArray[np.bool_]) -> float:
        left = math.sqrt(float(squares[:, some].sum() / counts[:, some].sum())) + exact
        return math.log(left / study.prior_model.friction_scale)

    forces = size(of_force)
    voltages = forces if of_force.all() else size(~of_force)
    counts, squares = counts[:, of_force], squares[:, of_force]
    blocks = squares / np.maximum(counts, 1.0) + exact**2
    bands = np.average(blocks, axis=0, weights=np.maximum(counts[:, 0], 1e-9))
    worst = np.max(blocks / np.median(blocks, axis=0), axis=0)
    return (
        forces,
        voltages,
        0.5 * float(np.log(worst.max())),
        0.5 * float(np.log(bands[:-1].max() / bands[-1])) if len(bands) > 1 else 0.0,
    )


def _suspect(study: Study, form: Form, fit: Fit, base: Fit) -> Suspect | None:
    own = own_columns(form)
    amplitude = fit.amplitude[0][own]
    if not np.isfinite(fit.held).all() or not _can_be(study, form, amplitude):
        return None
    by_block = fit.held[0] - base.held[0]
    of_force = _of_forces(study)
    counts = study.bands.counts[:, study.bands.used]
    squares = fit.squares[0]
    if form.smaller:  # the score is in terms of the recorded signals
        smaller = max(form.smaller(study.courses, form.shape, amplitude), _LEAST)
        told = ~of_force if study.courses[0].by_current else np.ones(len(of_force), dtype=bool)
        by_block = by_block + np.sum((counts * trusted(counts))[:, told], axis=1) * math.log(
            smaller
        )
        squares = np.where(told, squares / smaller**2, squares)
    channels = [of_force, ~of_force] if study.courses[0].has_current else [of_force]
    shares = [
        1.0 - float(squares[:, c].sum()) / max(float(base.squares[0][:, c].sum()), 1e-300)
        for c in channels
    ]
    if max(shares) <= 0.0:
        return None  # it removes no force: its score comes only from other weights of the bands
    known = counts.sum(axis=0) > _FEW
    left, before = (part.sum(axis=0)[known] for part in (squares, base.squares[0]))
    return Suspect(
        form.name,
        form,
        amplitude,
        fit.error[0][own],
        float(by_block.sum() - fit.cost[0] + base.cost[0]),
        by_block,
        max(shares),
        float(np.max(1.0 - left / np.maximum(before, 1e-300), initial=0.0)),
        float(fit.cost[0]),
    )


def _of_forces(study: Study) -> npt.NDArray[np.bool_]:
    """Which of the used bands belong to the balance of forces."""
    of_force = np.arange(len(study.bands.used)) < len(EDGES) - 1
    return np.asarray(of_force[study.bands.used])
