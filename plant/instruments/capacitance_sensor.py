"""The capacitance sensor with its converter (Section 2.2.2, Eqs. 2.1-2.2)."""

from __future__ import annotations

import sympy as sp

from ...solver.component import Component, DiscreteState, Input, Output, Parameter, symbol
from .acquisition import sampling_period
from .amplifier import saturate

CONVERSION_SAMPLES = 8
"""Samples of the acquisition during one conversion of the AD7747: 40 ms."""
PER_PICOFARAD = 1e12
"""The polynomial of the calibration is in picofarads."""
PLATES_TOUCH = 1e-6
"""Smallest separation of the plates [m]."""

_VARIES = "assumed; varies from trial to trial, Section 2.2.2"
_TIME, _TRIAL = "assumed: 40 ms, within the AD7747's 22 to 219 ms", "calibration of the trial"
_SAMPLES = float(CONVERSION_SAMPLES)
PARAMETERS = (
    Parameter("permittivity", 8.854e-12, "A*s/(V*m)", "permittivity of air", "Eq. 2.1", 0.0),
    Parameter("area", 1e-4, "m^2", "overlap of the plates", "assumed: 1 cm^2", minimum=0.0),
    Parameter("separation", 150e-6, "m", "initial separation of the plates", _VARIES, 1e-6),
    Parameter("samples", _SAMPLES, "1", "samples that a conversion takes", _TIME, minimum=1.0),
    Parameter("range", 8.192e-12, "A*s/V", "end of the range", "AD7747, 24 bit", minimum=1e-15),
    Parameter("c0", 0.0, "m", "calibration, constant", _TRIAL),
    Parameter("c1", 0.0, "m", "calibration, linear", _TRIAL),
    Parameter("c2", 0.0, "m", "calibration, quadratic", _TRIAL),
)


def capacitance_sensor() -> Component:
    """Displacement from the capacitance of two plates (Eqs. 2.1-2.2), converted by an AD7747.

    The converter averages over its conversion, gives the result in whole steps within its range,
    and holds it until the next one; the quadratic polynomial of the calibration turns it into a
    displacement.
    """
    asked = symbol("separation") + symbol("x")
    gap = sp.Piecewise((asked, asked > PLATES_TOUCH), (PLATES_TOUCH, True))
    capacitance = symbol("permittivity") * symbol("area") / gap
    total = symbol("total") + capacitance
    taken = symbol("count") + 1
    done = taken >= symbol("samples")
    step = 2 * symbol("range") / 2**24
    mean = total / taken + symbol("noise")
    code = saturate(sp.floor(mean / step + sp.Rational(1, 2)) * step, symbol("range"))
    held = symbol("held")
    count, rest = (sp.Piecewise((0, done), (value, True)) for value in (taken, total))
    kept = sp.Piecewise((code, done), (held, True))
    so_far, result = "of the conversion so far", "result of the last conversion"
    relative = held * PER_PICOFARAD
    displacement = symbol("c0") + symbol("c1") * relative + symbol("c2") * relative**2
    return Component(
        name="capacitance_sensor",
        description="Capacitance displacement sensor with its calibration",
        parameters=PARAMETERS,
        inputs=(
            Input("x", "m", "displacement of the block", nominal=1e-5),
            Input("noise", "A*s/V", "noise of a conversion", nominal=1e-17),
        ),
        outputs=(
            Output("capacitance", "A*s/V", result, held, nominal=1e-12),
            Output("x_fine", "m", "displacement by the sensor", displacement, nominal=1e-5),
        ),
        discrete=(
            DiscreteState("count", "1", f"samples {so_far}", count, CONVERSION_SAMPLES - 1),
            DiscreteState("total", "A*s/V", f"sum {so_far}", rest, nominal=1e-12),
            DiscreteState("held", "A*s/V", result, kept, nominal=1e-12),
        ),
        sample_time=sampling_period(),
    )
