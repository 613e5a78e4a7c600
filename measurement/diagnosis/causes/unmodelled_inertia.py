"""Mass that moves with the block and is missing in the model."""

from __future__ import annotations

from .cause import Cause, Mechanism, Shape, parameter

CAUSE = Cause(
    "unmodelled_inertia",
    "more mass is moved than the model has",
    (
        Mechanism(
            (parameter("m", "kg", "mass of the block", 1.0),),
            lambda courses, model, values: Shape(("m",), values=values, freed=("m",)),
        ),
    ),
    confirm="accelerate strongly in both directions at the same speeds: plot force over "
    "acceleration",
    mistaken_for=("parameter_error", "input_delay"),
)
