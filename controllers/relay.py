"""Relay with hysteresis on the position.

Ya. Z. Tsypkin, "Relay Control Systems", Cambridge University Press (1984). The command is ``level``
or ``-level`` volts and switches when the error has passed zero by ``width``; before the error first
exceeds it, the command is zero. The axis never comes to rest: it oscillates around the set-point.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import Component, Event, Mode, Parameter, symbol
from .limited import U_MAX, limit, voltage_law

TUNABLE = {"level": (0.5, 36.0), "width": (1e-6, 5e-3)}


def relay() -> Component:
    """`u` [V] from x and x_d."""
    error, width = symbol("x_d") - symbol("x"), symbol("width")
    forward = Event("forward", error - width, direction=1, next_mode="forward")
    backward = Event("backward", error + width, direction=-1, next_mode="backward")
    half, share = "half of the open-loop step of Section 3.4.2.1", "a thousandth of the travel"
    parameters = (
        Parameter("level", 15.0, "V", "magnitude of the command", half, minimum=0.0),
        Parameter("width", 1e-4, "m", "half width of the hysteresis", share, minimum=0.0),
        U_MAX,
    )
    return replace(
        voltage_law("relay", "Relay with hysteresis on the position", parameters, sp.Integer(0)),
        modes=(
            Mode("off", outputs={"u": sp.Integer(0)}, events=(forward, backward)),
            Mode("forward", outputs={"u": limit(symbol("level"))}, events=(backward,)),
            Mode("backward", outputs={"u": limit(-symbol("level"))}, events=(forward,)),
        ),
    )
