"""The motion of a record: position, velocity and acceleration from samples of the position.

They come from a smoothing spline on the samples. It minimizes second differences, so that sudden
stops by friction do not cause oscillations. It uses samples before and after and therefore has no
lag. Its smoothness is set by the noise of the position: residuals have the size of that noise, and
stay within a count if the position is quantized. All signals are shifted to the lag of the force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d

from ...solver.arrays import Mask, Vector
from ..records.record import Record, fast_noise, held_samples, resolution_of

Bounds = npt.NDArray[np.int64]

_SPAN = 5  # samples over which a speed is taken
_STRONGEST = 1e10  # weight of a rest, and of second differences that give a straight line


@dataclass(frozen=True)
class SmoothedMotion:
    """Position and its derivatives, smoothed, at the instants of the n force samples."""

    x: Vector  # [m]
    v: Vector  # [m/s]
    a: Vector  # [m/s^2]
    noise: float  # standard deviation of the measured position at rest [m]
    jitter: float  # that of the sampling instants [s]: the error grows with the speed
    resolution: float  # step of a quantized position [m]; 0 if it is not quantized
    bandwidth: float  # frequency at which the smoothing halves the amplitude [Hz]
    step: float  # sampling interval [s]
    seen: Vector  # smoothed position at the instants of the position samples [m]
    strength: float  # weight of second differences
    later: float  # delay of the position's instants relative to the force's [s]
    from_rest: bool  # whether the body was at rest before the first sample
    held: Bounds  # indices of the samples with a new value

    @property
    def spread(self) -> Vector:
        """Standard deviation of the measured position [m], shape (n,)."""
        return np.asarray(np.hypot(self.noise, self.jitter * self.v), dtype=float)

    @property
    def blur(self) -> Vector:
        """Standard deviation of the smoothed position [m]; larger towards the end, shape (n,)."""
        left = self.step * np.arange(len(self.x))[::-1]
        inner = math.sqrt(min(1.0, 2 * self.bandwidth * self.step))
        share = inner + (1 - inner) * np.exp(-2 * self.bandwidth * left)
        return np.asarray(self.spread * share, dtype=float)

    @property
    def recorded(self) -> Mask:
        """Whether the position was recorded around the instant, or at rest before, shape (n,)."""
        late, at = round(self.later / self.step), np.arange(len(self.x))
        first = 1 - late if late < 0 and not self.from_rest else 0
        return (at >= first) & (at < len(at) - (late + 1 if late > 0 else 0))

    def replayed(self, random: np.random.Generator) -> SmoothedMotion:
        """An example of this motion, measured and smoothed again.

        The smoothed motion is taken as true and measured like the record: in counts from an unknown
        origin, or with noise on the values that a converter holds. The difference is an example of
        the smoothing's error over time: at a reversal, or of a block that sticks within a count.
        """
        if self.resolution:
            seen = self.seen
            if self.jitter:
                seen = seen + self.jitter * self.v * random.standard_normal(len(seen))
            position = self.resolution * np.floor(seen / self.resolution + random.random())
        else:
            fresh = self.spread[self.held] * random.standard_normal(len(self.held))
            fresh += self.seen[self.held]
            last = np.searchsorted(self.held, np.arange(len(self.seen)), "right") - 1
            position = fresh[np.maximum(last, 0)]
        return smooth_motion(position, self.step, self.later, self.from_rest, self)


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
        Delay of the position relative to the requested instants, averaged over samples that repeat
        a held value [s].
    from_rest : bool, optional
        Whether the body was at rest before the first sample.
    like : SmoothedMotion, optional
        A motion whose noise, counts, held samples and strength of smoothing are used.
    counted : bool, optional
        Whether the position may come from an encoder; an integral of velocities does not.
    """
    given, before = later, 2 if from_rest else 0  # two samples at rest before: without a slope
    position = np.concatenate([np.full(before, position[0]), position])
    n = len(position)
    speed = np.abs(np.gradient(uniform_filter1d(position, _SPAN), step))
    if like:
        resolution, noise, jitter = like.resolution, like.noise, like.jitter
        held = np.concatenate([np.arange(before), before + like.held]) if before else like.held
    else:
        resolution = resolution_of(position) if counted else 0.0
        held = held_samples(position)
        noise, jitter = fast_noise(position[held]), 0.0
        if len(held) == n:
            noise, jitter = _errors(position, speed, resolution)
        if resolution > noise and len(held) == n:
            noise = resolution / math.sqrt(12)
        else:  # a grid finer than the noise comes from the digits of the file
            resolution = 0.0
    # a lag is counted from the middle of a held value
    later -= 0.5 * step * ((n - before) / np.count_nonzero(held >= before) - 1)
    origin = float(position[0])
    spread = np.hypot(noise, jitter * speed)
    less_certain = spread / noise if noise else np.ones(n)
    readings = _readings(position - origin, resolution, held, before, less_certain)
    smooth, strength = _to_noise(readings, noise, resolution, spread - noise, like)
    times = step * (np.arange(n) - before)
    spline = CubicSpline(times, smooth)
    at = np.clip(times + later, times[0], times[-1])
    v = spline(at, 1)
    a = np.gradient(v, step)
    # gain for a sine of frequency w: 1/(1 + strength*(2 sin(w h/2))^4)
    usual = strength * float(np.median(spread / noise) ** 2) if noise else 0.0
    half = 2 * math.asin(min(1.0, 0.5 * usual ** (-1 / 4))) if usual > 0 else math.pi
    course = spline(at)[before:] + origin, v[before:], a[before:]
    instrument = noise, jitter, resolution, half / (2 * math.pi * step), step
    fresh: Bounds = held[held >= before] - before
    seen = smooth[before:] + origin
    return SmoothedMotion(*course, *instrument, seen, strength, given, from_rest, fresh)


