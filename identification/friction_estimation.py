"""Friction from what was measured: force less mass times acceleration, Eq. 2.3 of the thesis.

Velocity and acceleration come from the position by a smoothing spline on the samples (least second
differences: a friction's sudden stops are no oscillations), which uses samples before and after
and therefore has no lag. It is as smooth as the
noise of the position allows: residuals have the size of that noise, and where the position is
counted they stay within a count. All signals are brought to the lag of the force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded

from ..records.record import Record
from ..records.resolution import fast_noise, held_samples, resolution_of

Vector = npt.NDArray[np.float64]

_REST = 40  # samples at rest that are put before a record that begins so
# Of the strength at which residuals are as large as the noise: corners count for more than noise,
# which friction sums up to nothing.
_WEAKER = 0.3
_NEAR = 25  # samples over which a motion is as restless as another place of it
_LEAST_BENDS = 0.03  # share of the mean of squares that is expected everywhere
_FEW = 8  # residuals tell too little of how strong to smooth
_TELLING = 0.4  # least weight of a sample whose residual tells how strong to smooth
_SLOWEST = 60  # samples in a count beyond which its end is not taken to be known better
_AT_REST = 1e8  # weight of having no motion
_STRONGER = 10.0
_STRONGEST = 1e10  # weight of second differences beyond which the course is a straight line


@dataclass(frozen=True)
class SmoothedMotion:
    """Position and its derivatives, smoothed, at the instants of the force samples.

    Attributes
    ----------
    x, v, a : ndarray, shape (n,)
        Position [m], velocity [m/s], acceleration [m/s^2].
    bent : ndarray, shape (n,)
        What the smoothing itself may have done to the position [m].
    noise : float
        Standard deviation of the measured position [m].
    resolution : float
        Step of a counted position [m]; 0 if it is not counted.
    bandwidth : float
        Frequency at which the smoothing halves an oscillation [Hz].
    step : float
        Sampling interval [s].
    seen : ndarray, shape (n,)
        Smoothed position at the instants of the position samples [m].
    strength : ndarray
        Weights of second differences.
    later : float
        How much later than the force's instants those of the position are [s].
    held : ndarray of int
        Indices of the samples that bring a new value.
    """

    x: Vector
    v: Vector
    a: Vector
    bent: Vector
    noise: float
    resolution: float
    bandwidth: float
    step: float
    seen: Vector
    strength: Vector
    later: float
    held: npt.NDArray[np.int64]

    @property
    def blur(self) -> Vector:
        """Standard deviation of the smoothed position [m]; larger towards the end, shape (n,)."""
        left = self.step * np.arange(len(self.x))[::-1]
        inner = math.sqrt(min(1.0, 2 * self.bandwidth * self.step))
        of_noise = self.noise * (inner + (1 - inner) * np.exp(-2 * self.bandwidth * left))
        return np.asarray(np.hypot(of_noise, self.bent), dtype=float)


@dataclass(frozen=True)
class FrictionEstimate:
    """Friction of a record and what it is made of.

    Attributes
    ----------
    friction : ndarray, shape (n,)
        [N], positive when it opposes motion in +x.
    motion : SmoothedMotion
    from_rest : bool
        Whether the record begins without force, hence at rest.
    force_noise : float
        Standard deviation of the force's fast noise, its resolution included [N].
    force_resolution : float
        Resolution of the force [N]; 0 if no grid is seen.
    noise : float
        Standard deviation of `friction` [N]: of the force, and of mass times acceleration.
    said : tuple of str
        Filters, lags and noise in words.
    """

    friction: Vector
    motion: SmoothedMotion
    from_rest: bool
    force_noise: float
    force_resolution: float
    noise: float
    said: tuple[str, ...]


def smooth_motion(
    position: Vector,
    step: float,
    later: float = 0.0,
    from_rest: bool = False,
    like: SmoothedMotion | None = None,
    counted: bool = True,
) -> SmoothedMotion:
    """Position, velocity and acceleration from samples of the position.

    Parameters
    ----------
    position : ndarray, shape (n,)
        [m]
    step : float
        Sampling interval [s].
    later : float, optional
        How much later than the wanted instants the position tells the truth, on average over
        samples that repeat a held value [s].
    from_rest : bool, optional
        Whether the body was at rest before the first sample.
    like : SmoothedMotion, optional
        A motion whose noise, counts, held samples and strength of smoothing are taken over.
    counted : bool, optional
        Whether the position may be that of an encoder; an integral of counted velocities is not.
    """
    given = later
    before = _REST if from_rest else 0
    position = np.concatenate([np.full(before, position[0]), position])
    n = len(position)
    if like:
        resolution, noise = like.resolution, like.noise
        held = np.concatenate([np.arange(before), before + like.held]) if before else like.held
    else:
        resolution = resolution_of(position) if counted else 0.0
        held = held_samples(position)
        noise = fast_noise(position[held])
    later -= (
        0.5 * step * ((n - before) / np.count_nonzero(held >= before) - 1)
    )  # a lag counts from the middle of what is held
    if like:
        pass
    elif resolution > noise and len(held) == n:
        noise = resolution / math.sqrt(12)
    else:  # a grid finer than the noise is that of the file
        resolution = 0.0
    origin = float(position[0])
    readings = _readings(position - origin, resolution, held, before)
    smooth, strength = _to_noise(readings, noise, resolution, like)
    times = step * (np.arange(n) - before)
    # where a stronger smoothing would change the course, this one has changed it, too
    bent = np.abs(_smooth(readings, _STRONGER * strength) - smooth) if noise else 0 * smooth
    spline = CubicSpline(times, smooth)
    at = np.clip(times + later, times[0], times[-1])
    v = spline(at, 1)
    a = np.gradient(v, step)
    # a sine of w passes by 1/(1 + strength*(2 sin(w h/2))^4)
    usual = float(np.median(strength))
    half = 2 * math.asin(min(1.0, 0.5 * usual ** (-1 / 4))) if usual > 0 else math.pi
    x = spline(at)[before:] + origin
    bandwidth = half / (2 * math.pi * step)
    return SmoothedMotion(
        x,
        v[before:],
        a[before:],
        bent[before:],
        noise,
        resolution,
        bandwidth,
        step,
        smooth[before:] + origin,
        strength,
        given,
        held[held >= before] - before,
    )


@dataclass(frozen=True)
class _Readings:
    """What samples of a position say.

    Attributes
    ----------
    data, weights : ndarray, shape (n,)
        Readings [m] and what they count.
    edges, still : ndarray, shape (n - 1,)
        Weight of the condition that the mean of two neighbours equals that of their readings,
        because a count was passed between them, and that they are the same.
    """

    data: Vector
    weights: Vector
    edges: Vector
    still: Vector

    def misfit(self, smooth: Vector) -> float:
        """Mean square of the residuals, as large as the noise's if all is well [m^2]."""
        off = smooth - self.data
        telling = self.weights > _TELLING
        between = self.edges > 0
        passed = 0.25 * self.edges[between] * (off[1:] + off[:-1])[between] ** 2
        told = self.weights[telling] * off[telling] ** 2
        return max((float(np.mean(t)) for t in (told, passed) if len(t) >= _FEW), default=0.0)


