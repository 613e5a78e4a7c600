"""How well each suspect explains what a model leaves of records, on blocks that it has not seen.

A suspect is a column beside those of the model's values, each of which costs what its tolerance
says. Values, amplitudes and the noise of each band are fitted to all blocks but one, and the
logarithm of the likelihood of that one is summed over the blocks (cross-validated predictive
likelihood; S. Geisser and W. Eddy, JASA 74, 1979). The suspect's score is that sum less the sum
without it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..records.bad_record import BadRecord
from ..records.drive_record import DriveRecord
from .balance import (
    EXACT,
    Added,
    calibrated,
    leftovers,
    recalibrated,
    responses,
    sensitivities,
)
from .bands import EDGES, Bands, cut, products
from .causes import CAUSES
from .causes.cause import Shape
from .drive_model import DriveModel
from .modelled_record import (
    ModelledRecord,
    driven_by_current,
    lay_along,
    with_law_force,
    with_own_offsets,
)
from .nonparametric import nonparametric_alternatives
from .residuals import at_samples
from .signals import SIGNALS

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Array = npt.NDArray[np.float64]

OUTSIDE = "outside the catalogue"

FREEDOM = 4.0
"""Degrees of freedom of Student's distribution, as is usual where noise has outliers."""

_WEIGHINGS = 6  # of bands by what is left in them
_WEIGHINGS_MORE = 4  # without one of the blocks
_FLAT = 1e-9  # of a column's own square: an amplitude may be anything
_IN_NEWTONS = ("unmodelled_inertia",)  # what `beyond` says of it is of accelerations
_CURVES = 20  # functions of a free curve
_WELL_BELOW = 0.8  # of the usual command, where a limit cuts off more than noise
_MOST_LESS = 0.9  # of a command, that a shape takes away
_AROUND_ONE, _SPREADS = 0.5, 10.0  # of the amplitude of a shape that has its size in its values
_REFINED = 3  # halvings of a grid's spacing
_PINNINGS = 8  # rounds of the active set
_PINNED = 1e14  # precision of a value that stays where it is


@dataclass(frozen=True)
class Study:
    """Records laid along a model, and how they are cut.

    Attributes
    ----------
    model : DriveModel
        Around whose values everything is linear.
    prior_model : DriveModel
    bands : Bands
    """

    courses: list[ModelledRecord]
    model: DriveModel
    prior_model: DriveModel
    bands: Bands

    @property
    def values(self) -> tuple[str, ...]:
        """Names of the columns of values and calibrations."""
        return (*self.model.adjustable, *calibrated(self.courses))

    def prior(self) -> tuple[Vector, Vector]:
        """Mean and spread of the change of each of `values`."""
        names = self.model.adjustable
        ratio = [self.prior_model.values[n] / self.model.values[n] - 1.0 for n in names]
        known = calibrated(self.courses)
        mean = np.array([*ratio, *(-self.courses[0].calibration[n] for n in known)])
        spread = [self.prior_model.tolerance[n] / math.sqrt(3.0) for n in names]
        return mean, np.array([*spread, *(p.spread for p in known.values())])

    def most(self, spread: Vector) -> Vector:
        """By how much each of `values` can change: tolerances, and what instruments can have."""
        return np.asarray(math.sqrt(3.0) * spread)


@dataclass(frozen=True)
class Form:
    """One shape of a suspect: columns of its own, or values that it sets free."""

    name: str
    shape: Shape
    columns: npt.NDArray[np.int64]

    @property
    def freed(self) -> tuple[str, ...]:
        return self.shape.freed


@dataclass(frozen=True)
class Fit:
    """Forms fitted side by side, N of them.

    Attributes
    ----------
    held : ndarray, shape (N, blocks)
        Logarithm of the likelihood of each block that was held out.
    squares : ndarray, shape (N, blocks, channels * bands)
        Of what is left of it [N^2].
    amplitude, error : ndarray, shape (N, columns)
        From all blocks; the standard error from leaving one out (jackknife).
    cost : ndarray, shape (N,)
        Of values that are not the prior ones: minus the logarithm of their prior's density.
    """

    held: Matrix
    squares: Array
    amplitude: Matrix
    error: Matrix
    cost: Vector


