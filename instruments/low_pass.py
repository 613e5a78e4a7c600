"""The second-order low-pass filter of the rig's software."""

from __future__ import annotations

import math

import sympy as sp

from ..solver.component import Component, DiscreteState, Input, Output, Parameter, symbol
from .sampling_period import SAMPLE_TIME, sampling_period


def low_pass(name: str, unit: str, meaning: str, cutoff: float, source: str) -> Component:
    """A digital second-order low-pass filter: bilinear, exact at its cutoff.

    Parameters
    ----------
    name : str
        Name of the component.
    unit, meaning : str
        Unit and meaning of the signal.
    cutoff : float
        Frequency at which the amplitude is 1/sqrt(2) [Hz].
    source : str
        Source of the cutoff.
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
    """Delay [s] of slow signals by the filter of `low_pass`."""
    return damping * period / math.tan(math.pi * cutoff * period)
