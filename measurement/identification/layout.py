"""Records laid end to end, as the compiled laws take them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..records.record import Record
from .friction_estimation import FrictionEstimate, SmoothedMotion, estimate_friction
from .replay import replay

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_FREE_SHIFT = 1e-3  # [m]
_STILL = 3.0  # standard deviations of the velocity below which a block may stick
AROUND = 3  # uncertainty of the sample of a break-away, in samples
# Common error of all corners over the position's noise: a sixth of a count, if the noise is that of
# a uniform error within a count.
_BACKLASH = math.sqrt(12) / 6
EXAMPLES = 12  # example errors of a motion's reconstruction
_CORNER = 1.3  # the smoothed position is less certain where a motion begins


@dataclass(frozen=True)
class StackedRecords:
    """Records laid end to end, as the compiled laws take them.

    Attributes
    ----------
    x, v, inertial, force, blur : ndarray, shape (n,)
        Position [m], velocity [m/s], mass times acceleration [N], measured force [N], spread of the
        position [m].
    step, shift_std, gain_std, delay_std : ndarray, shape (records,)
        Sampling interval [s], spread of the displacement before [m], of the position's scale [1],
        of the delay [s].
    starts : ndarray of int, shape (records + 1,)
    clock : ndarray of int, shape (records,)
        Index of the record's unknown delay.
    resolution, noise : float
        Resolution of the load cell and first guess of the noise before it [N].
    replays : ndarray, shape (examples, 3, n)
        `x`, `v` and `inertial` after a second reconstruction, see `replay`.
    backlash : ndarray, shape (records,)
        Possible common error of all corners [m].
    still : ndarray of bool, shape (n,)
        Samples at which the block may stick.
    mass : float
        Mass of the first record [kg]; of all records if the mass is fitted.
    """

    x: Vector
    v: Vector
    inertial: Vector
    force: Vector
    blur: Vector
    step: Vector
    shift_std: Vector
    gain_std: Vector
    delay_std: Vector
    starts: npt.NDArray[np.int64]
    clock: npt.NDArray[np.int64]
    resolution: float
    noise: float
    replays: Matrix
    backlash: Vector
    still: npt.NDArray[np.bool_]
    mass: float = 1.0

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

    def with_mass(self, mass: float) -> StackedRecords:
        """The same motion of another mass [kg]."""
        replays = self.replays * np.array([1.0, 1.0, mass / self.mass])[:, None]
        inertial = self.inertial * (mass / self.mass)
        return replace(self, inertial=inertial, replays=replays, mass=mass)

    def of_record(self) -> npt.NDArray[np.int64]:
        """Number of the record of each sample, shape (n,)."""
        return np.repeat(np.arange(self.records), np.diff(self.starts))


def lay_out(
    records: Sequence[Record], estimates: Sequence[FrictionEstimate] | None = None
) -> StackedRecords:
    """Put the records end to end.

    Parameters
    ----------
    records : sequence of Record
    estimates : sequence of FrictionEstimate, optional
        Results of `estimate_friction` for each, if already computed.
    """
    estimates = [estimate_friction(r) for r in records] if estimates is None else list(estimates)
    lengths = [len(r.force) for r in records]
    counts = [e.force_resolution for e in estimates if e.force_resolution]
    resolution = float(np.median(counts)) if counts else 0.0
    rough = float(np.median([e.force_noise for e in estimates]))
    noise = max(math.sqrt(max(rough**2 - resolution**2 / 12, 0.0)), 0.2 * resolution, 1e-6)
    rates = sorted({round(math.log(r.step), 2) for r in records})
    shifts = []
    for estimate in estimates:
        known = max(_CORNER * estimate.motion.noise, 1e-9)
        shifts.append(known if estimate.from_rest else _FREE_SHIFT)

    def together(motions: Sequence[SmoothedMotion]) -> Matrix:
        inertial = [r.mass * m.a for r, m in zip(records, motions, strict=True)]
        columns = [m.x for m in motions], [m.v for m in motions], inertial
        return np.stack([np.concatenate(c) for c in columns])

    # all calibrations have the same spread: one that happens to fit well is not better than others
    stds = np.array([r.gain_std for r in records])
    usual = math.sqrt(float(np.mean(stds[stds > 0] ** 2))) if np.any(stds > 0) else 0.0
    gain_std = np.where(stds > 0, usual, 1e-7)
    x, v, inertial = together([e.motion for e in estimates])
    random = np.random.default_rng(0)
    replays = [together([replay(e, random) for e in estimates]) for _ in range(EXAMPLES)]
    return StackedRecords(
        x=x,
        v=v,
        inertial=inertial,
        force=np.concatenate([r.force for r in records]),
        blur=np.concatenate([e.motion.blur for e in estimates]),
        step=np.array([r.step for r in records]),
        shift_std=np.array(shifts),
        gain_std=gain_std,
        delay_std=np.array([max(r.delay_std, 1e-9) for r in records]),
        starts=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        clock=np.array([rates.index(round(math.log(r.step), 2)) for r in records], dtype=np.int64),
        resolution=resolution,
        noise=noise,
        replays=np.stack(replays),
        backlash=np.array([_BACKLASH * e.motion.noise for e in estimates]),
        still=np.concatenate([_may_stick(e.motion) for e in estimates]),
        mass=records[0].mass,
    )


def _may_stick(motion: SmoothedMotion) -> npt.NDArray[np.bool_]:
    """Samples whose velocity may be zero, or was smoothed together with such samples."""
    spread = 2 * math.pi * motion.bandwidth * motion.noise
    still = np.abs(motion.v) < max(_STILL * spread, 1e-9)
    still[[0, -1]] = True  # the motion before and after is not known
    near = max(1, round(0.25 / (motion.bandwidth * motion.step)))
    return np.asarray(np.convolve(still, np.ones(2 * near + 1), "same") > 0.5)


def break_aways(course: StackedRecords) -> dict[int, float]:
    """Samples with the largest force before each break-away, and its direction."""
    found = {}
    friction = course.force - course.inertial
    for r in range(course.records):
        begin, end = int(course.starts[r]), int(course.starts[r + 1])
        from_rest = course.shift_std[r] < _FREE_SHIFT
        still = course.still[begin:end]
        first = begin + np.flatnonzero(still & ~np.append(False, still[:-1]))
        last = begin + np.flatnonzero(still & ~np.append(still[1:], False))
        for a, b in zip(first, last, strict=True):
            if b + 1 == end or (a == begin and not from_rest):
                continue
            sign = float(np.sign(course.v[b + 1]))
            peak = int(a + np.argmax(sign * friction[a : b + 1]))
            if peak >= begin + AROUND:
                found[peak] = sign
    return found
