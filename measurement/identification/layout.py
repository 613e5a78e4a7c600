"""Records laid end to end, as the compiled laws take them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter1d

from ...solver.arrays import Matrix, Vector
from ..records.record import Record
from .motion import SmoothedMotion, force_noise, motion_of

FREE_SHIFT = 1e-3  # [m]


@dataclass(frozen=True)
class StackedRecords:
    """Records of n samples in all, laid end to end."""

    x: Vector  # position [m]
    v: Vector  # velocity [m/s]
    inertial: Vector  # mass times acceleration [N]
    force: Vector  # measured [N]
    blur: Vector  # spread of the position [m]
    still: npt.NDArray[np.bool_]  # samples at which the block may stick
    recorded: npt.NDArray[np.bool_]  # samples at whose instants the motion was recorded
    # of each record, shape (records,), and the first sample of each, then n
    step: Vector  # sampling interval [s]
    shift_std: Vector  # spread of the displacement before [m]
    gain_std: Vector  # of the position's scale [1]
    delay_std: Vector  # of the delay [s]
    clock: npt.NDArray[np.int64]  # index of its unknown delay
    backlash: Vector  # possible common error of all corners [m]
    starts: npt.NDArray[np.int64]
    resolution: float  # of the load cell [N]
    noise: float  # first guess of its noise before that [N]
    fast_noise: float  # of the force, resolution included [N]
    replays: Matrix  # `x`, `v` and `inertial` smoothed again, shape (examples, 3, n)
    mass: float = 1.0  # of the first record [kg]; of all records if the mass is fitted

    @property
    def records(self) -> int:
        return len(self.step)

    @property
    def clocks(self) -> int:
        return int(self.clock.max()) + 1

    @property
    def level(self) -> float:
        """Typical large friction force [N]."""
        return max(float(np.quantile(np.abs(self.force - self.inertial), 0.98)), 1e-9)

    @property
    def acceleration(self) -> Vector:
        """Acceleration [m/s^2]; zero where the mass is zero: then it is not known."""
        return self.inertial / self.mass if self.mass else np.zeros(len(self.x))

    def parts(self) -> list[slice]:
        """The samples of each record."""
        return [slice(a, b) for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)]

    def owner(self) -> npt.NDArray[np.int64]:
        """Number of the record of each sample, shape (n,)."""
        return np.repeat(np.arange(self.records), np.diff(self.starts))

    def with_mass(self, mass: float) -> StackedRecords:
        """The same motion of another mass [kg]."""
        replays = self.replays * np.array([1.0, 1.0, mass / self.mass])[:, None]
        inertial = self.inertial * (mass / self.mass)
        return replace(self, inertial=inertial, replays=replays, mass=mass)


def lay_out(records: Sequence[Record]) -> StackedRecords:
    """Put the records end to end, with their motion."""
    motions = [motion_of(r) for r in records]
    noises, counts = zip(*(force_noise(r.force) for r in records), strict=True)
    resolution = float(np.median([c for c in counts if c])) if any(counts) else 0.0
    rough = float(np.median(noises))
    clocks_of = [round(math.log(r.step), 2) for r in records]
    clocks = sorted(set(clocks_of))
    shifts = [max(1.3 * m.noise, 1e-9) if m.from_rest else FREE_SHIFT for m in motions]
    # all calibrations have the same spread: one that happens to fit well is not better than others
    stds = np.array([r.gain_std for r in records])
    usual = math.sqrt(float(np.mean(stds[stds > 0] ** 2))) if np.any(stds > 0) else 0.0

    def together(motions: Sequence[SmoothedMotion]) -> Matrix:
        inertial = [r.mass * m.a for r, m in zip(records, motions, strict=True)]
        columns = [m.x for m in motions], [m.v for m in motions], inertial
        return np.stack([np.concatenate(c) for c in columns])

    x, v, inertial = together(motions)
    random = np.random.default_rng(0)
    return StackedRecords(
        x=x,
        v=v,
        inertial=inertial,
        force=np.concatenate([r.force for r in records]),
        blur=np.concatenate([m.blur for m in motions]),
        still=np.concatenate([_may_stick(m) for m in motions]),
        recorded=np.concatenate([m.recorded for m in motions]),
        step=np.array([r.step for r in records]),
        shift_std=np.array(shifts),
        gain_std=np.where(stds > 0, usual, 1e-7),
        delay_std=np.array([max(r.delay_std, 1e-9) for r in records]),
        clock=np.array([clocks.index(clock) for clock in clocks_of], dtype=np.int64),
        # a sixth of a count, if the noise is that of a uniform error within a count
        backlash=np.array([math.sqrt(12) / 6 * m.noise for m in motions]),
        starts=np.cumsum([0, *(len(r.force) for r in records)]).astype(np.int64),
        resolution=resolution,
        noise=max(math.sqrt(max(rough**2 - resolution**2 / 12, 0.0)), 0.2 * resolution, 1e-6),
        fast_noise=rough,
        replays=np.stack([together([m.replayed(random) for m in motions]) for _ in range(12)]),
        mass=records[0].mass,
    )


def _may_stick(motion: SmoothedMotion) -> npt.NDArray[np.bool_]:
    """Samples whose velocity may be zero, or was smoothed together with such samples."""
    still = np.abs(motion.v) < max(3 * (2 * math.pi * motion.bandwidth * motion.noise), 1e-9)
    still[[0, -1]] = True  # the motion before and after is not known
    near = max(1, round(0.25 / (motion.bandwidth * motion.step)))
    return np.asarray(maximum_filter1d(still, 2 * near + 1, mode="constant"))


def break_aways(course: StackedRecords) -> dict[int, float]:
    """Samples with the largest force before each break-away, and its direction."""
    found = {}
    friction = course.force - course.inertial
    for part, before in zip(course.parts(), course.shift_std, strict=True):
        edges = part.start + np.flatnonzero(np.diff(course.still[part], prepend=0, append=0))
        for a, b in edges.reshape(-1, 2):
            from_rest = before < FREE_SHIFT
            if b == part.stop or (a == part.start and not from_rest):
                continue
            sign = float(np.sign(course.v[b]))
            peak = int(a + np.argmax(sign * friction[a:b]))
            if peak > part.start:
                found[peak] = sign
    return found