class _Readings(NamedTuple):
    """Samples of a position with their weights."""

    data: Vector  # readings, shape (n,) [m]
    weights: Vector  # shape (n,)
    # of two conditions on neighbours, shape (n - 1,): their mean equals that of their readings,
    # because the position passed a count between them; both are equal
    edges: Vector
    still: Vector
    independent: float  # number of readings, those of one count taken as one

    def misfit(self, smooth: Vector) -> float:
        """Mean square of the residuals, equal to that of the noise after a good fit [m^2]."""
        off = smooth - self.data
        between = self.edges > 0
        passed = 0.25 * self.edges[between] * (off[1:] + off[:-1])[between] ** 2
        apart = float(self.weights @ off**2) / self.independent
        return max(apart, float(np.mean(passed))) if len(passed) else apart


def _readings(
    data: Vector, resolution: float, held: Bounds, before: int, error: Vector
) -> _Readings:
    """Weights of samples by their relative `error`, the first `before` of them at rest.

    A slow motion is not visible within a count. At the change from one count to the next, the
    position is known to within the motion of one sampling interval.
    """
    n = len(data)
    weights, edges, still = np.zeros(n), np.zeros(n - 1), np.zeros(n - 1)
    still[:before] = _STRONGEST
    if resolution:
        passed = np.flatnonzero(np.diff(data))
        lengths = np.diff(np.concatenate([[before - 1], passed, [n - 1]]))
        weights[before:] = np.repeat(1.0 / lengths, lengths)
        near = np.minimum(lengths[:-1], lengths[1:])
        single = np.abs(np.diff(data)[passed]) < 1.5 * resolution
        edges[passed] = np.where(single & (near > 1), np.minimum(1.0 * near**2, _STRONGEST), 0.0)
    else:
        weights[held[held >= before]] = 1.0
    independent, between = float(weights.sum()), 0.5 * (error[1:] + error[:-1])
    return _Readings(data, weights / error**2, edges / between**2, still, independent)