def _readings(
    data: Vector, resolution: float, held: npt.NDArray[np.int64], before: int
) -> _Readings:
    """Weights of samples, the first `before` of them at rest.

    Within a count a slow motion is not seen, but where it passes from one to the next it is there,
    to within what it moves in a sampling interval.
    """
    n = len(data)
    weights, edges, still = np.zeros(n), np.zeros(n - 1), np.zeros(n - 1)
    still[:before] = _AT_REST
    if not resolution:
        weights[held] = 1.0
        weights[:before] = 0.0
        return _Readings(data, weights, edges, still)
    passed = np.flatnonzero(np.diff(data))
    lengths = np.diff(np.concatenate([[before - 1], passed, [n - 1]]))
    weights[before:] = np.repeat(1.0 / lengths, lengths)
    near = np.minimum(lengths[:-1], lengths[1:])
    single = np.abs(np.diff(data)[passed]) < 1.5 * resolution
    edges[passed] = np.where(single & (near > 1), 1.0 * np.minimum(near, _SLOWEST) ** 2, 0.0)
    return _Readings(data, weights, edges, still)


def _to_noise(
    readings: _Readings, noise: float, resolution: float, like: SmoothedMotion | None
) -> tuple[Vector, Vector]:
    """The course that misses the readings by their noise, and the weights of its bends.

    The weights of readings that it misses by too much are raised.
    """
    data, weights = readings.data, readings.weights
    bends = len(data) - 2
    if noise == 0.0:
        return data.copy(), np.zeros(bends)
    if like:
        strength = like.strength
    else:
        strength = _strength(readings, noise, np.ones(bends))
        bent = np.diff(_smooth(readings, strength), 2) ** 2
        near = np.convolve(bent, np.ones(_NEAR) / _NEAR, "same")
        calm = near / max(float(near.mean()), 1e-300) + _LEAST_BENDS
        strength = _strength(readings, noise, 1.0 / calm)
    smooth = _smooth(readings, strength)
    for _ in range(8):  # a counted position is known to within half a count
        outside = np.abs(smooth - data) > (0.55 * resolution if resolution else 4 * noise)
        outside &= weights > 0
        if not np.any(outside):
            break
        weights[outside] *= 6.0
        smooth = _smooth(readings, strength)
    return smooth, strength


