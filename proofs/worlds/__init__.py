"""Records of made-up machines whose truth is known: the worlds that the diagnosis is judged in.

Written from a list of what real drives, instruments and motions do, and from the equations of the
axis; nothing of the estimator is imported.
"""

from worlds.cases import Case, Unusable, draw_case, write_case
from worlds.effects import CATALOGUE
from worlds.outside import OUTSIDE
from worlds.worlds import WORLDS, effects_of

__all__ = [
    "CATALOGUE",
    "OUTSIDE",
    "WORLDS",
    "Case",
    "Unusable",
    "draw_case",
    "effects_of",
    "write_case",
]
