"""Axes of the worlds and open-loop runs of them, for their tests."""

from __future__ import annotations

import math

import numpy as np
from worlds import layout as at
from worlds.controllers import NUMBERS
from worlds.friction_noise import FLAT
from worlds.simulator import Run, simulate

PERIOD = 1e-3
TURN = 2 * math.pi * 1000.0  # rad/m


def nominal_axis():
    """The thesis' axis with its original LuGre law."""
    par = at.blank()
    par[at.BLOCK_MASS] = 1.0
    par[at.KT], par[at.KE] = 37.4e-3 * TURN, 0.0374482 * TURN
    par[at.R], par[at.L] = 21.4, 0.953e-3
    par[at.LAW] = at.LUGRE
    par[at.SIGMA0], par[at.SIGMA1], par[at.SIGMA2] = 66967.231, 344.56, 173.0
    par[at.FC], par[at.FS], par[at.VS], par[at.KV] = 1.284, 2.35, 1.13975e-3, 1e8
    par[at.TRAVEL], par[at.DURATION] = 0.3, 1.0
    return par


def drive(mass: float = 2.0, viscous: float = 0.0):
    """A slide driven by a force of one newton per volt, without dry friction."""
    par = at.blank()
    par[at.BLOCK_MASS], par[at.IS_DRIVE], par[at.GAIN] = mass, 1.0, 1.0
    par[at.SIGMA2], par[at.FC], par[at.FS], par[at.VS] = viscous, 1e-12, 1e-12, 1.0
    par[at.TRAVEL], par[at.DURATION] = 10.0, 1.0
    return par


def run(par, commands, double=None, substeps=100, bursts=None):
    """The log and the commands of an open loop."""
    noise = np.zeros((commands.size, 3))
    if bursts is not None:
        noise[:, 2] = bursts
    return simulate(
        Run(
            axis=par,
            double=par if double is None else double,
            controller=np.zeros(NUMBERS),
            wanted=commands,
            noise=noise,
            texture=FLAT,
            substeps=substeps,
            periods_logged=1,
            period=PERIOD,
        )
    ).log


def swing(count=300):
    """A smooth command that reverses the nominal axis."""
    t = np.arange(count) * PERIOD
    return 8 * np.sin(2 * math.pi * 5 * t) + 3 * np.sin(2 * math.pi * 17 * t)
