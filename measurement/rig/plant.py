"""The moving part of the rig: a drive with its limits, and the force between drive and block.

The thesis' axis includes the inertia of its rotor, as in the real rig: reflected through the screw
it is sixteen times the mass of the block. The drive is rigid, as in the thesis; friction acts only
between block and table. In a drive of another kind, the total mass is behind the load cell and the
constant force is before it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import sympy as sp

from ...plant.ball_screw import ball_screw
from ...plant.direct_drive import direct_drive, with_command_limit
from ...plant.instruments.amplifier import with_amplifier
from ...plant.rotary_drive import turned
from ...solver.component import Component, ForceTerm, Output, symbol

ROTOR_INERTIA = 4.2e-7  # kg*m^2, Table 2.1
_SET_HERE = {
    "Jm": (
        ROTOR_INERTIA,
        "Table 2.1; in ballscrew run, swap, lyapunov, map and diagnose it is 0 unless a "
        "parameter file or --set gives another value",
    ),
    "voltage_limit": (36.0, "Table 2.1: nominal voltage of the motor"),
    "current_limit": (5.0, "Maxon ADS 50/5: 5 A continuous"),
}


_KINDS = {
    "ball_screw": (ball_screw, with_amplifier),
    "drive": (direct_drive, with_command_limit),
    "rotary_drive": (direct_drive, lambda plant: turned(with_command_limit(plant))),
}


def rig_plant(
    friction: Callable[[sp.Expr], ForceTerm], name: str = "rig_plant", kind: str = "ball_screw"
) -> Component:
    """The rig's moving part, from the command `u` [V] to the inputs of the instruments.

    Parameters
    ----------
    friction : function of the velocity symbol, returning a ForceTerm
        A law of `plant/`.
    name : str
    kind : str
        Kind of plant, as in a parameter file.

    Returns
    -------
    Component
        Outputs are those of the plant, and `friction` [N], `force` [N] of the drive on the block,
        and `voltage` [V], the limited command.
    """
    make, limit = _KINDS[kind]
    axis = make(friction, name)
    force = Output(
        "force",
        "N",
        "force of the drive on the block: friction + m dv/dt",
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
    voltage = Output("voltage", "V", "command within its limit", symbol("u"), nominal=10.0)
    # A converter holds its commands, so no feedback law acts within a step.
    commands = tuple(replace(i, law=()) for i in axis.inputs)
    outputs = (*axis.outputs, force, voltage)
    limited = limit(replace(axis, inputs=commands, outputs=outputs, modes=modes))
    parameters = (
        replace(p, default=_SET_HERE[p.name][0], source=_SET_HERE[p.name][1])
        if kind == "ball_screw" and p.name in _SET_HERE
        else p
        for p in limited.parameters
    )
    return replace(limited, parameters=tuple(parameters))
