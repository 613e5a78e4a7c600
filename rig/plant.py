"""What moves on the rig: amplifier, motor, screw and block, with the force between screw and block.

The rotor's inertia is in it, because the real rig has it: reflected through the screw it is sixteen
times the block. The drive is rigid, as the thesis assumes; friction acts between block and table
only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import sympy as sp

from ..instruments.amplifier import with_amplifier
from ..plant.ball_screw import ball_screw
from ..solver.component import Component, ForceTerm, Output, symbol

ROTOR_INERTIA = 4.2e-7  # kg*m^2, Table 2.1
_SET_HERE = {
    "Jm": (
        ROTOR_INERTIA,
        "Table 2.1; the plants of ballscrew run, swap, lyapunov, map and diagnose have 0 unless a "
        "parameter file or --set says otherwise",
    ),
    "voltage_limit": (36.0, "Table 2.1: nominal voltage of the motor"),
    "current_limit": (5.0, "Maxon ADS 50/5: 5 A continuous"),
}


def rig_plant(friction: Callable[[sp.Expr], ForceTerm], name: str = "rig_plant") -> Component:
    """The rig's moving part, from the commanded voltage `u` [V] to what the instruments look at.

    Parameters
    ----------
    friction : function of the velocity symbol, returning a ForceTerm
        A law of `plant/`.
    name : str

    Returns
    -------
    Component
        Outputs as `ball_screw`'s, and `friction` [N], `force` [N], which the screw side puts on the
        block, and `voltage` [V] at the motor.
    """
    axis = ball_screw(friction, name)
    force = Output(
        "force",
        "N",
        "force that the screw side puts on the block: friction + m dv/dt",
        axis.output("friction").value + symbol("m") * axis.derivative("v"),
    )
    modes = tuple(
        replace(
            mode,
            outputs={
                **mode.outputs,
                "force": mode.outputs["friction"] + symbol("m") * mode.derivatives["v"],
            },
        )
        for mode in axis.modes
    )
    voltage = Output("voltage", "V", "voltage at the motor", symbol("u"), nominal=10.0)
    # Its commands come from a converter that holds them: no feedback law acts inside a step.
    commands = tuple(replace(i, law=()) for i in axis.inputs)
    outputs = (*axis.outputs, force, voltage)
    limited = with_amplifier(replace(axis, inputs=commands, outputs=outputs, modes=modes))
    parameters = (
        replace(p, default=_SET_HERE[p.name][0], source=_SET_HERE[p.name][1])
        if p.name in _SET_HERE
        else p
        for p in limited.parameters
    )
    return replace(limited, parameters=tuple(parameters))
