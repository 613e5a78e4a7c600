"""The parts of a motion for which errors of a model are given, and regressions on a motion."""

from __future__ import annotations

import numpy as np

from ...solver.arrays import Mask, Matrix, Vector

REST = "rest"
PARTS = {
    "reversals": "within 0.1 s of a change of direction, slower than one fifth of the fast speed",
    "slow": "below half of the fast speed, without reversals",
    "fast": "from half of the fast speed on",
    "accelerating": "acceleration above its root mean square",
    "steady": "acceleration below that",
    "forwards": "towards +x",
    "backwards": "towards -x",
    REST: "not distinguishable from rest for 0.05 s or longer",
}
"""Each division, by speed, acceleration or direction, contains every moving sample once."""


def motion_parts(step: float, v: Vector, a: Vector, rests: Mask) -> dict[str, Mask]:
    """Which of n samples belong to each part; samples at rest belong to no other part.

    Parameters
    ----------
    step : float
        Sampling interval [s].
    v, a : ndarray, shape (n,)
        Velocity [m/s] and acceleration [m/s^2].
    rests : ndarray of bool, shape (n,)

    Returns
    -------
    dict of str to ndarray of bool, shape (n,)
        In the order of `PARTS`.
    """
    moving = ~rests
    speed, bend = np.abs(v), np.abs(a)
    usual = float(np.quantile(speed[moving], 0.95)) if moving.any() else 0.0  # the fast speed
    direction = _direction(v, 0.01 * usual)
    reversing = _near_changes(direction, round(0.1 / step)) & (speed < 0.2 * usual)
    slow = ~reversing & (speed < 0.5 * usual)
    hard = bend > (float(np.sqrt(np.mean(bend[moving] ** 2))) if moving.any() else 0.0)
    found = (reversing, slow, ~reversing & ~slow, hard, ~hard, direction > 0, direction < 0)
    parts = {name: mask & moving for name, mask in zip(PARTS, found, strict=False)}
    return {**parts, REST: ~moving}


def _direction(v: Vector, least: float) -> Vector:
    """Sign of the velocity, shape (n,); below `least`, the last sign."""
    known = np.flatnonzero(np.abs(v) > least)
    if not len(known):
        return np.where(v < 0.0, -1.0, 1.0)
    last = np.searchsorted(known, np.arange(len(v)), side="right") - 1
    return np.asarray(np.sign(v[known[np.maximum(last, 0)]]))


def _near_changes(direction: Vector, samples: int) -> Mask:
    """Whether a change of direction is at most `samples` samples away, shape (n,)."""
    changes = np.flatnonzero(np.diff(direction))
    near = np.zeros(len(direction) + 1)
    np.add.at(near, np.maximum(changes - samples + 1, 0), 1.0)
    np.add.at(near, np.minimum(changes + samples + 1, len(direction)), -1.0)
    return np.asarray(np.cumsum(near)[:-1] > 0.0)


def steps_of(values: Vector, count: int, where: Mask) -> Matrix:
    """One column for each of `count` ranges with as many samples, shape (n, count)."""
    out = np.zeros((len(values), count))
    if where.any():
        edges = np.quantile(values[where], np.linspace(0, 1, count + 1)[1:-1])
        rows = np.flatnonzero(where)
        out[rows, np.searchsorted(edges, values[where])] = 1.0
    return out


def way_since_reversal(x: Vector, v: Vector) -> tuple[Vector, Mask]:
    """Distance from the last reversal, shape (n,) [m], and where it is short."""
    turns = np.flatnonzero(np.diff(np.sign(v), prepend=0.0))
    turns = turns if len(turns) else np.array([0])
    last = turns[np.maximum(np.searchsorted(turns, np.arange(len(x)), "right") - 1, 0)]
    way = np.abs(x - x[last])
    return way, way < 0.05 * float(np.ptp(x))


def least_squares(columns: Matrix, values: Vector) -> Vector:
    """Least-squares coefficients; zero for an empty or dependent column, shape (columns,)."""
    size = np.linalg.norm(columns, axis=0)
    size[size <= 1e-12 * size.max(initial=0.0)] = np.inf
    found, *_ = np.linalg.lstsq(columns / size, values, rcond=1e-6)
    return np.asarray(found / size)
