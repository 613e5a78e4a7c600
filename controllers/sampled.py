"""The continuous laws, sampled."""

from __future__ import annotations

from dataclasses import replace

from ..instruments.sample_and_hold import PERIOD, sampled
from ..solver.component import Component
from .linearization import input_output_linearization
from .nctf import nctf


def iol_sampled() -> Component:
    """`iol`, sampled and held."""
    return sampled(input_output_linearization())


def nctf_sampled() -> Component:
    """`nctf`, sampled and held: fast enough for its fastest time constant of 88 us."""
    period = replace(PERIOD, default=5e-5, source="half of the loop's fastest time constant")
    return sampled(nctf(), period)
