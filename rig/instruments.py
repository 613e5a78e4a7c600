"""The rig's instruments (Section 2.2 and Table 2.1), each a component and an FMU of its own.

Noise is an input, so that a seed outside decides it. Where the thesis prints no figure, the
parameter's source says what was assumed.
"""

from __future__ import annotations

import math

import sympy as sp

from ..solver.component import (
    Component,
    DiscreteState,
    Input,
    Output,
    Parameter,
    symbol,
)

SAMPLE_TIME = 0.005
"""Period of the acquisition and of everything that runs in it [s]: 200 Hz, Section 2.2.1."""
CONVERSION_SAMPLES = 8
"""Samples of the acquisition that one conversion of the AD7747 takes: 40 ms."""
PER_PICOFARAD = 1e12
"""The calibration's polynomial is in picofarads."""
PLATES_TOUCH = 1e-6
"""Separation that the plates never fall below [m]."""


def sampling_period() -> Parameter:
    """The parameter ``sample_time`` of everything that is sampled."""
    return Parameter(
        "sample_time", SAMPLE_TIME, "s", "sampling period", "Section 2.2.1: 200 Hz", minimum=1e-6
    )


def _within(value: sp.Expr, limit: sp.Expr) -> sp.Expr:
    return sp.Max(-limit, sp.Min(limit, value))


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


def load_cell() -> Component:
    """Force between screw side and block, as the load cell and its converter give it."""
    resolution, capacity = symbol("resolution"), symbol("capacity")
    # before the steps as well: compiled code counts them in 64 bits
    felt = _within(symbol("force") + symbol("noise"), 2 * capacity)
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
            Output("force_read", "N", "force by the cell", _within(steps * resolution, capacity)),
        ),
    )


def capacitance_sensor() -> Component:
    """Displacement by the capacitance of two plates (Eqs. 2.1-2.2), converted by an AD7747.

    The converter averages over its conversion, gives the result in whole steps within its range,
    and holds it for the next; the calibration's quadratic polynomial turns it into a displacement.
    """
    asked = symbol("separation") + symbol("x")
    gap = sp.Piecewise((asked, asked > PLATES_TOUCH), (PLATES_TOUCH, True))
    capacitance = symbol("permittivity") * symbol("area") / gap
    total = symbol("total") + capacitance
    taken = symbol("count") + 1
    done = taken >= symbol("samples")
    step = 2 * symbol("range") / 2**24
    mean = total / taken + symbol("noise")
    code = _within(sp.floor(mean / step + sp.Rational(1, 2)) * step, symbol("range"))
    held = symbol("held")
    relative = held * PER_PICOFARAD
    displacement = symbol("c0") + symbol("c1") * relative + symbol("c2") * relative**2
    return Component(
        name="capacitance_sensor",
        description="Capacitance displacement sensor with its calibration",
        parameters=(
            Parameter(
                "permittivity",
                8.854e-12,
                "A*s/(V*m)",
                "permittivity of air",
                "Eq. 2.1",
                minimum=0.0,
            ),
            Parameter("area", 1e-4, "m^2", "overlap of the plates", "assumed: 1 cm^2", minimum=0.0),
            Parameter(
                "separation",
                150e-6,
                "m",
                "initial separation of the plates",
                "assumed; varies from trial to trial, Section 2.2.2",
                minimum=1e-6,
            ),
            Parameter(
                "samples",
                float(CONVERSION_SAMPLES),
                "1",
                "samples that a conversion takes",
                "assumed: 40 ms, within the AD7747's 22 to 219 ms",
                minimum=1.0,
            ),
            Parameter(
                "range", 8.192e-12, "A*s/V", "end of the range", "AD7747, 24 bit", minimum=1e-15
            ),
            Parameter("c0", 0.0, "m", "calibration, constant", "calibration of the trial"),
            Parameter("c1", 0.0, "m", "calibration, linear", "calibration of the trial"),
            Parameter("c2", 0.0, "m", "calibration, quadratic", "calibration of the trial"),
        ),
        inputs=(
            Input("x", "m", "displacement of the block", nominal=1e-5),
            Input("noise", "A*s/V", "noise of a conversion", nominal=1e-17),
        ),
        outputs=(
            Output("capacitance", "A*s/V", "result of the last conversion", held, nominal=1e-12),
            Output("x_fine", "m", "displacement by the sensor", displacement, nominal=1e-5),
        ),
        discrete=(
            DiscreteState(
                "count",
                "1",
                "samples of the conversion so far",
                sp.Piecewise((0, done), (taken, True)),
                start=CONVERSION_SAMPLES - 1,
            ),
            DiscreteState(
                "total",
                "A*s/V",
                "sum of the conversion so far",
                sp.Piecewise((0, done), (total, True)),
                nominal=1e-12,
            ),
            DiscreteState(
                "held",
                "A*s/V",
                "result of the last conversion",
                sp.Piecewise((code, done), (held, True)),
                nominal=1e-12,
            ),
        ),
        sample_time=sampling_period(),
    )


