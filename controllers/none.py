"""No controller, for a plant that runs alone."""

from __future__ import annotations

from ..solver.component import Component


def none() -> Component:
    """A component without signals, for a plant without inputs."""
    return Component(name="none", description="No controller, the plant runs alone")
