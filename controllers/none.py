"""No controller: what stands for one where a plant runs alone."""

from __future__ import annotations

from ..solver.component import Component


def none() -> Component:
    """A component without signals. A plant that it can be connected with has no inputs."""
    return Component(name="none", description="No controller, the plant runs alone")
