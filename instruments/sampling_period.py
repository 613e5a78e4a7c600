"""The sampling period that sampled instruments share."""

from __future__ import annotations

from ..solver.component import Parameter

SAMPLE_TIME = 0.005
"""Period of the acquisition and of all sampled parts [s]: 200 Hz, Section 2.2.1."""


def sampling_period() -> Parameter:
    """The parameter ``sample_time`` of all sampled parts."""
    return Parameter(
        "sample_time", SAMPLE_TIME, "s", "sampling period", "Section 2.2.1: 200 Hz", minimum=1e-6
    )
