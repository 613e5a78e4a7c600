"""The data acquisition board: sample and hold."""

from __future__ import annotations

from ..solver.component import Component, DiscreteState, Input, Output, symbol
from .sampling_period import sampling_period


def acquisition() -> Component:
    """The Quanser board: samples its channels at the same instant and holds them for a period."""
    channels = {
        "x_counted": ("x", "m", "position by the encoder", 1e-3),
        "force_read": ("force", "N", "force by the load cell", 1.0),
    }
    return Component(
        name="acquisition",
        description="Data acquisition: sample and hold at 200 Hz",
        inputs=tuple(
            Input(name, unit, meaning, nominal=nominal)
            for name, (_, unit, meaning, nominal) in channels.items()
        ),
        discrete=tuple(
            DiscreteState(f"{held}_held", unit, meaning, symbol(name), nominal=nominal)
            for name, (held, unit, meaning, nominal) in channels.items()
        ),
        outputs=tuple(
            Output(held, unit, meaning, symbol(f"{held}_held"), nominal=nominal)
            for held, unit, meaning, nominal in channels.values()
        ),
        sample_time=sampling_period(),
    )
