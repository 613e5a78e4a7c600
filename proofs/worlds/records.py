"""Records of a motion: columns at samples, jittering stamps, other rates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from worlds import layout as at
from worlds.instruments import read_current, read_position
from worlds.scenes import Scene
from worlds.simulator import Motion
from worlds.visibility import Errors, sampled

Columns = NDArray[np.float64]
LARGEST_JITTER = 0.45  # share of the period: stamps stay in order


def make_record(
    scene: Scene, motion: Motion, changes: dict[int, float]
) -> tuple[dict[str, Columns], Errors]:
    """The columns of a record, and their errors."""
    conditions, step = scene.conditions, scene.per_sample
    axis = scene.faultless.copy()
    for place, value in changes.items():
        axis[place] = value
    log = motion.log
    if conditions.jitter or conditions.resampled:
        return _uneven(scene, motion, axis)
    x = log[::step, at.X]
    commands = motion.commands[:: conditions.faster]
    if conditions.command == "averaged":
        commands = sampled(motion.commands, conditions.faster)
    record = {
        "time": np.arange(x.size) * conditions.sampling,
        "u": commands,
        "x": read_position(scene.instruments, axis, x),
    }
    error_i = None
    if scene.instruments.current != "none":
        i = log[::step, at.CURRENT]
        record["i"], error_i = _read_current(scene, i, conditions.sampling)
    return record, Errors(record["x"] - x, error_i)


def _read_current(scene: Scene, i: Columns, period: float) -> tuple[Columns, Columns]:
    """The column and its error."""
    rng = np.random.default_rng(i.size)  # separate: other random values do not change
    read = read_current(scene.instruments, rng, i, period)
    line = np.polyfit(i, read, 1)  # a user fits a sensor's gain and offset
    return read, read - np.polyval(line, i)


def _uneven(
    scene: Scene, motion: Motion, axis: NDArray[np.float64]
) -> tuple[dict[str, Columns], Errors]:
    """A record with jittering stamps, or one resampled from another period.

    Stamps are true, positions and currents are those at the stamps, and a command is the mean until
    the next stamp. Resampling is linear between samples.
    """
    conditions, log = scene.conditions, motion.log
    own = conditions.sampling * (conditions.resampled or 1.0)
    until = len(motion.commands) * scene.period
    stamps = np.arange(int(until / own + 1e-9)) * own
    if conditions.jitter:
        rng = np.random.default_rng([len(log), int(1e6 * conditions.duration)])
        most = LARGEST_JITTER
        off = np.clip(conditions.jitter * rng.standard_normal(stamps.size), -most, most)
        stamps = np.maximum(stamps + own * off, 0.0)
    rows = np.arange(len(log)) * scene.period / scene.logged
    record = {
        "time": stamps,
        "u": _means(motion.commands, scene.period, np.append(stamps, until)),
        "x": read_position(scene.instruments, axis, CubicSpline(rows, log[:, at.X])(stamps)),
    }
    error_i = error_u = None
    if scene.instruments.current != "none":
        i = np.interp(stamps, rows, log[:, at.CURRENT])
        record["i"], error_i = _read_current(scene, i, own)
    if conditions.resampled:
        even = np.arange(int(stamps[-1] / conditions.sampling) + 1) * conditions.sampling
        record = {n: np.interp(even, stamps, column) for n, column in record.items()}
        ends = np.append(even, min(even[-1] + conditions.sampling, until))
        error_u = record["u"] - _means(motion.commands, scene.period, ends)
        if error_i is not None:
            error_i = np.interp(even, stamps, error_i)
    true = CubicSpline(rows, log[:, at.X])(record["time"])
    return record, Errors(record["x"] - true, error_i, error_u)


def _means(commands: Columns, period: float, ends: Columns) -> Columns:
    """Means of held commands between times."""
    whole = np.concatenate([[0.0], np.cumsum(commands) * period])
    edges = np.arange(whole.size) * period
    return np.asarray(np.diff(np.interp(ends, edges, whole)) / np.diff(ends))
