"""A study's records as one least-squares problem with white noise.

The signal is what the records leave of the balances that the model fills; the columns are what each
of its values, each possible cause and each shapeless rival would change in that. What is left is
made white by an autoregression, so that noise of any colour counts as what it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from .balance import EXACT, Added
from .balance import sensitivities as sensitivities_of
from .causes.cause import Shape
from .drive_model import DriveModel
from .modelled_record import (
    ModelledRecord,
    mean_current,
    sluggishness,
    true_current,
    voltage_scale,
)
from .weak_form import averaged, lagged, rate, windows

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

STRETCH = 0.5  # what is weighed and held out together [s]
ORDER = 8  # of the autoregression: so many windows count for nothing at first
_ROUNDS = 3


@dataclass(frozen=True)
class Noise:
    """What is left of each balance, as an autoregression that is driven by white noise.

    Attributes
    ----------
    weights : ndarray, shape (channels, order)
        Of the windows before.
    sizes : ndarray, shape (channels,)
        Standard deviations of what drives it [N], [V].
    growth : float
        Of the force's, with the speed, in quadrature [N*s/m].
    """

    weights: Matrix
    sizes: Vector
    growth: float


def law_forces(courses: Sequence[ModelledRecord], model: DriveModel) -> list[Vector]:
    """The law along each record."""
    return [model.friction(c.x, c.v, c.step) for c in courses]


def balance(
    course: ModelledRecord, model: DriveModel, friction: Vector, force: Vector, command: Vector
) -> Matrix:
    """What is left of each balance in each window, shape (windows, channels) [N, V].

    Parameters
    ----------
    friction : ndarray, shape (n,)
        The law along the record, see `law_forces` [N].
    force, command : ndarray, shape (n,)
        What is in the model beside its own equations.
    """
    width, step = course.width, course.step
    v = course.moved_v
    u = course.u + course.calibration["command_shift"] * course.next_change + command
    opposed = averaged(friction + force + model.linear_friction * v, width) + course.own_offset
    if not model.has_motor:
        driven = model.values["gain"] * averaged(u, width)
        return _forces(course, model, driven - opposed)[:, None]
    resistance, inductance = model.values["R"], model.values["L"]
    volts = u - model.back_emf * v
    if not course.by_current:
        late = lagged((volts / resistance)[:, None], step, inductance / resistance)[:, 0]
        forces = _forces(course, model, model.per_ampere * averaged(late, width) - opposed)
        if not course.has_current:
            return forces[:, None]
    read = averaged(mean_current(course, model), width)
    if course.by_current:
        forces = _forces(course, model, model.per_ampere * read - opposed)
    left_volts = averaged(volts, width) - resistance * read
    left_volts -= inductance * rate(true_current(course), step, width)
    return np.column_stack([forces, voltage_scale(course, model) * left_volts])


def _forces(course: ModelledRecord, model: DriveModel, acting: Vector) -> Vector:
    """What is left of the balance of forces, shape (windows,) [N].

    The motion is what a model predicts: were it a term like others, a model whose forces and
    masses are all too small would leave less than the true one. So what is left counts by how
    far it moves the drive within a window.
    """
    acting = acting - model.inertia * course.measured_a
    return course.inertia * acting / sluggishness(course, model)


def shown(
    course: ModelledRecord, model: DriveModel, shape: Shape, record: int
) -> npt.NDArray[np.float64]:
    """What a cause of amplitude one takes from each balance, shape (windows, channels, m)."""
    m = len(shape.amplitudes)
    out = np.zeros((windows(len(course.x), course.width), len(course.channels), m))
    if shape.force is not None:
        out[:, 0] += averaged(shape.force[record], course.width)
    if shape.command is not None:
        command = shape.command[record]
        if not model.has_motor:
            out[:, 0] -= model.values["gain"] * averaged(command, course.width)
        elif not course.by_current:
            late = lagged(command, course.step, model.values["L"] / model.values["R"])
            out[:, 0] -= model.per_command * averaged(late, course.width)
        if course.has_current:
            out[:, 1] -= voltage_scale(course, model) * averaged(command, course.width)
    out[:, 0] *= course.inertia / sluggishness(course, model)
    return out


@dataclass(frozen=True)
class Filter:
    """What makes the residual of one record white.

    Attributes
    ----------
    noise : Noise
    telling : ndarray, shape (windows,)
        Weight of each window: zero where the drive rests, or did a moment ago.
    force_weights : ndarray, shape (windows,)
        Of the balance of forces, further: less than one where the law's force is doubtful.
    """

    noise: Noise
    telling: Vector
    force_weights: Vector

    def whitened(self, left: Matrix) -> Matrix:
        """Shape (windows, channels, ...) to the same, in standard deviations."""
        out = left.copy()
        order = self.noise.weights.shape[1]
        extra = (1,) * (left.ndim - 2)
        for lag in range(1, order + 1):
            weight = self.noise.weights[:, lag - 1].reshape(1, -1, *extra)
            out[lag:] -= weight * left[:-lag]
        out /= self.noise.sizes.reshape(1, -1, *extra)
        out[:, 0] *= self.force_weights.reshape(-1, *extra)
        return np.asarray(out * self.telling.reshape(-1, 1, *extra))


def telling(course: ModelledRecord, order: int = ORDER) -> Vector:
    """Weights of the windows, shape (windows,): zero where one rests, or remembers a rest."""
    rests = course.resting > 0.0
    remembered = np.convolve(rests, np.ones(order + 1))[: len(rests)] > 0.0
    remembered[:order] = True
    return (~remembered).astype(float)


def filters(courses: Sequence[ModelledRecord], noise: Noise) -> list[Filter]:
    """The filter of each record."""
    return [
        Filter(noise, telling(c), force_weights(c, noise.sizes[0], noise.growth)) for c in courses
    ]


def force_weights(course: ModelledRecord, size: float, growth: float) -> Vector:
    """Weights of the balance of forces whose noise has this size, shape (windows,)."""
    remembered = np.convolve(course.force_variance, np.ones(3))[: len(course.force_variance)]
    return np.asarray(1.0 / np.sqrt(1.0 + (remembered + _grown(course, growth)) / size**2))


def _grown(course: ModelledRecord, growth: float) -> Vector:
    return growth**2 * averaged(course.v**2, course.width)


def leftovers(
    courses: Sequence[ModelledRecord],
    model: DriveModel,
    added: Added,
    law: Sequence[Vector] | None = None,
) -> list[Matrix]:
    """`balance` of each record."""
    law = law_forces(courses, model) if law is None else law
    return [
        balance(c, model, *given)
        for c, *given in zip(courses, law, added.force, added.command, strict=True)
    ]


def innovations(
    courses: Sequence[ModelledRecord],
    model: DriveModel,
    made: Sequence[Filter],
    added: Added,
    law: Sequence[Vector] | None = None,
) -> Vector:
    """What is left of all records under a model, white, end to end, in standard deviations."""
    left = leftovers(courses, model, added, law)
    return np.concatenate([f.whitened(y).ravel() for f, y in zip(made, left, strict=True)])


def responses(courses: Sequence[ModelledRecord], model: DriveModel, shape: Shape) -> list[Matrix]:
    """What a cause of amplitude one takes from the balances of each record, see `shown`."""
    return [shown(c, model, shape, r) for r, c in enumerate(courses)]


def whitened(made: Sequence[Filter], parts: Sequence[Matrix]) -> Matrix:
    """Parts of each record's balances, (windows, channels, m), white, shape (all windows, m)."""
    white = [f.whitened(part) for f, part in zip(made, parts, strict=True)]
    return np.vstack([w.reshape(-1, w.shape[2]) for w in white])


