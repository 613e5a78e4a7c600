"""What a model leaves unexplained, in force and in position, against the noise's own floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .compiled import compiled
from .course import Course, Noise
from .drive_model import DriveModel
from .innovations import LinearDrive, smooth
from .regression import Added

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

AHEAD = 1.0  # over which a position is foretold from a known state [s]
_WIDE, _MEMORY = 0.1, 0.05  # of the friction, [s]: unknown force, as it is looked for


@dataclass(frozen=True)
class Residual:
    """Of one study, its records end to end.

    Attributes
    ----------
    force : ndarray, shape (n,)
        Force that acts against motion in +x and that the model does not have [N].
    position : ndarray, shape (n,)
        By how much a position foretold from the state at the start of each second is wrong [m].
    telling : ndarray of bool, shape (n,)
        Samples that count.
    """

    force: Vector
    position: Vector
    telling: npt.NDArray[np.bool_]

    @property
    def force_rms(self) -> float:
        return rms(self.force[self.telling])

    @property
    def position_rms(self) -> float:
        return rms(self.position)


def rms(values: Vector) -> float:
    """Root mean square; zero of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def residual(courses: Sequence[Course], model: DriveModel, noise: Noise, added: Added) -> Residual:
    """The unknown force that each record asks for, and what it does to a prediction.

    Parameters
    ----------
    model : DriveModel
        With the values to be judged.
    added : Added
        What is in the model beside its own equations.
    """
    forces, positions, telling = [], [], []
    for c, more, volts, amperes in zip(
        courses, added.force, added.command, added.current, strict=True
    ):
        law = model.friction(c.x, c.v, c.step) + more
        drive = _wide(c, model, noise)
        start = np.zeros(len(drive.move))
        start[0] = c.signals[0, 0]
        signals = c.signals - c.shown(amperes[:, None])[:, :, 0]
        given = (signals, c.coarse, c.u + volts, law, np.zeros(len(law)), start)
        force = smooth(drive, *given).state[:, -1]
        forces.append(force)
        positions.append(_ahead(drive, force, c.step))
        telling.append(~c.rests)
    return Residual(np.concatenate(forces), np.concatenate(positions), np.concatenate(telling))


def floor(courses: Sequence[Course], model: DriveModel, noise: Noise) -> Residual:
    """What noise alone would leave: of the instruments, and of the unmodelled force."""
    random = np.random.default_rng(0)
    forces, positions, telling = [], [], []
    for c in courses:
        n = len(c.x)
        drive = model.linear(c.step, c.channels, noise.channels, noise.rms, noise.memory)
        kept = math.exp(-c.step / noise.memory)
        white = noise.rms * math.sqrt(1 - kept**2) * random.standard_normal(n)
        states = _driven(drive, white)
        seen = states @ drive.sees.T
        seen += random.standard_normal(seen.shape) * np.sqrt(noise.channels * c.coarse)
        seen[~np.isfinite(c.signals)] = np.nan
        wide = _wide(c, model, noise)
        nothing = np.zeros(n)
        given = (seen, c.coarse, nothing, nothing, nothing, np.zeros(len(wide.move)))
        force = smooth(wide, *given).state[:, -1]
        forces.append(force)
        positions.append(_ahead(wide, force, c.step))
        telling.append(~c.rests)
    return Residual(np.concatenate(forces), np.concatenate(positions), np.concatenate(telling))


def _wide(course: Course, model: DriveModel, noise: Noise) -> LinearDrive:
    """The drive with an unknown force that may be anything slow."""
    rms = _WIDE * model.friction_scale
    return model.linear(course.step, course.channels, noise.channels, rms, _MEMORY)


def _ahead(drive: LinearDrive, force: Vector, step: float) -> Vector:
    """Error of the position that comes of not knowing a force, from nothing at every second."""
    every = max(2, round(AHEAD / step))
    out = np.empty(len(force))
    # the unknown force is a given one here, not the filter's state
    _respond(drive.move[:-1, :-1].copy(), drive.by_force[:-1].copy(), force, every, out)
    return out


@compiled
def _respond(move: Matrix, by_force: Vector, force: Vector, every: int, out: Vector) -> None:
    state = np.zeros(len(by_force))
    for k in range(len(force)):
        if k % every == 0:
            state[:] = 0.0
        out[k] = state[0]
        state = move @ state + by_force * force[k]


def _driven(drive: LinearDrive, white: Vector) -> Matrix:
    states = np.empty((len(white), len(drive.move)))
    _drive(drive.move, white, states)
    return states


@compiled
def _drive(move: Matrix, white: Vector, states: Matrix) -> None:
    state = np.zeros(move.shape[0])
    for k in range(len(white)):
        states[k] = state
        state = move @ state
        state[-1] += white[k]
