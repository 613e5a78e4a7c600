"""The encoder (Section 2.2 and Table 2.1): position in counts."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import Component, Input, Output, Parameter, symbol


def encoder() -> Component:
    """Position of the block as the screw's angle gives it, in counts of the encoder (Eq. 2.4).

    The counter is zero where the power is turned on; ``phase`` says where between two counts that
    was.
    """
    per_metre = symbol("counts") * symbol("p")
    position = sp.floor(symbol("x") * per_metre + symbol("phase")) / per_metre
    return Component(
        name="encoder",
        description="Incremental encoder on the motor shaft",
        parameters=(
            Parameter("counts", 512.0, "1", "counts per revolution", "Section 2.2.1", minimum=1.0),
            Parameter(
                "p", 1000.0, "1/m", "revolutions of the screw per metre", "Table 2.1", minimum=1e-3
            ),
            Parameter(
                "phase",
                0.5,
                "1",
                "place of the origin between two counts",
                "differs with every start",
                minimum=0.0,
                maximum=1.0,
            ),
        ),
        inputs=(Input("x", "m", "position of the block", nominal=1e-3),),
        outputs=(Output("x_counted", "m", "position by the encoder", position, nominal=1e-3),),
    )


def behind_encoder(controller: Component, signal: str = "x") -> Component:
    """The controller with one of its measurements as an encoder gives it.

    Parameters
    ----------
    controller : Component
        Has an input `signal` [m].
    """
    instrument = encoder()
    counted = controller.equations_with({symbol(signal): instrument.outputs[0].value})
    own = {p.name for p in controller.parameters}
    added = tuple(p for p in instrument.parameters if p.name not in own)
    return replace(controller, **counted, parameters=(*controller.parameters, *added))
