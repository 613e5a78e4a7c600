"""A machine by the values of its data sheet, and as the simulator's vector."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from worlds import layout
from worlds.layout import Vector

BALL_SCREW, DRIVE = "ball_screw", "drive"
# values that a data sheet may have wrong, by plant; kt and ke are one quantity and change together
UNCERTAIN = {
    BALL_SCREW: ("R", "kt", "m", "sigma2", "Fc", "Vs"),
    DRIVE: ("gain", "m", "sigma2", "Fc"),
}
TOLERANCE = 0.03


@dataclass(frozen=True)
class Axis:
    """A machine without any fault.

    Attributes
    ----------
    plant, law : str
        As in a parameter file.
    values : dict
        Values in SI units, by the parameter file's names.
    formulation : int
        Formulation of friction in the simulator (`layout`).
    travel : float
        Half of the travel, m.
    most : float
        The largest command, V.
    fastest : float
        Largest speed used, m/s.
    """

    plant: str
    law: str
    values: dict[str, float]
    formulation: int
    travel: float
    most: float
    fastest: float


def double_of(axis: Axis, duration: float) -> Vector:
    """The axis with the law of its parameter file."""
    par = vector_of(axis.plant, axis.values)
    par[layout.LAW] = layout.SET_VALUED if axis.law == "classical" else layout.LUGRE
    par[layout.TRAVEL], par[layout.DURATION] = axis.travel, duration
    return par


def vector_of(plant: str, values: dict[str, float]) -> Vector:
    """A machine's values in the simulator's order; law and travel are not set."""
    par = layout.blank()
    par[layout.BLOCK_MASS] = values["m"]
    if plant == BALL_SCREW:
        turn = 2 * math.pi * values["p"]
        par[layout.MOTOR_MASS] = values["Jm"] * turn**2
        par[layout.KT], par[layout.KE] = values["kt"] * turn, values["ke"] * turn
        par[layout.R], par[layout.L] = values["R"], values["L"]
    else:
        par[layout.IS_DRIVE], par[layout.GAIN] = 1.0, values["gain"]
        par[layout.LOAD] = values.get("offset", 0.0)
    par[layout.SIGMA0] = values.get("sigma0", 0.0)
    par[layout.SIGMA1] = values.get("sigma1", 0.0)
    par[layout.SIGMA2] = values["sigma2"]
    par[layout.FC], par[layout.FS] = values["Fc"], values["Fs"]
    par[layout.VS] = values["Vs"]
    par[layout.KV] = 1e8
    return par


def scaled(values: dict[str, float], name: str, factor: float) -> dict[str, float]:
    """The values with one changed, and those that must change with it."""
    together = {"kt": ("kt", "ke"), "Fc": ("Fc", "Fs")}.get(name, (name,))
    return {n: v * factor if n in together else v for n, v in values.items()}


def misjudged(
    rng: np.random.Generator, axis: Axis, share_exact: float
) -> tuple[dict[str, float], dict[str, float]]:
    """Values of the data sheet, and the factors by which they are wrong.

    Two to four values are wrong, each by up to the tolerance; in a share of cases none.
    """
    values, factors = dict(axis.values), {}
    if rng.uniform() >= share_exact:
        names = UNCERTAIN[axis.plant]
        count = int(rng.integers(2, min(4, len(names)) + 1))
        for name in rng.permutation(names)[:count]:
            factors[str(name)] = 1 + float(rng.uniform(-TOLERANCE, TOLERANCE))
            values = scaled(values, str(name), factors[str(name)])
    return values, factors


def rated_command(axis: Axis, speed: float) -> float:
    """Command that holds a speed, V."""
    v = axis.values
    force = v["Fc"] + v["sigma2"] * speed
    if axis.plant == DRIVE:
        return force / v["gain"]
    turn = 2 * math.pi * v["p"]
    return v["R"] * force / (v["kt"] * turn) + v["ke"] * turn * speed


def breakaway_command(axis: Axis) -> float:
    """Smallest command that breaks the axis away, V."""
    return axis.values["Fs"] / axis.values["Fc"] * rated_command(axis, 0.0)