def _strength(readings: _Readings, noise: float, shape: Vector) -> Vector:
    """Weights of second differences in proportion to `shape`, residuals as large as the noise."""
    low, high = 1e-3, _STRONGEST
    while high > 1.5 * low:
        middle = math.sqrt(low * high)
        if readings.misfit(_smooth(readings, middle * shape)) > noise**2:
            high = middle
        else:
            low = middle
    return _WEAKER * low * shape


def _smooth(readings: _Readings, strength: Vector) -> Vector:
    """Minimise the weighted squares of all residuals and of all second differences."""
    data, weights, edges, still = (
        readings.data,
        readings.weights,
        readings.edges,
        readings.still,
    )
    n = len(data)
    strength = np.minimum(strength, _STRONGEST)
    bands = np.zeros((3, n))
    stencil = (1.0, -2.0, 1.0)
    for i in range(3):
        for j in range(i, 3):
            # rows 0..n-3 of the difference matrix touch entries (r+i, r+j)
            bands[2 - (j - i), j : n - 2 + j] += stencil[i] * stencil[j] * strength
    bands[2] += weights
    mean = 0.25 * edges
    for k in (slice(None, -1), slice(1, None)):
        bands[2, k] += mean + still
    bands[1, 1:] += mean - still
    right = weights * data
    passed = mean * (data[:-1] + data[1:])
    right[:-1] += passed
    right[1:] += passed
    return np.asarray(solveh_banded(bands, right, check_finite=False), dtype=float)


def estimate_friction(record: Record) -> FrictionEstimate:
    """Friction along a record by Eq. 2.3, with its noise and what was done about lags.

    Parameters
    ----------
    record : Record
    """
    name = record.position_name
    lag_force = float(record.lags.get("force", 0.0))
    lag_position = float(record.lags.get(name, 0.0))
    force_noise = fast_noise(record.force)
    resolution = resolution_of(record.force)
    if resolution < 0.1 * force_noise:  # the grid of the file's digits
        resolution = 0.0
    force_noise = max(force_noise, resolution / math.sqrt(12))
    from_rest = abs(float(np.mean(record.force[:5]))) < 3 * max(force_noise, 1e-9)
    motion = smooth_motion(
        record.position,
        record.step,
        lag_position - lag_force,
        from_rest,
        counted=not record.velocity_alone,
    )
    friction = record.force - record.mass * motion.a
    bend = record.mass * fast_noise(motion.a)
    noise = math.hypot(force_noise, bend)
    said = [
        f"velocity and acceleration from {name}: smoothing spline, no lag, half gain at "
        f"{motion.bandwidth:.3g} Hz",
        f"{name} lags by {1e3 * lag_position:.3g} ms and force by {1e3 * lag_force:.3g} ms "
        + ("as recorded with the trial" if record.lags else "(no filters stated)")
        + (
            f"; {name} was shifted by {1e3 * (lag_position - lag_force):.3g} ms to match the "
            "delay of the force"
            if lag_position != lag_force
            else "; nothing to shift"
        ),
        f"position noise {motion.noise:.3g} m"
        + (f" (counts of {motion.resolution:.4g} m)" if motion.resolution else ""),
        f"friction noise {noise:.3g} N a sample"
        + (f", load cell in steps of {resolution:.3g} N" if resolution else ""),
    ]
    return FrictionEstimate(
        friction, motion, from_rest, force_noise, resolution, noise, tuple(said)
    )
