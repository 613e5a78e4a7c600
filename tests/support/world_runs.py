"""Axes of the worlds and open-loop runs of them, for their tests."""

from __future__ import annotations

import math

import numpy as np
from worlds.axis import LUGRE, blank, changed
from worlds.simulator import BURST, FLAT, simulate

PERIOD = 1e-3
TURN = 2 * math.pi * 1000.0  # rad/m


def nominal_axis():
    """The thesis' axis with its original LuGre law."""
    par = blank()
    par.block_mass, par.kt, par.ke = 1.0, 37.4e-3 * TURN, 0.0374482 * TURN
    par.R, par.L = 21.4, 0.953e-3
    par.law, par.sigma0, par.sigma1, par.sigma2 = LUGRE, 66967.231, 344.56, 173.0
    par.Fc, par.Fs, par.Vs, par.Kv = 1.284, 2.35, 1.13975e-3, 1e8
    par.travel, par.duration = 0.3, 1.0
    return par


def drive(**values: float):
    """A slide driven by a force of one newton per volt, without dry friction."""
    few = {"block_mass": 2.0, "is_drive": 1.0, "gain": 1.0, "Fc": 1e-12, "Fs": 1e-12, "Vs": 1.0}
    return changed(blank(), few | {"travel": 10.0, "duration": 1.0} | values)


def run(par, commands, double=None, substeps=100, bursts=0.0):
    """The log of an open loop, one row for each command."""
    noise = np.zeros((commands.size, 3))
    noise[:, BURST] = bursts
    double = par if double is None else double
    return simulate(par, double, commands, noise, FLAT, substeps, 1, PERIOD)[0]


def swing(count=300):
    """A smooth command that reverses the nominal axis."""
    t = np.arange(count) * PERIOD
    return 8 * np.sin(2 * math.pi * 5 * t) + 3 * np.sin(2 * math.pi * 17 * t)
