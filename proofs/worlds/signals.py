"""Columns that differ from their headers: mistakes in scale, sign and time.

They change the record after the motion, not the axis.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from worlds import layout as at
from worlds.effects import Draw, Effect, Setting
from worlds.shapes import Along, dry_along

Columns = NDArray[np.float64]
# factors by usual mistakes
OF_ANY = {
    "twice": 2.0,
    "half": 0.5,
    "binary_thousand": 1000 / 1024,
    "tenth_more": 1.1,
    "tenth_less": 0.9,
}
OF_U = OF_ANY | {
    "peak_for_rms": math.sqrt(2),
    "rms_for_peak": 1 / math.sqrt(2),
    "line_voltage": math.sqrt(3),
    "phase_voltage": 1 / math.sqrt(3),
}
OF_I = OF_ANY | {
    "peak_for_rms": math.sqrt(2),
    "rms_for_peak": 1 / math.sqrt(2),
    "mean_of_sine": math.pi / 2,
}
OF_X = OF_ANY | {
    "four_edges": 4.0,
    "one_edge": 0.25,
    "turn_for_radian": 1 / (2 * math.pi),
    "radian_for_turn": 2 * math.pi,
    "radius_for_diameter": math.pi,
}
MOST_SHIFT = 20  # samples
RESTING = 1e-9  # m/s


def _scale(rng: np.random.Generator, column: str, factors: dict[str, float]) -> Effect:
    form = str(rng.choice(list(factors)))
    factor = factors[form]
    return Effect(f"scale_of_{column}", form, truth={"factor": factor}, factors={column: factor})


def scale_of_u(rng: np.random.Generator, s: Setting) -> Effect:
    """The command has another unit."""
    return _scale(rng, "u", OF_U)


def scale_of_i(rng: np.random.Generator, s: Setting) -> Effect:
    """The current has another unit."""
    return _scale(rng, "i", OF_I)


def scale_of_x(rng: np.random.Generator, s: Setting) -> Effect:
    """The encoder's counts are wrongly converted."""
    return _scale(rng, "x", OF_X)


def sign_of_u(rng: np.random.Generator, s: Setting) -> Effect:
    """The command has the opposite sign."""
    return Effect("sign_of_u", "turned", truth={"factor": -1.0}, factors={"u": -1.0})


def sign_of_x(rng: np.random.Generator, s: Setting) -> Effect:
    """The position has the opposite sign."""
    return Effect("sign_of_x", "turned", truth={"factor": -1.0}, factors={"x": -1.0})


def time_shift(rng: np.random.Generator, s: Setting) -> Effect:
    """The command was recorded with a separate clock: it is some samples late or early."""
    shift = int(rng.integers(2, MOST_SHIFT + 1))
    if rng.uniform() < 0.5:
        shift = -shift
    form, truth = "late" if shift > 0 else "early", {"time_shift": shift * s.sampling}
    return Effect("time_shift", form, truth=truth, shift=shift)


SIGNALS: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (scale_of_u, scale_of_i, scale_of_x, sign_of_u, sign_of_x, time_shift)
}


def spoilt(record: dict[str, Columns], effects: tuple[Effect, ...]) -> dict[str, Columns]:
    """The record with its columns changed by the effects."""
    for effect in effects:
        record = {n: column * effect.factors.get(n, 1.0) for n, column in record.items()}
        late = abs(effect.shift)
        if late:  # cut off samples without a counterpart
            first, last = slice(late, None), slice(None, -late)
            of_u, of_others = (last, first) if effect.shift > 0 else (first, last)
            record = {n: column[of_u if n == "u" else of_others] for n, column in record.items()}
            record["time"] = record["time"] - record["time"][0]
    return record


def misread(along: Along, effect: Effect) -> Along:
    """A motion as in the wrong columns, with the force that it does not need.

    A set-valued law at rest holds any force: there, the balance of force gives no information.
    """
    setting, log, period = along.setting, along.log, along.period
    par, read = setting.double, log.copy()
    of_x, of_i = effect.factors.get("x", 1.0), effect.factors.get("i", 1.0)
    read[:, [at.X, at.V, at.A]] *= of_x
    read[:, [at.CURRENT, at.CURRENT_MEAN]] *= of_i
    if of_x != 1.0:
        read[:, at.DRY] = dry_along(par, read[:, at.V], period)
        read[:, at.FRICTION] = read[:, at.DRY] + par[at.SIGMA2] * read[:, at.V]
    u = read[:, at.COMMAND] * effect.factors.get("u", 1.0)
    if effect.shift:
        time = np.arange(len(log)) * period
        u = np.interp(time - effect.shift * setting.sampling, time, u)
    read[:, at.COMMAND] = u
    more = read - log
    force = setting.mass * more[:, at.A] + more[:, at.FRICTION]
    current = more[:, at.CURRENT_MEAN]
    volts = more[:, at.COMMAND] - par[at.KE] * more[:, at.V]
    drop = par[at.R] * current + par[at.L] * np.gradient(current, period)
    read[:, at.NEED_FORCE] += par[at.KT] * current - force
    read[:, at.NEED_VOLTAGE] += volts - drop
    gain = par[at.GAIN] if par[at.IS_DRIVE] else par[at.KT] / par[at.R]
    read[:, at.NEED] += gain * volts - force
    moving = np.ones(len(log))
    if par[at.LAW] == at.SET_VALUED:
        moving = (np.abs(log[:, at.V]) > max(par[at.LEAST_SPEED], RESTING)).astype(float)
    read[:, [at.NEED, at.NEED_FORCE]] *= moving[:, None]
    return replace(along, log=read, moving=moving)
