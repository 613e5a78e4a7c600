"""The rig's load cell, acquisition board and software filter (Section 2.2 and Table 2.1)."""

from __future__ import annotations

import math

import sympy as sp

from ...solver.component import Component, DiscreteState, Input, Output, Parameter, symbol
from .amplifier import saturate

SAMPLE_TIME = 0.005
"""Period of the acquisition and of all sampled parts [s]: 200 Hz, Section 2.2.1."""


def sampling_period() -> Parameter:
    """The parameter ``sample_time`` of all sampled parts."""
    return Parameter(
        "sample_time", SAMPLE_TIME, "s", "sampling period", "Section 2.2.1: 200 Hz", minimum=1e-6
    )


def load_cell() -> Component:
    """Force between screw side and block, measured by the load cell and its converter."""
    resolution, capacity = symbol("resolution"), symbol("capacity")
    noise = Input("noise", "N", "noise before the converter", nominal=0.03)
    # also before quantization: compiled code counts the steps in 64 bits
    felt = saturate(symbol("force") + symbol("noise"), 2 * capacity)
    read = saturate(sp.floor(felt / resolution + sp.Rational(1, 2)) * resolution, capacity)
    return Component(
        name="load_cell",
        description="Load cell: whole steps of its resolution, within its capacity",
        parameters=(
            Parameter("resolution", 0.089, "N", "smallest step", "Table 2.1", minimum=1e-9),
            Parameter("capacity", 44.5, "N", "end of the range, either sign", "Table 2.1", 0.0),
        ),
        inputs=(Input("force", "N", "force on the block"), noise),
        outputs=(Output("force_read", "N", "force by the cell", read),),
    )


def acquisition() -> Component:
    """The Quanser board: samples its channels at the same instant and holds them for a period."""
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
    """A digital second-order low-pass filter of a signal: bilinear, exact at its cutoff [Hz].

    There the amplitude is 1/sqrt(2); `source` is that of the cutoff.
    """
    w = sp.tan(sp.pi * symbol("cutoff") * symbol("sample_time"))
    damping, signal = symbol("damping"), symbol("signal")
    scale = 1 / (1 + 2 * damping * w + w**2)
    b = w**2 * scale
    a1, a2 = 2 * (w**2 - 1) * scale, (1 - 2 * damping * w + w**2) * scale
    filtered = b * signal + symbol("s1")
    first = 2 * b * signal - a1 * filtered + symbol("s2")
    lost, butterworth = "frequency where 3 dB are lost", "Butterworth; the thesis says second order"
    return Component(
        name=name,
        description="Second-order low-pass filter, " + meaning,
        parameters=(
            Parameter("cutoff", cutoff, "1/s", lost, source, 1e-3, 0.45 / SAMPLE_TIME),
            Parameter("damping", 0.5**0.5, "1", "damping ratio", butterworth, minimum=1e-3),
        ),
        inputs=(Input("signal", unit, meaning),),
        discrete=(
            DiscreteState("s1", unit, "first memory", first),
            DiscreteState("s2", unit, "second memory", b * signal - a2 * filtered),
            DiscreteState("held", unit, "filtered " + meaning, filtered),
        ),
        outputs=(Output("filtered", unit, "filtered " + meaning, symbol("held")),),
        sample_time=sampling_period(),
    )


def filter_lag(cutoff: float, damping: float = 0.5**0.5, period: float = SAMPLE_TIME) -> float:
    """Delay [s] of slow signals by the filter of `low_pass`."""
    return damping * period / math.tan(math.pi * cutoff * period)
