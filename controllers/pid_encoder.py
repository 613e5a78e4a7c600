"""The digital position PID with the position of an encoder instead of the true one."""

from __future__ import annotations

from dataclasses import replace

from ..instruments.encoder import encoder
from ..instruments.measured_through import measured_through
from ..solver.component import Component
from .pid import TUNABLE
from .pid_sampled import pid_sampled

__all__ = ["TUNABLE", "pid_encoder"]


def pid_encoder() -> Component:
    """`pid_sampled` with the rig's encoder: it reads whole counts."""
    counts = encoder()
    named = replace(counts, outputs=(replace(counts.outputs[0], name="x_measured"),))
    return replace(
        measured_through(pid_sampled(), [named]),
        name="pid_encoder",
        description="Digital position PID that sees an encoder's counts",
    )