class Priors(NamedTuple):
    """Of columns, shape (N, columns): mean, one over the variance, and what no change exceeds."""

    mean: Matrix
    precision: Matrix
    most: Matrix


def fitted(products: Array, bands: Bands, prior: Priors, exact: float) -> Fit:
    """Fit and hold out.

    Parameters
    ----------
    products : ndarray, shape (blocks, used bands, N, 1 + columns, 1 + columns)
        Of columns, the signal first.
    prior : Priors
    exact : float
        Noise that is always there [N].
    """
    counts = bands.counts[:, bands.used]
    blocks = np.arange(len(products))
    whole = products.sum(axis=0)
    start = (whole[:, :, 0, 0] / counts.sum(axis=0)[:, None]).T + exact**2
    amplitude, variance = _with_noise(products, counts, prior, exact, start, _WEIGHINGS)
    held, squares, ways = [], [], []
    for q in blocks:
        rest = blocks != q
        found, of_rest = _with_noise(
            products[rest], counts[rest], prior, exact, variance, _WEIGHINGS_MORE
        )
        ways.append(found)
        left = _left(products[q : q + 1], found)[0]
        each = 0.5 * counts[q] * np.log(of_rest)
        each += 0.5 * (FREEDOM + counts[q]) * np.log1p(left / (FREEDOM * of_rest))
        held.append(-each.sum(axis=1))
        squares.append(left)
    each = np.array(ways)
    count = len(blocks)
    error = np.sqrt((count - 1) / count * np.sum((each - each.mean(axis=0)) ** 2, axis=0))
    cost = 0.5 * np.sum(prior.precision * (amplitude - prior.mean) ** 2, axis=1)
    return Fit(np.array(held).T, np.array(squares).transpose(1, 0, 2), amplitude, error, cost)


def _with_noise(
    products: Array,
    counts: Matrix,
    prior: Priors,
    exact: float,
    variance: Matrix,
    times: int,
) -> tuple[Matrix, Matrix]:
    """Amplitudes (N, columns) and variances of the bands (N, channels * bands), in turn.

    Noise is not the same all over a record: a block's variance is one of many around the band's
    (Student's distribution; K. Lange, R. Little and J. Taylor, JASA 84, 1989).
    """
    left = products[:, :, :, 0, 0].transpose(0, 2, 1)
    each = counts[:, None, :]
    for _ in range(times):
        weight = (FREEDOM + each) / (FREEDOM + left / variance)
        inner = np.einsum("qbnij,qnb->nij", products, weight / variance)
        amplitude = _within_most(inner, prior)
        left = _left(products, amplitude)
        weight = (FREEDOM + each) / (FREEDOM + left / variance)
        variance = np.sum(weight * left, axis=0) / counts.sum(axis=0) + exact**2
    return amplitude, variance


def _within_most(inner: Array, prior: Priors) -> Matrix:
    """Amplitudes of least squares that stay within their tolerances, by an active set.

    A value that would leave its tolerance is put to its end, and let go where it would turn back
    (P. Gill, W. Murray and M. Wright, "Practical Optimization", 1981, ch. 5).
    """
    mean, precision, most = prior
    matrix = inner[:, 1:, 1:].copy()
    at = np.arange(mean.shape[1])
    matrix[:, at, at] += precision + _FLAT * (matrix[:, at, at] + 1e-30)
    goal = inner[:, 1:, 0] + precision * mean
    side = np.zeros(mean.shape)
    for _ in range(_PINNINGS):
        pinned = side != 0.0
        ends = mean + np.where(pinned, side * np.where(np.isfinite(most), most, 0.0), 0.0)
        held = matrix.copy()
        held[:, at, at] += np.where(pinned, _PINNED, 0.0)
        asked = goal + np.where(pinned, _PINNED * ends, 0.0)
        amplitude = np.linalg.solve(held, asked[:, :, None])[:, :, 0]
        slope = np.matmul(matrix, np.where(pinned, ends, amplitude)[:, :, None])[:, :, 0] - goal
        turns = pinned & (side * slope > 0.0)
        leaves = ~pinned & (np.abs(amplitude - mean) > 1.001 * most)
        if not (turns.any() or leaves.any()):
            break
        side = np.where(turns, 0.0, np.where(leaves, np.sign(amplitude - mean), side))
    return np.asarray(np.clip(amplitude - mean, -most, most) + mean)