def sensitivities(
    courses: Sequence[ModelledRecord], model: DriveModel, added: Added
) -> list[Matrix]:
    """As those of `balance.sensitivities`, of these balances."""
    return sensitivities_of(courses, model, added, leftovers)


def stretches(course: ModelledRecord) -> int:
    """Into how many stretches a record is cut."""
    return max(2, round(len(course.x) * course.step / STRETCH))


def edges(courses: Sequence[ModelledRecord]) -> list[int]:
    """Ends of the stretches among the innovations."""
    found = [0]
    for c in courses:
        n, per = windows(len(c.x), c.width), len(c.channels)
        count = stretches(c)
        begin = found[-1]
        found += [begin + per * round(n * (k + 1) / count) for k in range(count)]
    return found


def ends_of_stretches(courses: Sequence[ModelledRecord]) -> npt.NDArray[np.int64]:
    """Ends of the stretches among all samples, shape (stretches + 1,)."""
    found = [0]
    for c in courses:
        count, begin = stretches(c), found[-1]
        found += [begin + round(len(c.x) * (k + 1) / count) for k in range(count)]
    return np.array(found)


def likelihood(
    courses: Sequence[ModelledRecord],
    model: DriveModel,
    noise: Noise,
    added: Added,
    law: Sequence[Vector] | None = None,
) -> float:
    """Minus the logarithm of the records' likelihood under a model and its noise."""
    made = filters(courses, noise)
    e = innovations(courses, model, made, added, law)
    count = sum(float(f.telling.sum()) for f in made)
    weights = sum(float(np.sum(f.telling * np.log(f.force_weights))) for f in made)
    return float(0.5 * np.sum(e**2) + count * np.sum(np.log(noise.sizes)) - weights)


