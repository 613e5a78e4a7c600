"""Commands for open loops, and references for closed ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Signal = NDArray[np.float64]
OPEN_LOOP = ("steps", "ramps", "multisine", "chirp")
CLOSED_LOOP = ("laps", "points", "sines", "sweep")


def open_loop(
    rng: np.random.Generator, kind: str, time: Signal, most: float, least: float, way: float
) -> Signal:
    """A command that oscillates about zero.

    Parameters
    ----------
    kind : str
        One of `OPEN_LOOP`.
    time : ndarray, shape (n,)
        Times, s.
    most, least : float
        The largest command, and the smallest one that breaks the axis away, V.
    way : float
        Largest integral of the command in one direction, V*s.

    Raises
    ------
    ValueError
        For an unknown kind.
    """
    duration = time[-1]
    if kind == "steps":
        return _steps(rng, time, most, least, way)
    if kind == "ramps":
        period = duration / rng.integers(3, 9)
        high = min(most, 2.5 * least + 4 * way / period)
        phase = (time / period + 0.25) % 1.0
        triangle = 4 * np.abs(phase - 0.5) - 1
        return -high * triangle * np.where(np.floor(time / period) % 2 == 0, 1.0, 0.6)
    if kind == "multisine":
        tones = np.exp(rng.uniform(np.log(0.3), np.log(25.0), rng.integers(5, 12)))
        tones = np.maximum(np.round(tones * duration), 2) / duration
        weights = np.minimum(most, 2 * np.pi * tones * way) * rng.uniform(0.3, 1.0, tones.size)
        waves = [
            w * np.sin(2 * np.pi * f * time + p)
            for w, f, p in zip(weights, tones, rng.uniform(0, 2 * np.pi, tones.size), strict=True)
        ]
        sum_ = np.sum(waves, axis=0)
        return sum_ * min(1.0, most / np.abs(sum_).max()) * rng.uniform(0.5, 1.0)
    if kind == "chirp":
        low, high = rng.uniform(0.2, 0.6), rng.uniform(8.0, 30.0)
        rate = np.log(high / low) / duration
        now = low * np.exp(rate * time)
        swing = np.minimum(most, 2.0 * least + 2 * np.pi * now * way)
        return swing * rng.uniform(0.5, 1.0) * np.sin(2 * np.pi * (now - low) / rate)
    raise ValueError(f"excitation {kind!r}, expected one of {', '.join(OPEN_LOOP)}")


def _steps(rng: np.random.Generator, time: Signal, most: float, least: float, way: float) -> Signal:
    """Steps up and back, some with a rest in between."""
    signal, at, sign = np.zeros(time.size), 0.0, 1.0
    while at < time[-1]:
        height = float(np.exp(rng.uniform(np.log(1.5 * least), np.log(most))))
        long = min(float(rng.uniform(0.1, 1.0)), way / height)
        rest = float(rng.choice([0.0, 0.0, rng.uniform(0.05, 0.3)]))
        for part in (sign, -sign):
            signal[(time >= at) & (time < at + long)] = part * height
            at += long + rest
        sign = -sign
    return signal


def reference(
    rng: np.random.Generator, kind: str, time: Signal, half: float, fastest: float
) -> Signal:
    """Reference positions about zero, m; limited to `half`, and their speed to `fastest`.

    Raises
    ------
    ValueError
        For an unknown kind.
    """
    if kind == "laps":
        legs = [(s * half, fastest * f) for f in (1.0, 0.3, 0.1) for s in (0.9, -0.9)]
        return _profile(rng, legs, time, repeat=True)
    if kind == "points":
        places = rng.uniform(-half, half, 200)
        speeds = fastest * np.exp(rng.uniform(np.log(0.02), 0.0, 200))
        return _profile(rng, list(zip(places, speeds, strict=True)), time, repeat=False)
    if kind == "sines":
        tones = np.exp(rng.uniform(np.log(0.15), np.log(4.0), rng.integers(2, 6)))
        swing = np.minimum(half, fastest / (2 * np.pi * tones)) / tones.size
        starts = rng.uniform(0, 2 * np.pi, tones.size)
        waves = [
            s * (np.sin(2 * np.pi * f * time + p) - np.sin(p) * np.exp(-3 * time))
            for s, f, p in zip(swing, tones, starts, strict=True)
        ]
        return np.asarray(np.sum(waves, axis=0))
    if kind == "sweep":
        low, high = rng.uniform(0.1, 0.3), rng.uniform(3.0, 10.0)
        rate = np.log(high / low) / time[-1]
        now = low * np.exp(rate * time)
        swing = np.minimum(half, fastest / (2 * np.pi * now))
        return swing * np.sin(2 * np.pi * (now - low) / rate)
    raise ValueError(f"reference {kind!r}, expected one of {', '.join(CLOSED_LOOP)}")


def one_way(rng: np.random.Generator, time: Signal, half: float, fastest: float) -> Signal:
    """From one end to the other in a few moves in one direction, with long rests between, m."""
    count = int(rng.integers(4, 10))
    places = np.sort(np.append(rng.uniform(-half, half, count - 1), [-half, half]))
    moves = np.diff(places)
    speeds = fastest * np.exp(rng.uniform(np.log(0.05), 0.0, count))
    rests = rng.uniform(0.3, 1.5, count)
    spare = 0.9 * time[-1] - rests.sum()
    speeds = np.minimum(speeds * max((moves / speeds).sum() / spare, 0.05), fastest)
    stamps, line = [0.0], [-half]
    for place, move, speed, rest in zip(places[1:], moves, speeds, rests, strict=True):
        stamps += [stamps[-1] + rest, stamps[-1] + rest + move / speed]
        line += [line[-1], place]
    return _rounded(np.interp(time, stamps, line), time)


def lead_in(place: float, time: Signal) -> Signal:
    """From the middle to a position, with a rest there, m."""
    share = np.minimum(time / (0.8 * time[-1]), 1.0)
    return np.asarray(0.5 * place * (1 - np.cos(np.pi * share)))


def _profile(
    rng: np.random.Generator, legs: list[tuple[float, float]], time: Signal, *, repeat: bool
) -> Signal:
    """From position to position at given speeds, smoothed by a moving mean over 0.1 s."""
    at, here = 0.1, 0.0
    stamps, places = [0.0, at], [0.0, 0.0]
    rest = float(rng.uniform(0.02, 0.2))
    for place, speed in legs * (60 if repeat else 1):
        at += max(abs(place - here) / speed, 0.02)
        here = place
        stamps += [at, at + rest]
        places += [here, here]
        at += rest
        if at > time[-1]:
            break
    return _rounded(np.interp(time, stamps, places), time)


def _rounded(line: Signal, time: Signal) -> Signal:
    wide = max(int(0.1 / (time[1] - time[0])), 1)
    smooth = np.convolve(np.pad(line, (wide, 0), mode="edge"), np.ones(wide) / wide, "valid")
    return np.asarray(smooth[: time.size])