def _left(products: Array, amplitude: Matrix) -> Array:
    """Squares of what amplitudes leave, shape (blocks, N, channels * bands)."""
    signed = np.concatenate([np.ones((len(amplitude), 1)), -amplitude], axis=1)[:, :, None]
    half = np.matmul(products, signed)
    return np.asarray(np.maximum(np.sum(half * signed, axis=(3, 4)), 0.0).transpose(0, 2, 1))


def study_of(records: Sequence[DriveRecord], prior_model: DriveModel) -> Study:
    """Records laid along the model, with its values adjusted within their tolerances.

    The motor's force is taken from the current or from the voltage, whichever leaves less.

    Raises
    ------
    BadRecord
        If records show next to no motion.
    """
    courses = with_own_offsets([lay_along(r, prior_model) for r in records], prior_model)
    studies = [_adjusted(courses, prior_model)]
    if all(c.has_current for c in courses):
        studies.append(_adjusted([driven_by_current(c, prior_model) for c in courses], prior_model))
    likely = [float(s[1].held.sum()) for s in studies]
    return studies[int(np.argmax(likely))][0]


def _adjusted(courses: list[ModelledRecord], prior_model: DriveModel) -> tuple[Study, Fit]:
    bands = cut(courses, prior_model)
    if not bands.used.any() or bands.counts[:, bands.used].sum() < 30.0:
        names = ", ".join(c.record.name for c in courses)
        raise BadRecord(f"{names}: next to no motion is shown: x rests, jumps or is noise")
    study = Study(courses, prior_model, prior_model, bands)
    for _ in range(2):  # Gauss-Newton
        study, fit = _moved(study)
    return study, fit


def base_fit(study: Study, columns: Sequence[Matrix]) -> Fit:
    """The model's own values alone; `columns` are those of `base_columns`."""
    mean, spread = study.prior()
    lines = study.bands.lines(columns)
    own = products(lines, lines)[:, study.bands.used][:, :, None]
    exact = EXACT * study.prior_model.friction_scale
    prior = Priors(mean[None], spread[None] ** -2.0, study.most(spread)[None])
    return fitted(own, study.bands, prior, exact)


def base_columns(study: Study) -> list[Matrix]:
    """The signal and the columns of values, (windows, channels, 1 + columns) of each record."""
    nothing = Added.nothing(study.courses)
    left = leftovers(study.courses, study.model, nothing)
    columns = sensitivities(study.courses, study.model, nothing)
    return [np.concatenate([y[:, :, None], s], axis=2) for y, s in zip(left, columns, strict=True)]


def _within(tolerance: float, change: float) -> float:
    """A change that is no larger than the tolerance: shapes are taken around values that can be."""
    return min(max(change, -tolerance), tolerance)


def _moved(study: Study) -> tuple[Study, Fit]:
    """The study around values that fit better, and the fit."""
    columns = base_columns(study)
    fit = base_fit(study, columns)
    change = dict(zip(study.values, fit.amplitude[0].tolist(), strict=True))
    names, prior = study.model.adjustable, study.prior_model
    fitted_values = {n: study.model.values[n] * (1.0 + change[n]) for n in names}
    off = {
        n: _within(prior.tolerance[n], v / prior.values[n] - 1.0) for n, v in fitted_values.items()
    }
    model = study.model.changed({n: prior.values[n] * (1.0 + off[n]) for n in names})
    moved = recalibrated(study.courses, {n: c for n, c in change.items() if n not in names})
    courses = [with_law_force(c, model) for c in moved]
    left = leftovers(courses, model, Added.nothing(courses))
    courses = [
        replace(c, unknown=at_samples(c, y[:, 0])) for c, y in zip(courses, left, strict=True)
    ]
    return replace(study, courses=courses, model=model), fit


