"""Friction noise: white, slow, fixed to the position, or growing with speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from worlds.layout import NOISE_GROWTH, TRAVEL, Vector
from worlds.simulator import RELATIVE, TEXTURE_PHASE, Texture

KINDS = (
    "none",
    "white",
    "slow",
    "texture_repeating",
    "texture_not_repeating",
    "growing_with_speed",
)
SPACING = 10e-6  # spacing of the texture's table, m
FLAT = Texture(0.0, 1.0, np.zeros((2, 1)))


def slow_noise(
    rng: np.random.Generator, count: int, period: float, correlation_time: float
) -> NDArray[np.float64]:
    """First-order noise of unit variance, one value per period, shape (count,); times in [s]."""
    keep = np.exp(-period / correlation_time)
    white = rng.standard_normal(count) * np.sqrt(1 - keep**2)
    white[0] = rng.standard_normal()
    return lfilter([1.0], [1.0, -keep], white)


def texture_of(rng: np.random.Generator, half: float, way: float, size: float) -> Texture:
    """Friction over the travel: correlation length `way` [m], relative size `size`."""
    count = int(2.4 * half / SPACING) + 2
    tables = np.stack([slow_noise(rng, count, SPACING, way) for _ in range(2)])
    return Texture(-1.2 * half, SPACING, size * tables)


def draw_correlation_time(rng: np.random.Generator) -> float:
    """Correlation time of slow noise, s."""
    return float(np.exp(rng.uniform(np.log(0.003), np.log(0.3))))


def draw_noise(
    rng: np.random.Generator,
    kind: str,
    size: float,
    axis: Vector,
    count: int,
    period: float,
    correlation_time: float | None = None,
) -> tuple[NDArray[np.float64], Texture, float]:
    """Noise of one run.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    size : float
        Share of the dry friction.
    axis : Vector
        Gives the travel.
    count, period
        Number of control periods, and length of one [s].
    correlation_time : float, optional
        Correlation time of slow noise, s; random by default.

    Returns
    -------
    noise : ndarray, shape (count, 3)
    texture : Texture
    growth : float
        Value for NOISE_GROWTH of the axis [s/m].

    Raises
    ------
    ValueError
        For an unknown kind.
    """
    if kind not in KINDS:
        raise ValueError(f"friction noise {kind!r}, expected one of {', '.join(KINDS)}")
    noise, texture, growth = np.zeros((count, 3)), FLAT, float(axis[NOISE_GROWTH])
    if correlation_time is None:
        correlation_time = draw_correlation_time(rng)
    way = float(np.exp(rng.uniform(np.log(30e-6), np.log(2e-3))))
    if kind == "white":
        noise[:, RELATIVE] = size * rng.standard_normal(count)
    elif kind == "slow":
        noise[:, RELATIVE] = size * slow_noise(rng, count, period, correlation_time)
    elif kind == "growing_with_speed":
        noise[:, RELATIVE] = size * slow_noise(rng, count, period, min(correlation_time, 0.03))
        growth = float(rng.uniform(5.0, 40.0))
    elif kind.startswith("texture"):
        texture = texture_of(rng, axis[TRAVEL], way, size)
        if kind == "texture_not_repeating":
            turned = np.cumsum(rng.standard_normal(count)) * np.sqrt(period / 2.0)
            noise[:, TEXTURE_PHASE] = turned
    return noise, texture, growth
