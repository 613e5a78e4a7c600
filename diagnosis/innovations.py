"""What a record says beyond a linear drive's own prediction: a Kalman filter, compiled.

The filter turns measured signals into innovations: what each sample brings that those before it did
not foretell. They are white, of unit variance, where the drive and its noise are as modelled.
Because the filter is linear, what a force or a voltage would do to the innovations is the same
filter run on that force or voltage alone: whatever may be wrong with a model becomes a column of a
least-squares problem whose noise is white.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from .compiled import compiled, compiled_in_place

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

NOISE_STATE = -1  # the last state is the unmodelled force
_NOTHING = 1e-100  # of a state [m, m/s, A or N]


@dataclass(frozen=True)
class LinearDrive:
    """A drive without its friction, from one sample to the next.

    Attributes
    ----------
    move : ndarray, shape (s, s)
    by_command, by_force : ndarray, shape (s,)
        What a command [its unit] and a force against the motion [N], held over the step, do.
    sees : ndarray, shape (channels, s)
        What each measured signal shows of the states.
    restless : ndarray, shape (s, s)
        Covariance that the unmodelled force adds in a step.
    noise : ndarray, shape (channels,)
        Variances of the measured signals.
    doubt : ndarray, shape (s,)
        Standard deviations of the states before the first sample.
    """

    move: Matrix
    by_command: Vector
    by_force: Vector
    sees: Matrix
    restless: Matrix
    noise: Vector
    doubt: Vector


def sampled(
    equations: Matrix,
    by_command: Vector,
    by_force: Vector,
    sees: Matrix,
    noise: Vector,
    doubt: Vector,
    step: float,
    force_rms: float,
    force_time: float,
) -> LinearDrive:
    """The drive sampled, with an unmodelled force that forgets itself in `force_time` [s].

    Parameters
    ----------
    equations : ndarray, shape (s, s)
        Derivatives of the states by the states; the unmodelled force comes last here already, with
        what it does to the others, its own decay left zero.
    by_command, by_force : ndarray, shape (s,)
    step : float
        Sampling interval [s].
    force_rms : float
        [N]
    """
    s = len(equations)
    a = equations.copy()
    a[NOISE_STATE, NOISE_STATE] = -1.0 / force_time
    held = np.zeros((s + 2, s + 2))
    held[:s, :s], held[:s, s], held[:s, s + 1] = a, by_command, by_force
    held = expm(held * step)
    # Van Loan: the noise collected over a step
    density = np.zeros((s, s))
    density[NOISE_STATE, NOISE_STATE] = 2.0 * force_rms**2 / force_time
    pair = np.zeros((2 * s, 2 * s))
    pair[:s, :s], pair[:s, s:], pair[s:, s:] = -a, density, a.T
    # states differ by many powers of ten and fast ones decay within a step: in short pieces
    pieces = max(1, int(np.ceil(np.abs(np.linalg.eigvals(a)).max() * step / 4.0)))
    pair = expm(pair * step / pieces)
    small = pair[s:, s:].T
    piece = small @ pair[:s, s:]
    collected = np.zeros((s, s))
    for _ in range(pieces):
        collected = small @ collected @ small.T + piece
    return LinearDrive(
        np.ascontiguousarray(held[:s, :s]),
        np.ascontiguousarray(held[:s, s]),
        np.ascontiguousarray(held[:s, s + 1]),
        sees,
        0.5 * (collected + collected.T),
        noise,
        doubt,
    )


@dataclass(frozen=True)
class Gains:
    """How a filter weighs each sample; `spread` is that of the innovations.

    Attributes
    ----------
    gain : ndarray, shape (n, channels, s)
    spread : ndarray, shape (n, channels)
        Standard deviations; infinite where nothing was measured.
    """

    gain: npt.NDArray[np.float64]
    spread: Matrix


def gains(
    drive: LinearDrive, measured: npt.NDArray[np.bool_], coarse: Matrix, extra: Vector
) -> Gains:
    """The filter's gains along a record.

    Parameters
    ----------
    measured : ndarray of bool, shape (n, channels)
    coarse : ndarray, shape (n, channels)
        By how much more the variance of a sample is than that of its instrument.
    extra : ndarray, shape (n,)
        Variance of the force [N^2] of which nothing is known at a sample, beside the drive's own.
    """
    n, channels = measured.shape
    gain = np.zeros((n, channels, len(drive.move)))
    spread = np.full((n, channels), np.inf)
    _gains(
        drive.move,
        drive.by_force,
        drive.sees,
        drive.restless,
        drive.noise,
        drive.doubt,
        measured,
        coarse,
        extra,
        gain,
        spread,
    )
    return Gains(gain, spread)


@compiled
def _gains(
    move: Matrix,
    by_force: Vector,
    sees: Matrix,
    restless: Matrix,
    noise: Vector,
    doubt: Vector,
    measured: npt.NDArray[np.bool_],
    coarse: Matrix,
    extra: Vector,
    gain: npt.NDArray[np.float64],
    spread: Matrix,
) -> None:
    n, channels = measured.shape
    s = len(move)
    p = np.zeros((s, s))
    for a in range(s):
        p[a, a] = doubt[a] ** 2
    half = np.empty((s, s))
    seen = np.empty(s)
    for k in range(n):
        for c in range(channels):
            if not measured[k, c]:
                continue
            variance = noise[c] * coarse[k, c]
            for a in range(s):
                seen[a] = 0.0
                for b in range(s):
                    seen[a] += p[a, b] * sees[c, b]
            for a in range(s):
                variance += sees[c, a] * seen[a]
            spread[k, c] = np.sqrt(variance)
            for a in range(s):
                gain[k, c, a] = seen[a] / variance
            for a in range(s):
                for b in range(s):
                    p[a, b] -= seen[a] * seen[b] / variance
        for a in range(s):
            for b in range(s):
                half[a, b] = 0.0
                for d in range(s):
                    half[a, b] += move[a, d] * p[d, b]
        for a in range(s):
            for b in range(a + 1):
                total = restless[a, b] + extra[k] * by_force[a] * by_force[b]
                for d in range(s):
                    total += half[a, d] * move[b, d]
                p[a, b] = total
                p[b, a] = total


def innovations(
    drive: LinearDrive,
    weights: Gains,
    signals: npt.NDArray[np.float64],
    command: Matrix,
    force: Matrix,
    start: Matrix | None = None,
) -> npt.NDArray[np.float64]:
    """Innovations in units of their spread.

    Parameters
    ----------
    signals : ndarray, shape (n, channels, columns)
        What was measured; 0 for columns that ask what a command or a force alone would do.
    command, force : ndarray, shape (n, columns)
        Held from each sample to the next.
    start : ndarray, shape (s, columns), optional
        States before the first sample.

    Returns
    -------
    ndarray, shape (n, channels, columns)
        Zero where nothing was measured.
    """
    n, channels, columns = signals.shape
    out = np.zeros((n, channels, columns))
    state = np.zeros((len(drive.move), columns)) if start is None else start.astype(float).copy()
    _innovations(
        drive.move,
        drive.by_command,
        drive.by_force,
        drive.sees,
        weights.gain,
        weights.spread,
        signals,
        command,
        force,
        state,
        out,
    )
    return out


@compiled
def _innovations(
    move: Matrix,
    by_command: Vector,
    by_force: Vector,
    sees: Matrix,
    gain: npt.NDArray[np.float64],
    spread: Matrix,
    signals: npt.NDArray[np.float64],
    command: Matrix,
    force: Matrix,
    state: Matrix,
    out: npt.NDArray[np.float64],
) -> None:
    n, channels, columns = signals.shape
    s = len(move)
    after = np.empty((s, columns))
    error = np.empty(columns)
    for k in range(n):
        for c in range(channels):
            if spread[k, c] == np.inf:
                continue
            for j in range(columns):
                error[j] = signals[k, c, j]
            for a in range(s):
                if sees[c, a] != 0.0:
                    for j in range(columns):
                        error[j] -= sees[c, a] * state[a, j]
            for j in range(columns):
                out[k, c, j] = error[j] / spread[k, c]
            for a in range(s):
                g = gain[k, c, a]
                for j in range(columns):
                    state[a, j] += g * error[j]
        for a in range(s):
            for j in range(columns):
                after[a, j] = by_command[a] * command[k, j] + by_force[a] * force[k, j]
            for b in range(s):
                m = move[a, b]
                if m != 0.0:
                    for j in range(columns):
                        after[a, j] += m * state[b, j]
        for a in range(s):
            for j in range(columns):
                # what dies away without end is slow to multiply once its digits run out
                state[a, j] = after[a, j] if abs(after[a, j]) > _NOTHING else 0.0


@dataclass(frozen=True)
class Smoothed:
    """States at all samples in the light of the whole record.

    Attributes
    ----------
    state, spread : ndarray, shape (n, s)
        Estimates and their standard deviations.
    """

    state: Matrix
    spread: Matrix


def smooth(
    drive: LinearDrive,
    signals: Matrix,
    coarse: Matrix,
    command: Vector,
    force: Vector,
    extra: Vector,
    start: Vector,
) -> Smoothed:
    """Rauch-Tung-Striebel smoothing of one record.

    Parameters
    ----------
    signals : ndarray, shape (n, channels)
        NaN where nothing was measured.
    coarse : ndarray, shape (n, channels)
    command, force, extra : ndarray, shape (n,)
        As in `gains` and `innovations`.
    start : ndarray, shape (s,)
    """
    n, s = len(signals), len(start)
    state, spread = np.empty((n, s)), np.empty((n, s))
    _smooth(
        drive.move,
        drive.by_command,
        drive.by_force,
        drive.sees,
        drive.restless,
        drive.noise,
        drive.doubt,
        signals,
        coarse,
        command,
        force,
        extra,
        start,
        state,
        spread,
    )
    return Smoothed(state, spread)


@compiled
def _smooth(
    move: Matrix,
    by_command: Vector,
    by_force: Vector,
    sees: Matrix,
    restless: Matrix,
    noise: Vector,
    doubt: Vector,
    signals: Matrix,
    coarse: Matrix,
    command: Vector,
    force: Vector,
    extra: Vector,
    start: Vector,
    state: Matrix,
    spread: Matrix,
) -> None:
    # Bryson-Frazier: adjoints run back through the gains, and no covariance is inverted. Products
    # are written out: BLAS costs more than it does on matrices of four rows.
    n, channels = signals.shape
    s = len(start)
    x, p = start.copy(), np.diag(doubt**2)
    pushed = np.outer(by_force, by_force)
    before_x, before_p = np.empty((n, s)), np.empty((n, s, s))
    seen, moved, half = np.empty(s), np.empty(s), np.empty((s, s))
    for k in range(n):
        before_x[k] = x
        before_p[k] = p
        for c in range(channels):
            if not np.isnan(signals[k, c]):
                _learn(x, p, sees[c], noise[c] * coarse[k, c], signals[k, c], seen)
        for a in range(s):
            moved[a] = by_command[a] * command[k] + by_force[a] * force[k]
            for b in range(s):
                moved[a] += move[a, b] * x[b]
        x[:] = moved
        for a in range(s):
            for b in range(s):
                half[a, b] = 0.0
                for j in range(s):
                    half[a, b] += move[a, j] * p[j, b]
        for a in range(s):
            for b in range(a + 1):
                total = restless[a, b] + extra[k] * pushed[a, b]
                for j in range(s):
                    total += half[a, j] * move[b, j]
                p[a, b] = p[b, a] = total
    lam, big = np.zeros(s), np.zeros((s, s))
    xs, ps = np.empty((channels, s)), np.empty((channels, s, s))
    turned = np.empty(s)
    for k in range(n - 1, -1, -1):
        for a in range(s):
            moved[a] = 0.0
            for b in range(s):
                moved[a] += move[b, a] * lam[b]
        lam[:] = moved
        for a in range(s):
            for b in range(s):
                half[a, b] = 0.0
                for j in range(s):
                    half[a, b] += move[j, a] * big[j, b]
        for a in range(s):
            for b in range(a + 1):
                total = 0.0
                for j in range(s):
                    total += half[a, j] * move[j, b]
                big[a, b] = big[b, a] = total
        # the channels were taken one after the other: undo them in reverse
        x[:] = before_x[k]
        p[:] = before_p[k]
        for c in range(channels):
            xs[c] = x
            ps[c] = p
            if not np.isnan(signals[k, c]):
                _learn(x, p, sees[c], noise[c] * coarse[k, c], signals[k, c], seen)
        for c in range(channels - 1, -1, -1):
            if np.isnan(signals[k, c]):
                continue
            h = sees[c]
            variance, surprise, along, twice = noise[c] * coarse[k, c], signals[k, c], 0.0, 0.0
            for a in range(s):
                seen[a] = 0.0
                for b in range(s):
                    seen[a] += ps[c, a, b] * h[b]
                variance += h[a] * seen[a]
                surprise -= h[a] * xs[c, a]
            for a in range(s):
                turned[a] = 0.0
                for b in range(s):
                    turned[a] += big[a, b] * seen[b] / variance
            for a in range(s):
                along += seen[a] / variance * lam[a]
                twice += seen[a] / variance * turned[a]
            for a in range(s):
                lam[a] -= h[a] * (along + surprise / variance)
                for b in range(s):
                    big[a, b] += h[a] * h[b] * (twice + 1.0 / variance)
                    big[a, b] -= h[a] * turned[b] + turned[a] * h[b]
        for a in range(s):
            total, state[k, a] = before_p[k, a, a], before_x[k, a]
            for b in range(s):
                state[k, a] -= before_p[k, a, b] * lam[b]
                for j in range(s):
                    total -= before_p[k, a, b] * big[b, j] * before_p[k, j, a]
            spread[k, a] = np.sqrt(max(total, 0.0))


@compiled_in_place
def _learn(x: Vector, p: Matrix, h: Vector, noise: float, measured: float, seen: Vector) -> None:
    """Take a measurement of variance `noise` into a state and its covariance, in place."""
    s = len(x)
    variance, surprise = noise, measured
    for a in range(s):
        seen[a] = 0.0
        for b in range(s):
            seen[a] += p[a, b] * h[b]
        variance += h[a] * seen[a]
        surprise -= h[a] * x[a]
    for a in range(s):
        x[a] += seen[a] * surprise / variance
        for b in range(s):
            p[a, b] -= seen[a] * seen[b] / variance
