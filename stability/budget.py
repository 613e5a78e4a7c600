"""Long-term motion within a budget: for cells of a map, and if exponents take too long."""

from __future__ import annotations

from ..solver.core import ACCEPTED, REACHED
from ..solver.kernel import Model
from .attractor import EXPONENTS, LONGER, LONGER_RUN, Attractor, Kind, classify_attractor

FOLLOWED, CREPT = 90.0, 22.0  # longest checked times of undecided and creeping motions, in runs
MOST_STEPS = 500_000  # of the solver; after them, the motion is not followed any longer
BUDGET = (
    f"budget of a cell: its motion is continued for {FOLLOWED:g} run lengths ({CREPT:g} if it "
    f"creeps), or until its solver has taken {MOST_STEPS} steps"
)


def becomes(model: Model, time: float, stop: float) -> Attractor:
    """Long-term motion, with increasing times while it is undecided.

    A creeping motion is checked again, since it may come to rest; any new verdict except undecided
    replaces creeping. For returns that do not close, exponents are computed.

    Parameters
    ----------
    model : Model
        Its state and mode are changed.
    time, stop : float
        The present, and the run's length, in which the budget is counted [s].
    """
    motion = classify_attractor(model, time, stop, exponents=False, rounds=1)
    span = stop
    while motion.would_decide in (LONGER_RUN, EXPONENTS) and model.info[ACCEPTED] < MOST_STEPS:
        creeps, now = motion.kind is Kind.CREEPING, float(model.info[REACHED])
        span = min(LONGER * span, FOLLOWED * stop)
        if now >= (CREPT if creeps else FOLLOWED) * stop:
            break
        does_not_close = motion.would_decide == EXPONENTS
        onward = classify_attractor(model, now, span, exponents=does_not_close, rounds=1)
        if not (creeps and onward.kind is Kind.UNDECIDED):
            motion = onward
    return motion
