"""The encoder (Section 2.2 and Table 2.1): position in counts."""

from __future__ import annotations

import sympy as sp

from ..solver.component import Component, Input, Output, Parameter, symbol

PHASE = Parameter(
    "phase",
    0.5,
    "1",
    "place of the origin between two counts",
    "differs with every start",
    minimum=0.0,
    maximum=1.0,
)


def counter_reading(position: sp.Expr, per_metre: sp.Expr, phase: sp.Expr) -> sp.Expr:
    """A position in counts, by a counter that is zero at its position when turned on.

    Parameters
    ----------
    position : expression
        Position [m].
    per_metre : expression
        Counts per metre [1/m].
    phase : expression
        Position of the origin between two counts, 0 to 1.
    """
    return sp.floor(position * per_metre + phase) / per_metre


def encoder() -> Component:
    """Position of the block from the screw's angle, in counts of the encoder (Eq. 2.4).

    The counter is zero at the position when the power is turned on; ``phase`` is the location of
    this point between two counts.
    """
    per_metre = symbol("counts") * symbol("p")
    position = counter_reading(symbol("x"), per_metre, symbol("phase"))
    return Component(
        name="encoder",
        description="Incremental encoder on the motor shaft",
        parameters=(
            Parameter("counts", 512.0, "1", "counts per revolution", "Section 2.2.1", minimum=1.0),
            Parameter(
                "p", 1000.0, "1/m", "revolutions of the screw per metre", "Table 2.1", minimum=1e-3
            ),
            PHASE,
        ),
        inputs=(Input("x", "m", "position of the block", nominal=1e-3),),
        outputs=(Output("x_counted", "m", "position by the encoder", position, nominal=1e-3),),
    )
