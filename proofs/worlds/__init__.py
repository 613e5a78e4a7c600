"""Simulated records of machines with known truth: the worlds in which the diagnosis is tested.

They are based on a list of properties of real drives, instruments and motions, and on the equations
of the axis. Nothing of the estimator is imported.
"""

from worlds.cases import Case, Unusable, draw_case, more_of, write_case, write_record
from worlds.effects import CATALOGUE
from worlds.machines import HELD_BACK
from worlds.outside import OUTSIDE
from worlds.signals import SIGNALS
from worlds.worlds import WORLDS, effects_of

__all__ = [
    "CATALOGUE",
    "HELD_BACK",
    "OUTSIDE",
    "SIGNALS",
    "WORLDS",
    "Case",
    "Unusable",
    "draw_case",
    "effects_of",
    "more_of",
    "write_case",
    "write_record",
]
