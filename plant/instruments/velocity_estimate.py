"""The velocity computed from positions, as in a drive."""

from __future__ import annotations

import sympy as sp

from ...solver.component import Component, DiscreteState, Input, Output, Parameter, symbol
from . import UNLIMITED
from .sample_and_hold import PERIOD


def velocity_estimate() -> Component:
    """Difference of the last two positions divided by the period, with a first-order filter.

    The filter is the exact step of ``df/dt = 2 pi cutoff (difference - f)`` over a period. At the
    first sample, which has no previous position, the velocity is zero.
    """
    period, x, held = symbol("sample_time"), symbol("x"), symbol("v_held")
    difference = symbol("begun") * (x - symbol("x_last")) / period
    share = 1 - sp.exp(-2 * sp.pi * symbol("cutoff") * period)
    after = held + share * (difference - held)
    meaning = "cutoff frequency of the filter; 1e6: no filter"
    return Component(
        name="velocity_estimate",
        description="Velocity by backward differences of positions, filtered",
        parameters=(
            Parameter("cutoff", UNLIMITED, "1/s", meaning, "none unless given", 1e-3, UNLIMITED),
        ),
        inputs=(Input("x", "m", "measured position", nominal=0.1),),
        discrete=(
            DiscreteState("begun", "1", "whether there is a position before", sp.Integer(1)),
            DiscreteState("x_last", "m", "position at the last sample", x, nominal=0.1),
            DiscreteState("v_held", "m/s", "velocity since the last sample", after, nominal=0.1),
        ),
        outputs=(Output("v_measured", "m/s", "estimated velocity", held, nominal=0.1),),
        sample_time=PERIOD,
    )
