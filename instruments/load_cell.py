"""The load cell with its converter (Section 2.2 and Table 2.1)."""

from __future__ import annotations

import sympy as sp

from ..solver.component import Component, Input, Output, Parameter, symbol
from .saturation import saturate


def load_cell() -> Component:
    """Force between screw side and block, measured by the load cell and its converter."""
    resolution, capacity = symbol("resolution"), symbol("capacity")
    # also before quantization: compiled code counts the steps in 64 bits
    felt = saturate(symbol("force") + symbol("noise"), 2 * capacity)
    steps = sp.floor(felt / resolution + sp.Rational(1, 2))
    return Component(
        name="load_cell",
        description="Load cell: whole steps of its resolution, within its capacity",
        parameters=(
            Parameter("resolution", 0.089, "N", "smallest step", "Table 2.1", minimum=1e-9),
            Parameter(
                "capacity", 44.5, "N", "end of the range, either sign", "Table 2.1", minimum=0.0
            ),
        ),
        inputs=(
            Input("force", "N", "force on the block"),
            Input("noise", "N", "noise before the converter", nominal=0.03),
        ),
        outputs=(
            Output("force_read", "N", "force by the cell", saturate(steps * resolution, capacity)),
        ),
    )
