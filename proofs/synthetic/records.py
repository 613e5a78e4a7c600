"""Records of known truth: a law along a prescribed motion, measured by load cell and encoder.

The law is integrated in small implicit steps, independently of the tested code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ballscrew.measurement.records.record import Record

try:
    from numba import njit
except ModuleNotFoundError:  # the same, slower

    def njit(cache: bool) -> Callable[[Callable[..., Vector]], Callable[..., Vector]]:
        return lambda function: function


LUGRE = {
    "sigma0": 66967.0,
    "sigma1": 344.56,
    "sigma2": 173.0,
    "Fc": 1.284,
    "Fs": 2.35,
    "Vs": 1.14e-3,
}
Vector = npt.NDArray[np.float64]
COUNT = 1e-3 / 512
RESOLUTION = 0.089
FINE = 20  # steps of the law in one sampling interval


@dataclass(frozen=True)
class Trial:
    """A prescribed motion: position [m] as a function of time from rest, and its sampling."""

    name: str
    duration: float
    position: Callable[[Vector], Vector]
    step: float = 0.005
    fine: bool = False


def constant_velocity(speed: float, duration: float = 2.0, rise: float = 0.06) -> Trial:
    """A velocity reached exponentially from rest."""

    def position(t: Vector) -> Vector:
        return speed * (t - rise * (1 - np.exp(-t / rise)))

    return Trial(f"velocity {speed}", duration, position)


def sine_velocity(amplitude: float, omega: float, duration: float) -> Trial:
    """The velocity amplitude*sin(omega*t)."""
    return Trial(
        f"sine {amplitude} {omega}",
        duration,
        lambda t: amplitude / omega * (1 - np.cos(omega * t)),
    )


def slow_load(displacement: float, time: float = 0.8, duration: float = 5.0) -> Trial:
    """A presliding displacement as after a force step, measured by the capacitance sensor."""
    return Trial(
        f"load {displacement}",
        duration,
        lambda t: displacement * (1 - (1 + t / time) * np.exp(-t / time)),
        fine=True,
    )


@njit(cache=True)
def _lugre(x: Vector, h: float, p: Vector) -> Vector:
    force = np.empty(len(x))
    z = 0.0
    force[0] = 0.0
    for k in range(1, len(x)):
        v = (x[k] - x[k - 1]) / h
        q = p[:6] if v > 0 else p[6:]
        g = q[3] + (q[4] - q[3]) * math.exp(-((v / q[5]) ** 2))
        b = p[:6] if z > 0 else p[6:]  # by the direction in which the bristles are bent
        half = 0.5 * h * b[0] * abs(v) / g
        z = (z * (1 - half) + h * v) / (1 + half)
        if k + 1 < len(x):
            v = 0.5 * (x[k + 1] - x[k - 1]) / h
        g = q[3] + (q[4] - q[3]) * math.exp(-((v / q[5]) ** 2))
        b = p[:6] if z > 0 else p[6:]
        force[k] = b[0] * z + q[1] * (v - b[0] * abs(v) * z / g) + q[2] * v
    return force


@njit(cache=True)
def _dahl(x: Vector, p: Vector) -> Vector:
    force = np.zeros(len(x))
    for k in range(1, len(x)):
        d = x[k] - x[k - 1]
        q = p[:3] if d > 0 else p[3:]
        s = 1.0 if d > 0 else -1.0
        f = force[k - 1]
        half = f + 0.5 * d * q[0] * max(1 - s * f / q[1], 0.0) ** q[2]
        force[k] = f + d * q[0] * max(1 - s * half / q[1], 0.0) ** q[2]
    return force


@njit(cache=True)
def _bliman_sorine(x: Vector, p: Vector) -> Vector:
    force = np.zeros(len(x))
    one = 0.0
    two = 0.0
    for k in range(1, len(x)):
        d = x[k] - x[k - 1]
        q = p[:4] if d > 0 else p[4:]
        fast, slow = 0.5 * abs(d) / (q[3] * q[2]), 0.5 * abs(d) / q[2]
        s = 2.0 if d > 0 else -2.0
        one = (one * (1 - fast) + s * q[0] * fast) / (1 + fast)
        two = (two * (1 - slow) - s * q[1] * slow) / (1 + slow)
        force[k] = one + two
    return force


def true_friction(law: str, x: Vector, h: float, parameters: Mapping[str, float]) -> Vector:
    """Friction along a finely sampled motion; `parameters` may have ``_pos`` and ``_neg``."""
    names = {
        "dahl": ("sigma", "Fc", "alpha"),
        "bliman_sorine": ("f1", "f2", "eps_f", "eta"),
    }.get(law, ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "Vs"))
    p = np.array(
        [
            parameters.get(f"{n}_{side}", parameters.get(n, 0.0))
            for side in ("pos", "neg")
            for n in names
        ]
    )
    if law == "dahl":
        return _dahl(x, p)
    if law == "bliman_sorine":
        return _bliman_sorine(x, p)
    return _lugre(x, h, p)


def record_of(
    trial: Trial,
    law: str,
    parameters: Mapping[str, float],
    random: np.random.Generator,
    delay: float = 0.0,
    noise: float = 0.03,
    mass: float = 1.0,
) -> Record:
    """The record of a trial by the instruments.

    Parameters
    ----------
    delay : float
        Delay of the force sample relative to the motion [s].
    noise : float
        Noise of the load cell before rounding [N].
    """
    h = trial.step / FINE
    margin = 2 * FINE
    n = round(trial.duration / trial.step)
    t = h * np.arange(-margin, n * FINE + margin)
    x = np.where(t > 0, trial.position(np.maximum(t, 0.0)), 0.0)
    a = np.gradient(np.gradient(x, h), h)
    force = true_friction(law, x, h, parameters) + mass * a
    times = trial.step * np.arange(n)
    seen = np.interp(times - delay, t, force) + noise * random.standard_normal(n)
    force_read = np.floor(seen / RESOLUTION + 0.5) * RESOLUTION
    at = np.interp(times, t, x)
    phase = random.uniform()
    signals = {
        "time": times,
        "force": force_read,
        "x": np.floor(at / COUNT + phase) * COUNT,
    }
    gain_std = 0.01 if trial.fine else 0.0
    if trial.fine:
        gain, bend = gain_std * random.standard_normal(2) * (1, 0.5)
        scaled = at * (1 + gain + bend * at / np.abs(at).max())
        signals["x_fine"] = scaled + 5e-8 * random.standard_normal(n)
    return Record(
        trial.name,
        signals,
        trial.step,
        mass=mass,
        delay_std=trial.step / math.sqrt(12),
        gain_std=gain_std,
    )
