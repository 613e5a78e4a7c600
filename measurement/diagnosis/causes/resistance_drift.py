"""A motor that warms up: its resistance increases during the record."""

from __future__ import annotations

from ....solver.component import symbol
from .cause import Cause, Mechanism, parameter, voltage
from .in_time import InTime, in_time

_R = symbol("R")


def _drifting(how: InTime) -> Mechanism:
    return voltage(
        {_R: _R * (1 + symbol(how.change) * how.course)},
        (parameter(how.change, "1", "relative increase of the resistance"), how.constant),
        how.grid,
        how.refined,
    )


CAUSE = Cause(
    "resistance_drift",
    "the motor's resistance changes during the record",
    tuple(map(_drifting, in_time("R", "warming_time"))),
    confirm="record the current: compare voltage over current at standstill, before and after the "
    "run",
    mistaken_for=("friction_drift",),
    beyond=lambda courses, model: None if model.has_motor else "the model has no motor",
)