def acquisition() -> Component:
    """The Quanser board: takes its channels at the same instant and holds them for a period."""
    channels = {
        "x_counted": ("x", "m", "position by the encoder", 1e-3),
        "force_read": ("force", "N", "force by the load cell", 1.0),
    }
    return Component(
        name="acquisition",
        description="Data acquisition: sample and hold at 200 Hz",
        inputs=tuple(
            Input(name, unit, meaning, nominal=nominal)
            for name, (_, unit, meaning, nominal) in channels.items()
        ),
        discrete=tuple(
            DiscreteState(f"{held}_held", unit, meaning, symbol(name), nominal=nominal)
            for name, (held, unit, meaning, nominal) in channels.items()
        ),
        outputs=tuple(
            Output(held, unit, meaning, symbol(f"{held}_held"), nominal=nominal)
            for held, unit, meaning, nominal in channels.values()
        ),
        sample_time=sampling_period(),
    )


def low_pass(name: str, unit: str, meaning: str, cutoff: float, source: str) -> Component:
    """A second-order low-pass filter as a program runs it: bilinear, exact at its cutoff.

    Parameters
    ----------
    name : str
        Of the component.
    unit, meaning : str
        Of the signal.
    cutoff : float
        Where the amplitude is 1/sqrt(2) [Hz].
    source : str
        Where the cutoff comes from.
    """
    w = sp.tan(sp.pi * symbol("cutoff") * symbol("sample_time"))
    damping, signal = symbol("damping"), symbol("signal")
    scale = 1 / (1 + 2 * damping * w + w**2)
    b = w**2 * scale
    a1, a2 = 2 * (w**2 - 1) * scale, (1 - 2 * damping * w + w**2) * scale
    filtered = b * signal + symbol("s1")
    return Component(
        name=name,
        description="Second-order low-pass filter, " + meaning,
        parameters=(
            Parameter(
                "cutoff",
                cutoff,
                "1/s",
                "frequency where 3 dB are lost",
                source,
                minimum=1e-3,
                maximum=0.45 / SAMPLE_TIME,
            ),
            Parameter(
                "damping",
                0.5**0.5,
                "1",
                "damping ratio",
                "Butterworth; the thesis says second order",
                minimum=1e-3,
            ),
        ),
        inputs=(Input("signal", unit, meaning),),
        discrete=(
            DiscreteState(
                "s1", unit, "first memory", 2 * b * signal - a1 * filtered + symbol("s2")
            ),
            DiscreteState("s2", unit, "second memory", b * signal - a2 * filtered),
            DiscreteState("held", unit, "filtered " + meaning, filtered),
        ),
        outputs=(Output("filtered", unit, "filtered " + meaning, symbol("held")),),
        sample_time=sampling_period(),
    )


def filter_lag(cutoff: float, damping: float = 0.5**0.5, period: float = SAMPLE_TIME) -> float:
    """Delay [s] that the filter of `low_pass` gives to slow signals."""
    return damping * period / math.tan(math.pi * cutoff * period)
