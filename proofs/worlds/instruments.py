"""Instruments of a record: encoders, current sensors, and the column of the command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, sosfiltfilt

from worlds.compiled import compiled
from worlds.layout import Vector
from worlds.simulator import read_encoder

ENCODERS = ("round", "floor", "interpolated", "filtered", "exact")
CURRENTS = ("none", "good", "offset_and_gain", "filtered", "coarse")
COMMANDS = ("held", "ramped", "averaged")


@dataclass(frozen=True)
class Instruments:
    """The instruments of one record (the encoder's counts belong to the axis).

    Attributes
    ----------
    encoder, current, command : str
        Kinds in `ENCODERS`, `CURRENTS`, `COMMANDS`.
    cutoff : float
        Cut-off of filtered positions, share of the sampling frequency; filtered in both time
        directions.
    current_noise, current_offset, current_step : float
        Errors of the current, A.
    current_gain : float
    current_lag : float
        Lag of the current, s.
    """

    encoder: str
    current: str
    command: str
    cutoff: float
    current_noise: float
    current_offset: float
    current_gain: float
    current_lag: float
    current_step: float


@compiled
def _read_all(axis, x):  # type: ignore[no-untyped-def]
    read = np.empty_like(x)
    for k in range(x.size):
        read[k] = read_encoder(axis, x[k])
    return read


def read_position(
    instruments: Instruments, axis: Vector, x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The column x of a record from the true positions at its samples, shape (samples,)."""
    read = _read_all(axis, x)
    if instruments.encoder == "filtered":
        low_pass = butter(4, 2 * instruments.cutoff, output="sos")
        read = sosfiltfilt(low_pass, read)
    return np.asarray(read)


def read_current(
    instruments: Instruments,
    rng: np.random.Generator,
    i: NDArray[np.float64],
    period: float,
) -> NDArray[np.float64]:
    """The column i of a record from the true currents at its samples, shape (samples,)."""
    read = np.array(i)
    if instruments.current_lag > 0:
        keep = np.exp(-period / instruments.current_lag)
        read = lfilter([1 - keep], [1.0, -keep], read)
    read = instruments.current_gain * read + instruments.current_offset
    read += instruments.current_noise * rng.standard_normal(read.size)
    if instruments.current_step > 0:
        read = np.round(read / instruments.current_step) * instruments.current_step
    return np.asarray(read)


def draw_instruments(
    rng: np.random.Generator, encoders: dict[str, float], currents: dict[str, float], command: str
) -> Instruments:
    """Random instruments by the world's odds of each kind."""
    encoder = _pick(rng, encoders)
    current = _pick(rng, currents)
    fine = current == "good"
    spoilt = current == "offset_and_gain"
    return Instruments(
        encoder=encoder,
        current=current,
        command=command,
        cutoff=float(rng.uniform(0.08, 0.3)),
        current_noise=1e-3 if fine else float(rng.uniform(1e-3, 5e-3)),
        current_offset=float(rng.uniform(-0.02, 0.02)) if spoilt else 0.0,
        current_gain=1 + (float(rng.uniform(-0.025, 0.025)) if spoilt else 0.0),
        current_lag=float(np.exp(rng.uniform(np.log(1e-4), np.log(8e-4))))
        if current == "filtered"
        else 0.0,
        current_step=float(rng.choice([5e-3, 1e-2, 2e-2])) if current == "coarse" else 0.0,
    )


def _pick(rng: np.random.Generator, shares: dict[str, float]) -> str:
    names = list(shares)
    odds = np.array([shares[n] for n in names])
    return str(rng.choice(names, p=odds / odds.sum()))
