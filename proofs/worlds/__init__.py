"""Records of made-up machines whose truth is known: the worlds that the diagnosis is judged in.

Written from a list of what real drives, instruments and motions do, and from the equations of the
axis; nothing of the estimator is imported.
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
