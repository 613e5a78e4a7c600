"""A linear encoder with interpolated sinusoidal signals."""

from __future__ import annotations

import sympy as sp

from ..solver.component import Component, Input, Output, Parameter, symbol
from .encoder import PHASE, counter_reading

_SIGNAL = "an exposed linear encoder with 1 Vpp signals"


def position_encoder() -> Component:
    """The position with the error of the interpolation, in whole steps of the resolution.

    Offsets of the two signals cause an error with the signal period; different amplitudes
    and a phase other than 90 degrees cause an error with half the signal period.
    """
    angle = 2 * sp.pi * symbol("x") / symbol("signal_period")
    error = sp.Add(
        *(
            symbol(f"{order}_harmonic") * sp.sin(k * angle + symbol(f"{order}_phase"))
            for k, order in enumerate(("first", "second"), start=1)
        )
    )
    position = counter_reading(symbol("x") + error, 1 / symbol("resolution"), symbol("phase"))
    return Component(
        name="position_encoder",
        description="Position encoder: interpolation error and resolution",
        parameters=(
            Parameter(
                "resolution",
                20e-6 / 4096,
                "m",
                "length of a step; of a rotary encoder the lead of the screw over its counts",
                "assumed: 4096 steps in a signal period of 20 um, usual for velocity control",
                minimum=1e-15,
            ),
            PHASE,
            Parameter("signal_period", 20e-6, "m", "signal period", _SIGNAL, minimum=1e-9),
            Parameter(
                "first_harmonic",
                0.1e-6,
                "m",
                "amplitude of the error of one signal period",
                "assumed: with the second within 1 % of the signal period, which is typical",
                minimum=0.0,
            ),
            Parameter("first_phase", 0.0, "rad", "phase of the first harmonic", "assumed"),
            Parameter(
                "second_harmonic",
                0.1e-6,
                "m",
                "amplitude of the error of half a signal period",
                "assumed, as of the first",
                minimum=0.0,
            ),
            Parameter("second_phase", 0.0, "rad", "phase of the second harmonic", "assumed"),
        ),
        inputs=(Input("x", "m", "position", nominal=0.1),),
        outputs=(Output("x_measured", "m", "position by the encoder", position, nominal=0.1),),
    )