def fitted_noise(
    courses: Sequence[ModelledRecord], model: DriveModel, left: Sequence[Matrix]
) -> Noise:
    """The autoregression that is most likely, given what is left of each record's balances."""
    exact = EXACT * model.friction_scale
    size, growth = exact, 0.0
    for _ in range(_ROUNDS):  # the weights of doubtful windows need the size
        each = [force_weights(c, size, growth) for c in courses]
        found, innovation = _autoregression(courses, [y[:, 0] for y in left], each, exact)
        size, growth = _size_and_growth(courses, innovation, exact * _amplified(found))
    weights, sizes = [found], [size]
    if left[0].shape[1] > 1:
        exact = exact / model.per_command
        even = [np.ones(len(y)) for y in left]
        found, innovation = _autoregression(courses, [y[:, 1] for y in left], even, exact)
        square = float(np.mean(np.concatenate(innovation) ** 2))
        weights.append(found)
        sizes.append(math.hypot(math.sqrt(square), exact * _amplified(found)))
    return Noise(np.array(weights), np.array(sizes), growth)


def _amplified(weights: Vector) -> float:
    """What white noise is after an autoregression's filter, relative to before."""
    return math.sqrt(1.0 + float(weights @ weights))


def _autoregression(
    courses: Sequence[ModelledRecord],
    left: Sequence[Vector],
    weights: Sequence[Vector],
    exact: float,
) -> tuple[Vector, list[Vector]]:
    """Weights of the windows before, shape (order,), and what they do not predict.

    White noise of the size `exact` is always there: without it, whatever is smooth would be
    predicted from its own course to any digit, an effect like noise.
    """
    rows, goals, scales = [], [], []
    for c, y, w in zip(courses, left, weights, strict=True):
        counts = np.flatnonzero(telling(c) > 0.0)
        rows.append(y[counts[:, None] - np.arange(1, ORDER + 1)])
        goals.append(y[counts])
        scales.append(w[counts])
    past, now, scale = np.vstack(rows), np.concatenate(goals), np.concatenate(scales)
    weighted = past * scale[:, None] ** 2
    inner = past.T @ weighted + float(scale @ scale) * exact**2 * np.eye(ORDER)
    found = np.asarray(np.linalg.solve(inner, weighted.T @ now), dtype=np.float64)
    return found, [goal - row @ found for row, goal in zip(rows, goals, strict=True)]


def _size_and_growth(
    courses: Sequence[ModelledRecord], innovation: Sequence[Vector], least: float
) -> tuple[float, float]:
    """Of the balance of forces: what drives it at rest [N], and how that grows [N*s/m]."""
    squares, variances, paces = [], [], []
    for c, e in zip(courses, innovation, strict=True):
        counts = np.flatnonzero(telling(c) > 0.0)
        squares.append(e**2)
        variances.append(np.convolve(c.force_variance, np.ones(3))[: len(c.force_variance)][counts])
        paces.append(averaged(c.v**2, c.width)[counts])
    square, variance, pace = (np.concatenate(p) for p in (squares, variances, paces))
    size, growth = least**2 + float(np.mean(square)), 0.0
    for _ in range(
        _ROUNDS
    ):  # iterated weighted least squares: the scatter of squares is their size
        weight = 1.0 / (size + growth * pace + variance)
        columns = np.column_stack([np.ones(len(pace)), pace]) * weight[:, None]
        found, _ = nnls(columns, np.maximum(square - variance, 0.0) * weight)
        size, growth = max(float(found[0]), least**2), float(found[1])
    return math.sqrt(size), math.sqrt(growth)
