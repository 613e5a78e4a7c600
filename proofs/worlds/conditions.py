"""Quantities that a world draws, and functions to draw them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from worlds.axes import Axis
from worlds.effects import Effect


@dataclass(frozen=True)
class Conditions:
    """One draw of a world: everything about a record except the effect.

    Attributes
    ----------
    axis : Axis
    sampling : float
        Period of the record, s.
    faster : int
        Control periods in a sampling period.
    substep : float
        Largest substep, s.
    duration : float
        Duration, s.
    loop : str
        ``open``, ``cascade`` or ``pid``.
    excitation : str
    bandwidth : float
        Bandwidth of a closed loop's velocity, Hz.
    command : str
        Course of the command between samples, and form in the record.
    encoders, currents : dict
        Odds of each kind.
    resolution : float
        Resolution of the encoder, m.
    interpolation : float
        Interpolation error, m.
    noise : str
    noise_size : float
        Share of the dry friction.
    exact : float
        Share of records in which no believed value is off.
    finest : float
        Factor on the smallest effects.
    correlation_time : float
        Correlation time of slow friction noise, s; 0: random.
    current_noise : float
        Factor on the ammeter's noise.
    jitter : float
        Standard deviation of the time stamps, share of the sampling period.
    resampled : float
        Original period of a resampled record, share of the new one; 0: not resampled.
    lead_in : float
        Time before the record in which the axis moves to its start position, s.
    tolerated : tuple of Effect
        Unknown and invisible properties: reduced until their ratio is below 3.
    """

    axis: Axis
    sampling: float
    faster: int
    substep: float
    duration: float
    loop: str
    excitation: str
    bandwidth: float
    command: str
    encoders: dict[str, float]
    currents: dict[str, float]
    resolution: float
    interpolation: float
    noise: str
    noise_size: float
    exact: float
    finest: float = 1.0
    correlation_time: float = 0.0
    current_noise: float = 1.0
    jitter: float = 0.0
    resampled: float = 0.0
    lead_in: float = 0.0
    tolerated: tuple[Effect, ...] = ()


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def pick(rng: np.random.Generator, **odds: float) -> str:
    weights = np.array(list(odds.values()))
    return str(rng.choice(list(odds), p=weights / weights.sum()))


def scattered(rng: np.random.Generator, **values: float) -> dict[str, float]:
    """Values changed at random by up to a third."""
    return {name: value * log_uniform(rng, 0.75, 1.33) for name, value in values.items()}
