"""The Stribeck curve, Eq. 1.8, through friction at constant velocities and at break-away."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import OptimizeWarning, curve_fit

from ..records.record import Record
from .friction_estimation import FrictionEstimate
from .intervals import Interval, student_interval

Vector = npt.NDArray[np.float64]

STUCK = 6e-5  # a block that moved less is still in presliding: about 2.5 times Fs/sigma0 [m]
CREPT = 3e-4  # near Fs presliding continues for several times Fs/sigma0 [m]
_DRIFT = 5e-6  # [m]
_STEADY = 0.05  # largest relative variation of a constant velocity
_METHOD = "least squares on Eq. 1.8"


@dataclass(frozen=True)
class StribeckPoints:
    """Friction over velocity, one point per trial.

    Attributes
    ----------
    velocity, friction : ndarray, shape (n,)
        [m/s], [N]; velocity 0 is a break-away point.
    """

    velocity: Vector
    friction: Vector


def stribeck_curve(speed: Vector, fc: float, fs: float, vs: float, sigma2: float) -> Vector:
    """Eq. 1.8 for motion in one direction, as magnitudes [N]."""
    return np.asarray(fc + (fs - fc) * np.exp(-((speed / vs) ** 2)) + sigma2 * speed)


def steady_point(record: Record, estimate: FrictionEstimate) -> tuple[float, float] | None:
    """Mean velocity [m/s] and friction [N] where the second half of a record is steady."""
    half = slice(len(record.force) // 2, None)
    v = estimate.motion.v[half]
    mean = float(v.mean())
    moved = abs(float(estimate.motion.x[-1] - estimate.motion.x[0]))
    if moved < STUCK or float(v.std()) > _STEADY * abs(mean):
        return None
    return mean, float(estimate.friction[half].mean())


def held_force(record: Record, estimate: FrictionEstimate) -> float | None:
    """The friction [N] that held the block in the last fifth of a record; None if it moved."""
    last = slice(-max(5, len(record.force) // 5), None)
    drift = float(np.ptp(estimate.motion.x[last]))
    if float(np.ptp(estimate.motion.x)) > CREPT or drift > max(_DRIFT, 6 * estimate.motion.noise):
        return None
    return float(estimate.friction[last].mean())


def stribeck_points(records: list[Record], estimates: list[FrictionEstimate]) -> StribeckPoints:
    """All points of the records; for held forces, only the largest of each direction."""
    velocity, friction, held = [], [], []
    for record, estimate in zip(records, estimates, strict=True):
        steady = steady_point(record, estimate)
        force = held_force(record, estimate)
        if steady is not None:
            velocity.append(steady[0])
            friction.append(steady[1])
        elif force is not None:
            held.append(force)
    for sign in (1.0, -1.0):
        side = [f for f in held if f * sign > 0]
        if side:
            velocity.append(0.0)
            friction.append(sign * max(abs(f) for f in side))
    return StribeckPoints(np.array(velocity), np.array(friction))


def fit_stribeck(points: StribeckPoints, sign: int) -> dict[str, Interval]:
    """Fc, Fs, Vs and sigma2 of one direction, with those that the points do not identify.

    Parameters
    ----------
    points : StribeckPoints
    sign : int
        +1 or -1: the direction.

    Raises
    ------
    ValueError
        If there are fewer than four points in this direction.
    """
    side = points.friction * sign > 0
    speed, pull = np.abs(points.velocity[side]), np.abs(points.friction[side])
    if len(speed) < 4:
        raise ValueError(
            f"{len(speed)} points of the Stribeck curve in this direction; expected at least four: "
            "three constant velocities and a break-away force"
        )
    moving = speed > 0
    slope, rest = np.polyfit(speed[moving], pull[moving], 1)
    top = float(pull[~moving].max()) if np.any(~moving) else float(pull.max())
    slowest = float(speed[moving].min())
    best: Vector | None = None
    covariance = np.full((4, 4), math.inf)
    lowest = math.inf
    bounds = ([0, 0, 1e-6, 0], [np.inf, np.inf, 1.0, np.inf])
    for start in (0.3 * slowest, slowest, 3 * slowest):
        guess = (max(rest, 0.1 * top), top, start, max(slope, 1.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", OptimizeWarning)  # the result is checked below
            try:
                found, spreads = curve_fit(
                    stribeck_curve, speed, pull, p0=guess, bounds=bounds, x_scale=np.abs(guess)
                )
            except RuntimeError:
                continue
        loss = float(np.sum((stribeck_curve(speed, *found) - pull) ** 2))
        if loss < lowest * (1 - 1e-9):
            best, covariance, lowest = found, spreads, loss
    if best is None:
        raise ValueError("no Stribeck curve fits the points")
    freedom = len(speed) - 4
    fc, fs, vs, _ = best
    # fall of the curve remaining at the slowest sliding velocity, over its uncertainty
    left = abs(fs - fc) * math.exp(-((slowest / vs) ** 2))
    error = math.sqrt(lowest / max(freedom, 1))
    blind = left < max(2 * error, 1e-3 * abs(fs - fc))
    bound = slowest / math.sqrt(math.log(max(abs(fs - fc) / max(2 * error, 1e-9), math.e)))
    because = {
        "Vs": f"the slowest sliding velocity, {slowest:.3g} m/s, is above the fall of the "
        f"curve: any Vs below about {bound:.2g} m/s fits as well",
        "Fs": "there is no break-away point in this direction",
        "Fc": "the velocities do not distinguish Coulomb friction from the fall of the curve",
        "sigma2": "the range of velocities is too small for the viscous slope",
    }
    if freedom < 1:
        because = dict.fromkeys(
            because, "four points for four parameters leave none to estimate the error"
        )
    intervals = {}
    for name, unit, k in (("Fc", "N", 0), ("Fs", "N", 1), ("Vs", "m/s", 2), ("sigma2", "N*s/m", 3)):
        spread = math.sqrt(covariance[k, k]) if covariance[k, k] >= 0 else math.inf
        if (name == "Vs" and blind) or (name == "Fs" and np.all(moving)):
            intervals[name] = Interval(
                float(best[k]), unit, None, None, None, _METHOD, False, because[name]
            )
        else:
            intervals[name] = student_interval(
                float(best[k]), spread, freedom, unit, _METHOD, because[name]
            )
    return intervals
