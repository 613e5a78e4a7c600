"""Records of known truth: a law along a prescribed motion, measured by load cell and encoder.

The law is integrated in small implicit steps, independently of the tested code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from worlds.axis import compiled

from ballscrew.measurement.records.record import Record
from ballscrew.solver.arrays import Vector

LUGRE = {"sigma0": 66967.0, "sigma1": 344.56, "sigma2": 173.0, "Fc": 1.284, "Fs": 2.35}
LUGRE["Vs"] = 1.14e-3
NAMES = {"dahl": ("sigma", "Fc", "alpha"), "bliman_sorine": ("f1", "f2", "eps_f", "eta")}
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
    name = f"velocity {speed}"
    return Trial(name, duration, lambda t: speed * (t - rise * (1 - np.exp(-t / rise))))


def sine_velocity(amplitude: float, omega: float, duration: float) -> Trial:
    """The velocity amplitude*sin(omega*t)."""
    name = f"sine {amplitude} {omega}"
    return Trial(name, duration, lambda t: amplitude / omega * (1 - np.cos(omega * t)))


def slow_load(displacement: float, time: float = 0.8, duration: float = 5.0) -> Trial:
    """A presliding displacement as after a force step, measured by the capacitance sensor."""

    def position(t: Vector) -> Vector:
        return displacement * (1 - (1 + t / time) * np.exp(-t / time))

    return Trial(f"load {displacement}", duration, position, fine=True)


@compiled
def _lugre(x, h, p):
    force, z = np.zeros(len(x)), 0.0
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


@compiled
def _dahl(x, p):
    force = np.zeros(len(x))
    for k in range(1, len(x)):
        d, f = x[k] - x[k - 1], force[k - 1]
        q, s = (p[:3], 1.0) if d > 0 else (p[3:], -1.0)
        half = f + 0.5 * d * q[0] * max(1 - s * f / q[1], 0.0) ** q[2]
        force[k] = f + d * q[0] * max(1 - s * half / q[1], 0.0) ** q[2]
    return force


@compiled
def _bliman_sorine(x, p):
    force, one, two = np.zeros(len(x)), 0.0, 0.0
    for k in range(1, len(x)):
        d = x[k] - x[k - 1]
        q, s = (p[:4], 2.0) if d > 0 else (p[4:], -2.0)
        fast, slow = 0.5 * abs(d) / (q[3] * q[2]), 0.5 * abs(d) / q[2]
        one = (one * (1 - fast) + s * q[0] * fast) / (1 + fast)
        two = (two * (1 - slow) - s * q[1] * slow) / (1 + slow)
        force[k] = one + two
    return force


def true_friction(law: str, x: Vector, h: float, parameters: Mapping[str, float]) -> Vector:
    """Friction along a finely sampled motion; `parameters` may have ``_pos`` and ``_neg``."""
    names = [f"{n}_{side}" for side in ("pos", "neg") for n in NAMES.get(law, LUGRE)]
    p = np.array([parameters.get(name, parameters.get(name[:-4], 0.0)) for name in names])
    if law in NAMES:
        return (_dahl if law == "dahl" else _bliman_sorine)(x, p)
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

    The force sample is late by a delay [s]; the load cell has noise before rounding [N].
    """
    h, margin = trial.step / FINE, 2 * FINE
    n = round(trial.duration / trial.step)
    t = h * np.arange(-margin, n * FINE + margin)
    x = np.where(t > 0, trial.position(np.maximum(t, 0.0)), 0.0)
    force = true_friction(law, x, h, parameters) + mass * np.gradient(np.gradient(x, h), h)
    times = trial.step * np.arange(n)
    seen = np.interp(times - delay, t, force) + noise * random.standard_normal(n)
    at, phase = np.interp(times, t, x), random.uniform()
    signals = {
        "time": times,
        "force": np.floor(seen / RESOLUTION + 0.5) * RESOLUTION,
        "x": np.floor(at / COUNT + phase) * COUNT,
    }
    gain_std = 0.01 if trial.fine else 0.0
    if trial.fine:
        gain, bend = gain_std * random.standard_normal(2) * (1, 0.5)
        scaled = at * (1 + gain + bend * at / np.abs(at).max())
        signals["x_fine"] = scaled + 5e-8 * random.standard_normal(n)
    late = trial.step / math.sqrt(12)
    return Record(trial.name, signals, trial.step, mass=mass, delay_std=late, gain_std=gain_std)