@dataclass(frozen=True)
class Suspect:
    """A suspect in its best form.

    Attributes
    ----------
    name : str
        Of a cause, of a signal, or `OUTSIDE`.
    form : Form
    amplitude, error : ndarray, shape (m,)
        Of the form's own columns, or relative changes of the values it sets free.
    score : float
        Gain in the logarithm of the likelihood of blocks held out, less what its values cost.
    by_block : ndarray, shape (blocks,)
    share : float
        Of the squares left of a balance on blocks held out, that it takes away: of forces or of
        voltages, whichever is more.
    cost : float
        Of values that are not the prior ones.
    doubt : float
        Half the spacing of the grid that its size is from, as a logarithm.
    """

    name: str
    form: Form
    amplitude: Vector
    error: Vector
    score: float
    by_block: Vector
    share: float
    cost: float
    doubt: float = 0.0


@dataclass(frozen=True)
class Scored:
    """All suspects of a study, the best first.

    Attributes
    ----------
    beside : mapping of str to float
        Score of each suspect beside the first.
    """

    suspects: list[Suspect]
    base: Fit
    beside: dict[str, float]


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
            if cause.name in _IN_NEWTONS or not cause.beyond(courses, model):
                for values in cause.grid(courses, model):
                    if _cuts_noise(courses, values):
                        continue
                    shape = cause.at(courses, model, values)
                    if len(shape.freed) < 2 or _goes_together(shape.freed):
                        self.add(cause.name, shape, cause.relative)
        for signal in SIGNALS.values():
            for values in signal.grid(courses, model):
                self.add(signal.name, signal.at(courses, model, values), signal.relative)
        for rival in nonparametric_alternatives(courses, model, _CURVES):
            for shape in rival.shapes:
                self.add(OUTSIDE, shape)
        self.lines = self._lines(self.parts)
        first = [[b[:, : self.values] for b in block] for block in self.lines]
        self.with_values = products(first, self.lines)

    @cached_property
    def alone(self) -> Fit:
        """The model's own values without any form."""
        return base_fit(self.study, self.base)

    def _lines(self, parts: Sequence[Sequence[Matrix]]) -> list[list[Matrix]]:
        together = [np.concatenate(each, axis=2) for each in zip(*parts, strict=True)]
        used = np.flatnonzero(self.study.bands.used)
        return [[block[k] for k in used] for block in self.study.bands.lines(together)]

    def add(self, name: str, shape: Shape, relative: bool = False) -> None:
        """A form more."""
        study = self.study
        if shape.freed:
            if not set(shape.freed) <= set(study.values):
                return  # a value that is certain is no cause
            freed = [1 + study.values.index(n) for n in shape.freed]
            self.forms.append(Form(name, shape, np.array(freed)))
            return
        part = responses(study.courses, study.model, shape)
        if shape.command is not None and relative:
            part = self._told_in_command(shape, part)
        if not all(np.isfinite(p).all() for p in part):
            return
        at = np.arange(self.count, self.count + len(shape.amplitudes))
        self.parts.append(part)
        self.count += len(at)
        self.forms.append(Form(name, shape, at))

    def _told_in_command(self, shape: Shape, part: list[Matrix]) -> list[Matrix]:
        """Columns of a command that is made smaller, as a balance of the recorded one has them.

        What makes a command smaller would make all that is left smaller with it. A scale is linear
        in its amplitude; a shape that has its size in it has the amplitude one.
        """
        courses = self.study.courses
        u = np.concatenate([c.u for c in courses])
        change = np.concatenate([c[:, 0] for c in shape.command or []])
        less = -float(change @ u) / max(float(u @ u), 1e-300)
        whole = 1.0 if shape.sure is None else 1.0 - min(less, _MOST_LESS)
        out = []
        for c, p, first in zip(courses, part, self.base, strict=True):
            told = 1 if c.by_current else 0  # the first balance by a voltage
            p[:, told:] = (p[:, told:] - less * first[:, told:, :1]) / whole
            out.append(p)
        return out

    def extend(self, forms: int) -> None:
        """Take up the forms that were added after the first `forms` into the products."""
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

    def _products(self, forms: Sequence[Form], beside: Sequence[Form]) -> Array:
        """Of signal, values and forms, shape (blocks, used bands, N, columns, columns)."""
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
        """Fits of forms, each beside the model's values and others; each of one form."""
        study = self.study
        exact = EXACT * study.prior_model.friction_scale
        out: list[Fit | None] = [None] * len(forms)
        sizes = [0 if f.freed else len(f.columns) for f in forms]
        for m in sorted(set(sizes)):
            those = [k for k, size in enumerate(sizes) if size == m]
            # a few at a time: they are held in memory side by side
            for begin in range(0, len(those), 64):
                some = those[begin : begin + 64]
                stated = [self._stated([*beside, forms[k]]) for k in some]
                prior = Priors(*(np.array(s) for s in zip(*stated, strict=True)))
                own = self._products([forms[k] for k in some], beside)
                fit = fitted(own, study.bands, prior, exact)
                for j, k in enumerate(some):
                    out[k] = Fit(
                        fit.held[j : j + 1],
                        fit.squares[j : j + 1],
                        fit.amplitude[j : j + 1],
                        fit.error[j : j + 1],
                        fit.cost[j : j + 1],
                    )
        return [f for f in out if f is not None]

    def force_of(self, suspect: Suspect) -> float:
        """What a suspect does to a balance, of forces or of voltages, root mean square [N]."""
        shape = suspect.form.shape
        if shape.freed:
            parts = [b[:, :, suspect.form.columns] for b in self.base]
        else:
            parts = responses(self.study.courses, self.study.model, shape)
        each = np.concatenate([p @ suspect.amplitude for p in parts])
        moves = np.concatenate([c.resting == 0.0 for c in self.study.courses])
        return float(np.sqrt(np.mean(each[moves] ** 2, axis=0)).max())

    def _stated(self, forms: Sequence[Form]) -> Priors:
        """Of values and forms, shape (columns,)."""
        mean, spread = self.study.prior()
        most, spread = self.study.most(spread), spread.copy()
        own_mean: list[float] = []
        own_precision: list[float] = []
        for form in forms:
            if form.freed:
                for name, column in zip(form.freed, form.columns, strict=True):
                    spread[column - 1] = max(self.study.model.free_spread(name), spread[column - 1])
                    most[column - 1] = np.inf
                continue
            sure = form.shape.sure
            own_mean += [0.0 if sure is None else 1.0] * len(form.columns)
            own_precision += [0.0 if sure is None else sure**-2.0] * len(form.columns)
        return Priors(
            np.append(mean, own_mean),
            np.append(spread**-2.0, own_precision),
            np.append(most, np.full(len(own_mean), np.inf)),
        )


