"""A study's records as one least-squares problem with white noise.

The signal is what the records bring that the believed model does not foretell; the columns are what
each of its values, each possible cause and each shapeless rival would change in that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from .causes.cause import Shape
from .course import Course, Noise
from .drive_model import DriveModel
from .innovations import Gains, LinearDrive, gains, innovations
from .threads import in_threads

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

STRETCH = 0.5  # what is weighed and held out together [s]
_STEP = 1e-3  # of differences, relative to a value
SHORTEST_MEMORY = 0.005  # of it [s]; a position hardly shows what is faster, errors of reading do
LONGEST_MEMORY = 0.05  # of what is called noise [s]; what lasts longer is structure


@dataclass(frozen=True)
class Filter:
    """The filter of one record.

    Attributes
    ----------
    telling : ndarray, shape (n,)
        Weight of each sample: one, or zero where the drive rests, see `Course.rests`.
    """

    drive: LinearDrive
    weights: Gains
    telling: Vector


def filters(courses: Sequence[Course], model: DriveModel, noise: Noise) -> list[Filter]:
    """The filter of each record under a model."""
    found = []
    for c in courses:
        drive = model.linear(c.step, c.channels, noise.channels, noise.rms, noise.memory)
        weights = gains(drive, np.isfinite(c.signals), c.coarse, c.extra)
        found.append(Filter(drive, weights, (~c.rests).astype(float)))
    return found


@dataclass(frozen=True)
class Added:
    """What is put into a model beside its own equations, one array per record, as in `Shape`."""

    force: list[Vector]
    command: list[Vector]
    current: list[Vector]

    @classmethod
    def nothing(cls, courses: Sequence[Course]) -> Added:
        return cls(*([np.zeros(len(c.x)) for c in courses] for _ in range(3)))

    def more(self, shape: Shape, amplitudes: Vector) -> Added:
        """With a cause of these amplitudes."""

        def sums(before: list[Vector], parts: list[Matrix] | None) -> list[Vector]:
            if parts is None:
                return before
            return [b + p @ amplitudes for b, p in zip(before, parts, strict=True)]

        return Added(
            sums(self.force, shape.force),
            sums(self.command, shape.command),
            sums(self.current, shape.current),
        )


def law_forces(courses: Sequence[Course], model: DriveModel) -> list[Vector]:
    """The law along each record."""
    return [model.friction(c.x, c.v, c.step) for c in courses]


def surprises(
    courses: Sequence[Course],
    model: DriveModel,
    made: Sequence[Filter],
    added: Added,
    law: Sequence[Vector] | None = None,
) -> Vector:
    """Innovations of all records under a model, end to end, in standard deviations.

    The gains are those of `made`, so that models differ by what they foretell alone; `law` is that
    of `law_forces` where it is known.
    """
    out = []
    law = law_forces(courses, model) if law is None else law
    for c, f, friction, force, command, current in zip(
        courses, made, law, added.force, added.command, added.current, strict=True
    ):
        drive = model.linear(c.step, c.channels, f.drive.noise, 1.0, 1.0)
        # what the filter believes of the unmodelled force stays, with the gains
        move = drive.move.copy()
        move[:, -1] = f.drive.move[:, -1]
        start = np.zeros((len(move), 1))
        start[0, 0] = c.signals[0, 0]
        found = innovations(
            replace(drive, move=move),
            f.weights,
            np.nan_to_num(c.signals)[:, :, None] - c.shown(current[:, None]),
            (c.u + command)[:, None],
            (friction + force)[:, None],
            start,
        )
        out.append((found[:, :, 0] * f.telling[:, None]).ravel())
    return np.concatenate(out)


def response(courses: Sequence[Course], made: Sequence[Filter], shape: Shape) -> Matrix:
    """What a cause of amplitude one takes from the surprises, shape (all samples, amplitudes)."""
    out = []
    for r, (c, f) in enumerate(zip(courses, made, strict=True)):
        m = len(shape.amplitudes)
        nothing = np.zeros((len(c.x), m))
        force = nothing if shape.force is None else shape.force[r]
        command = nothing if shape.command is None else shape.command[r]
        signals = -c.shown(nothing if shape.current is None else shape.current[r])
        answer = innovations(f.drive, f.weights, signals, command, np.asarray(force))
        out.append(-(answer * f.telling[:, None, None]).reshape(-1, m))
    return np.vstack(out)


def sensitivities(
    courses: Sequence[Course], model: DriveModel, made: Sequence[Filter], added: Added
) -> Matrix:
    """What a relative change of each adjustable value takes from the surprises."""
    usual = law_forces(courses, model)

    def column(name: str) -> Vector:
        law = None if name in model.law_parameters else usual
        low, high = (
            surprises(
                courses, model.changed({name: model.values[name] * (1 + s)}), made, added, law
            )
            for s in (-_STEP, _STEP)
        )
        return (low - high) / (2 * _STEP)

    return np.column_stack(in_threads(column, model.adjustable))


def stretches(course: Course) -> int:
    """Into how many stretches a record is cut."""
    return max(2, round(len(course.x) * course.step / STRETCH))


def edges(courses: Sequence[Course]) -> list[int]:
    """Ends of the stretches among the surprises."""
    found = [0]
    for c in courses:
        n, per = len(c.x), len(c.channels)
        count = stretches(c)
        begin = found[-1]
        found += [begin + per * round(n * (k + 1) / count) for k in range(count)]
    return found


def likelihood(
    courses: Sequence[Course],
    model: DriveModel,
    noise: Noise,
    added: Added,
    law: Sequence[Vector],
) -> float:
    """Minus the logarithm of the records' likelihood under a model and its noise."""
    made = filters(courses, model, noise)
    e = surprises(courses, model, made, added, law)
    spreads = np.concatenate([f.weights.spread.ravel() for f in made])
    told = [np.repeat(f.telling, f.weights.spread.shape[1]) for f in made]
    known = np.isfinite(spreads) & (np.concatenate(told) > 0)
    return float(0.5 * np.sum(e[known] ** 2) + np.sum(np.log(spreads[known])))


def fitted_noise(courses: Sequence[Course], model: DriveModel, noise: Noise, added: Added) -> Noise:
    """The unmodelled force's size and memory, and the instruments' noise, as likely as can be."""
    scale = model.friction_scale
    step = courses[0].step
    law = law_forces(courses, model)

    def at(q: Vector) -> Noise:
        rms = scale * math.exp(min(max(q[0], -12.0), 3.0))
        memory = min(max(step * math.exp(max(q[1], 0.0)), SHORTEST_MEMORY), LONGEST_MEMORY)
        factors = np.exp(2 * np.clip(q[2:], -1.0, 1.5))
        return Noise(noise.channels * factors, rms, memory)

    def cost(q: Vector) -> float:
        return likelihood(courses, model, at(q), added, law) + 0.5 * float(
            np.sum((q[2:] / 0.3) ** 2)
        )

    # from within: at its end a memory has no slope
    memory = min(max(noise.memory, 2 * SHORTEST_MEMORY), 0.4 * LONGEST_MEMORY)
    first = np.concatenate(
        [
            [math.log(noise.rms / scale), math.log(memory / step)],
            np.zeros(len(noise.channels)),
        ]
    )
    simplex = np.vstack([first, *(first + 0.5 * row for row in np.eye(len(first)))])
    found = minimize(
        cost,
        first,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": 45, "xatol": 0.04, "fatol": 0.1},
    )
    return at(found.x)
