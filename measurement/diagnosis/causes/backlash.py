"""A gap between screw and block, crossed at every reversal."""

from __future__ import annotations

import numpy as np

from ....plant.two_masses import GAP, with_gap
from .cause import Cause
from .joint import joint

_GAPS = 1e-6 * 2.0 ** np.arange(1.0, 10.75, 0.5)  # [m]

CAUSE = Cause(
    "backlash",
    "backlash: at each reversal the screw turns through a gap before it moves the block",
    (
        joint(
            "gap",
            GAP,
            with_gap,
            lambda courses, model: [{GAP.name: float(gap)} for gap in _GAPS],
            sure=0.2,
        ),
    ),
    confirm="reverse slowly and record the current: it is near zero until the gap is closed",
    mistaken_for=("compliance", "parameter_error", "unexplained"),
)