def _cuts_noise(courses: Sequence[ModelledRecord], values: Mapping[str, float]) -> bool:
    """Whether a limit cuts little off most of a command: that is noise that it takes away."""
    if "voltage_limit" not in values:
        return False
    usual = float(np.median(np.abs(np.concatenate([c.u for c in courses]))))
    return _WELL_BELOW * usual < values["voltage_limit"] < usual


def _goes_together(names: Sequence[str]) -> bool:
    """Whether values are wrong together: a motor's constants, levels of friction."""
    return {n.partition("_")[0] for n in names} in ({"kt", "ke"}, {"Fc", "Fs"}, {"Fc"})


def _can_be(study: Study, form: Form, amplitude: Vector) -> bool:
    """Whether sizes are such as a machine can have."""
    if form.shape.sure is not None:
        most = min(_AROUND_ONE, _SPREADS * form.shape.sure)
        return bool(abs(amplitude[0] - 1.0) < most)
    if form.freed:
        least = study.prior_model.tolerance["m"] if form.name == "unmodelled_inertia" else -0.9
        return bool(np.all(amplitude > least))
    return True


def _own(form: Form, values: int) -> slice | npt.NDArray[np.int64]:
    return form.columns - 1 if form.freed else slice(values, values + len(form.columns))


def scored(study: Study, catalogue: Catalogue) -> Scored:
    """Every suspect in its best form, the best first."""
    base, values = catalogue.alone, len(study.values)
    fits = catalogue.fit(catalogue.forms)
    best: dict[str, Suspect] = {}
    for form, fit in zip(catalogue.forms, fits, strict=True):
        suspect = _suspect(study, form, fit, base, values)
        key = form.name
        if suspect and (key not in best or suspect.score > best[key].score):
            best[key] = suspect
    suspects = sorted(best.values(), key=lambda s: -s.score)
    beside: dict[str, float] = {}
    first = next((s for s in suspects if s.name != OUTSIDE), None)
    if first:
        forms = [s.form for s in suspects if s is not first and s.name != OUTSIDE]
        own = catalogue.fit([first.form])[0]
        for form, fit in zip(forms, catalogue.fit(forms, [first.form]), strict=True):
            beside[form.name] = float(fit.held.sum() - own.held.sum() - fit.cost[0] + own.cost[0])
    return Scored(suspects, base, beside)


