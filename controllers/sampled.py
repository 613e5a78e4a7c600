"""The continuous laws as a computer runs them."""

from __future__ import annotations

from ..instruments.sample_and_hold import sampled_and_held
from ..solver.component import Component
from .linearization import input_output_linearization
from .nctf import nctf


def iol_sampled() -> Component:
    """`iol`, sampled and held."""
    return sampled_and_held(input_output_linearization(), "iol_sampled")


def nctf_sampled() -> Component:
    """`nctf`, sampled and held."""
    return sampled_and_held(nctf(), "nctf_sampled")
