"""The axis as it is exported: ball screw with modified LuGre friction behind an amplifier."""

from __future__ import annotations

from dataclasses import replace

from ..solver.component import Component
from .amplifier import with_amplifier
from .ball_screw import ball_screw


def axis() -> Component:
    """The nominal plant of this project under the name ``plant``."""
    return replace(with_amplifier(ball_screw()), name="plant")