def _suspect(study: Study, form: Form, fit: Fit, base: Fit, values: int) -> Suspect | None:
    own = _own(form, values)
    amplitude = fit.amplitude[0][own]
    if not np.isfinite(fit.held).all() or not _can_be(study, form, amplitude):
        return None
    by_block = fit.held[0] - base.held[0]
    of_force = _of_forces(study)
    channels = [of_force, ~of_force] if study.courses[0].has_current else [of_force]
    shares = [
        1.0 - float(fit.squares[0][:, c].sum()) / max(float(base.squares[0][:, c].sum()), 1e-300)
        for c in channels
    ]
    if max(shares) <= 0.0:
        return None  # in newtons it explains nothing: it only trusts other bands more
    return Suspect(
        form.name,
        form,
        amplitude,
        fit.error[0][own],
        float(by_block.sum() - fit.cost[0] + base.cost[0]),
        by_block,
        max(shares),
        float(fit.cost[0]),
    )


def _of_forces(study: Study) -> npt.NDArray[np.bool_]:
    """Which of the used bands are of the balance of forces."""
    of_force = np.arange(len(study.bands.used)) < len(EDGES) - 1
    return np.asarray(of_force[study.bands.used])


def refined(study: Study, catalogue: Catalogue, suspect: Suspect) -> Suspect:
    """The suspect with its value found between the points of the grid, by halving."""
    cause = CAUSES.get(suspect.name)
    name = cause.refined_of(suspect.form.shape.values) if cause else None
    if cause is None or name is None:
        return suspect
    grid = np.unique([f.shape.values[name] for f in catalogue.forms
                      if f.name == suspect.name and name in f.shape.values])  # fmt: skip
    at = float(suspect.form.shape.values[name])
    near = np.abs(np.log(grid[(grid > 0.0) & (grid != at)] / at)) if at > 0.0 else np.zeros(0)
    if not len(near):
        return suspect
    step, best = float(near.min()), suspect
    base = catalogue.alone
    for _ in range(_REFINED):
        step *= 0.5
        known = len(catalogue.forms)
        values = best.form.shape.values
        for side in (-step, step):
            moved = {**values, name: values[name] * math.exp(side)}
            shape = cause.at(study.courses, study.model, moved)
            catalogue.add(suspect.name, shape, cause.relative)
        new = catalogue.forms[known:]
        catalogue.extend(known)
        for form, fit in zip(new, catalogue.fit(new), strict=True):
            tried = _suspect(study, form, fit, base, len(study.values))
            if tried and tried.score > best.score:
                best = tried
    return replace(best, doubt=step)
