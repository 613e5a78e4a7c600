"""What a world draws, and what it draws with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from worlds.axes import Axis
from worlds.effects import Effect


@dataclass(frozen=True)
class Conditions:
    """One draw of a world: everything about a record but the effect.

    Attributes
    ----------
    axis : Axis
    sampling : float
        Period of the record, s.
    faster : int
        Control periods in a sampling period.
    substep : float
        At most, s.
    duration : float
        s.
    loop : str
        ``open``, ``cascade`` or ``pid``.
    excitation : str
    bandwidth : float
        Of a closed loop's velocity, Hz.
    command : str
        How it goes between samples, and what the record has of it.
    encoders, currents : dict
        Odds of each kind.
    resolution : float
        m.
    interpolation : float
        m.
    noise : str
    noise_size : float
        Share of the dry friction.
    exact : float
        Share of records in which no believed value is off.
    finest : float
        What the smallest effects are multiplied by.
    correlation_time : float
        Of slow friction noise, s; drawn where it is 0.
    current_noise : float
        What the ammeter's noise is multiplied by.
    jitter : float
        Standard deviation of the time stamps, share of the sampling period.
    resampled : float
        Period that a record was first taken with, share of the one it was brought to; 0: it was
        not.
    lead_in : float
        Time before the record begins, in which the axis goes to where it begins, s.
    tolerated : tuple of Effect
        What nobody knows and nobody can see: made smaller until its ratio is below 3.
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
    """Values scattered by up to a third either way."""
    return {name: value * log_uniform(rng, 0.75, 1.33) for name, value in values.items()}
