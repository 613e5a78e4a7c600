"""Encoders: the rig's (Section 2.2 and Table 2.1), and a linear one with interpolated signals."""

from __future__ import annotations

import sympy as sp

from ...solver.component import Component, Input, Output, Parameter, symbol

_SIGNAL = "an exposed linear encoder with 1 Vpp signals"
_WITHIN = "assumed: with the second within 1 % of the signal period, which is typical"
_LENGTH = "length of a step; of a rotary encoder the lead of the screw over its counts"
_STEPS = "assumed: 4096 steps in a signal period of 20 um, usual for velocity control"
_OF_ONE, _OF_HALF = (
    f"amplitude of the error of {part} signal period" for part in ("one", "half a")
)
PHASE = Parameter(
    "phase",
    0.5,
    "1",
    "place of the origin between two counts",
    "differs with every start",
    0.0,
    1.0,
)


def counter_reading(position: sp.Expr, per_metre: sp.Expr, phase: sp.Expr) -> sp.Expr:
    """A position [m] in counts, by a counter that is zero at its position when turned on.

    `phase` is the position of the origin between two counts, 0 to 1.
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
            Parameter("p", 1000.0, "1/m", "revolutions of the screw per metre", "Table 2.1", 1e-3),
            PHASE,
        ),
        inputs=(Input("x", "m", "position of the block", nominal=1e-3),),
        outputs=(Output("x_counted", "m", "position by the encoder", position, nominal=1e-3),),
    )


def position_encoder() -> Component:
    """The position with the error of the interpolation, in whole steps of the resolution.

    Offsets of the two signals cause an error with the signal period; different amplitudes
    and a phase other than 90 degrees cause an error with half the signal period.
    """
    angle = 2 * sp.pi * symbol("x") / symbol("signal_period")
    error = symbol("first_harmonic") * sp.sin(angle + symbol("first_phase"))
    error += symbol("second_harmonic") * sp.sin(2 * angle + symbol("second_phase"))
    position = counter_reading(symbol("x") + error, 1 / symbol("resolution"), symbol("phase"))
    return Component(
        name="position_encoder",
        description="Position encoder: interpolation error and resolution",
        parameters=(
            Parameter("resolution", 20e-6 / 4096, "m", _LENGTH, _STEPS, minimum=1e-15),
            PHASE,
            Parameter("signal_period", 20e-6, "m", "signal period", _SIGNAL, minimum=1e-9),
            Parameter("first_harmonic", 0.1e-6, "m", _OF_ONE, _WITHIN, minimum=0.0),
            Parameter("first_phase", 0.0, "rad", "phase of the first harmonic", "assumed"),
            Parameter(
                "second_harmonic", 0.1e-6, "m", _OF_HALF, "assumed, as of the first", minimum=0.0
            ),
            Parameter("second_phase", 0.0, "rad", "phase of the second harmonic", "assumed"),
        ),
        inputs=(Input("x", "m", "position", nominal=0.1),),
        outputs=(Output("x_measured", "m", "position by the encoder", position, nominal=0.1),),
    )