def _errors(position: Vector, speed: Vector, resolution: float) -> tuple[float, float]:
    """Standard deviations of the position at rest [m] and of the sampling instants [s].

    The instants are exact unless the position is less certain at speed, from sample to sample.
    """
    moving = speed[2:-1] > 0.5 * float(np.quantile(speed, 0.98))
    fast, slow = fast_noise(position, moving), fast_noise(position, ~moving)
    third = np.diff(position, 3)[moving]
    at_random = third[1:] @ third[:-1] < -0.5 * (third @ third)  # -0.75 of it for white errors
    if not at_random or moving.all() or fast <= max(slow, resolution / math.sqrt(12)):
        return fast_noise(position), 0.0
    squares = [float(np.mean(speed[2:-1][part] ** 2)) for part in (moving, ~moving)]
    jitter = math.sqrt((fast**2 - slow**2) / (squares[0] - squares[1]))
    at_rest = max(slow**2 - jitter**2 * squares[1], (0.05 * fast) ** 2)
    return math.sqrt(at_rest), jitter


def _to_noise(
    readings: _Readings, noise: float, resolution: float, more: Vector, like: SmoothedMotion | None
) -> tuple[Vector, float]:
    """The smooth course with residuals as large as the noise, and the weight of second differences.

    The weights of readings with too large residuals are increased. `more` is what the speed adds to
    the error of each [m].
    """
    data, weights = readings.data, readings.weights
    if noise == 0.0:
        return data.copy(), 0.0
    strength = like.strength if like else _strength(readings, noise)
    smooth = _smooth(readings, strength)
    for _ in range(8):  # a quantized position is known to within half a count
        outside = np.abs(smooth - data) > (0.55 * resolution or 4 * noise) + 4 * more
        outside &= weights > 0
        if not np.any(outside):
            break
        weights[outside] *= 6.0
        smooth = _smooth(readings, strength)
    return smooth, strength


def _strength(readings: _Readings, noise: float) -> float:
    """Weight of second differences with which the residuals are as large as the noise."""
    low, high = 1e-3, _STRONGEST
    while high > 1.5 * low:
        middle = math.sqrt(low * high)
        if readings.misfit(_smooth(readings, middle)) > noise**2:
            high = middle
        else:
            low = middle
    return low


def _smooth(readings: _Readings, strength: float) -> Vector:
    """Minimise the weighted squares of all residuals and of all second differences."""
    data, edges, still, n = readings.data, readings.edges, readings.still, len(readings.data)
    bands = np.zeros((3, n))
    stencil = (1.0, -2.0, 1.0)
    for i in range(3):
        for j in range(i, 3):
            # rows 0..n-3 of the difference matrix touch entries (r+i, r+j)
            bands[2 - (j - i), j : n - 2 + j] += stencil[i] * stencil[j] * strength
    bands[2] += readings.weights
    mean = 0.25 * edges
    bands[1, 1:] += mean - still
    right = readings.weights * data
    for k in (slice(None, -1), slice(1, None)):
        bands[2, k] += mean + still
        right[k] += mean * (data[:-1] + data[1:])
    return np.asarray(solveh_banded(bands, right, check_finite=False), dtype=float)


def force_noise(force: Vector) -> tuple[float, float]:
    """Fast noise of a force, with its resolution, and that resolution, 0 for none [N]."""
    noise, resolution = fast_noise(force), resolution_of(force)
    if resolution < 0.1 * noise:  # a grid of the file's digits
        resolution = 0.0
    return max(noise, resolution / math.sqrt(12)), resolution


def motion_of(record: Record) -> SmoothedMotion:
    """The motion of a record at the instants of its force; a force near zero begins at rest."""
    later = record.lags.get(record.position_name, 0.0) - record.lags.get("force", 0.0)
    noise, _ = force_noise(record.force)
    from_rest = abs(float(np.mean(record.force[:5]))) < 3 * max(noise, 1e-9)
    counted = not record.velocity_alone
    return smooth_motion(record.position, record.step, later, from_rest, counted=counted)
