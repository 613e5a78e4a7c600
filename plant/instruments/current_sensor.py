"""A current sensor, by a shunt or by the Hall effect, with its converter."""

from __future__ import annotations

import sympy as sp

from ...solver.component import Component, Input, Output, Parameter, symbol
from .noise import SEED, white_noise
from .sample_and_hold import PERIOD

_ONE_STEP = "assumed: about one step of the converter"
_BITS = "assumed: 12 bits over 2 A in either direction"
PARAMETERS = (
    Parameter("offset", 5e-3, "A", "output at no current", "assumed: 5 mA of 2 A"),
    Parameter(
        "gain_error", 0.01, "1", "relative error of the gain", "assumed: a shunt of 1 %", -0.99
    ),
    Parameter("deviation", 1e-3, "A", "standard deviation of the noise", _ONE_STEP, minimum=0.0),
    Parameter("step", 4.0 / 4096, "A", "smallest step", _BITS, minimum=1e-12),
    SEED,
)


def current_sensor() -> Component:
    """The motor's current with offset, gain error and noise, in whole steps of a converter.

    It has no delay; its noise has a new value at every sample instant.
    """
    step = symbol("step")
    seen = (1 + symbol("gain_error")) * symbol("i") + symbol("offset")
    seen += symbol("deviation") * symbol("noise")
    read = sp.floor(seen / step + sp.Rational(1, 2)) * step
    return Component(
        name="current_sensor",
        description="Current sensor: offset, gain error and noise, in steps of its converter",
        parameters=PARAMETERS,
        inputs=(Input("i", "A", "motor current", nominal=0.1),),
        outputs=(Output("i_measured", "A", "motor current by the sensor", read, nominal=0.1),),
        discrete=white_noise(),
        sample_time=PERIOD,
    )
