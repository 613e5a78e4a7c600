"""The digital position PID with the position of an encoder, not the true one."""

from __future__ import annotations

from dataclasses import replace

from ..instruments.encoder import behind_encoder
from ..solver.component import Component
from .pid import TUNABLE
from .pid_sampled import pid_sampled

__all__ = ["TUNABLE", "pid_encoder"]


def pid_encoder() -> Component:
    """`pid_sampled` behind the rig's encoder: it sees whole counts."""
    return replace(
        behind_encoder(pid_sampled()),
        name="pid_encoder",
        description="Digital position PID that sees an encoder's counts",
    )
