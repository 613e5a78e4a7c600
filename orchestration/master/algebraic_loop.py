"""Distinguish an algebraic loop that the master cannot solve from a step that is too long.

If a plant updates its outputs when its inputs are set, the master solves the loop at every
communication point (`settle` in ``c/coupling.c``). If a plant with direct feedthrough updates its
outputs only in a step, the master is always one step late, for any step size.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import numpy as np

from ...solver.arrays import Vector
from ..fmu.fmu_instance import StepFailed
from .coupling import Answer, CoupledPair
from .march import LoopRun
from .sides import Sides
from .verdict import WORST_CONTRACTION

SHORT = 1e-4, 1e-5  # of a communication step: effects through states vanish with its length
MOVED = 1e-3  # of a command's nominal value
LASTS = 0.5  # share of the gain that has to remain at the shorter of the two
_ADVICE = (
    "let the plant update its outputs as soon as its inputs are set, as in model exchange, add "
    "a filter or a delay to the loop, or combine the two FMUs into one"
)


def loop_gain(sides: Sides, step: float) -> float:
    """Change of the controller's output by a change of the commands without delay; 0 if it decays.

    Both are opened again for each change, and moved by very short parts of the step [s].
    """
    sizes = np.array([MOVED * sides.plant.nominal(n) for _, n in sides.wiring.commands])

    def answer(time: float, moved: Vector) -> Vector:
        with closing(sides.main(again=True)) as pair:
            return pair.answer_to(pair.given + moved, time, sides.start)

    def gain(time: float) -> float:
        before = answer(time, 0.0 * sizes)
        rows = [answer(time, row) - before for row in np.diag(sizes)]
        return float(np.linalg.norm(np.array(rows) / sizes[:, None], 2))

    try:
        longer, shorter = (gain(share * step) for share in SHORT)
    except StepFailed:  # a part rejects such steps: the gain is not known
        return 0.0
    return shorter if shorter > LASTS * longer else 0.0


def with_ring_named(run: LoopRun, loop: CoupledPair, sides: Sides, step: float) -> LoopRun:
    """The run, after its end, with a verdict on an algebraic loop that remains for any step."""
    if unsolved := int(loop.whole.record.unsolved):
        found = f"has no solution at {unsolved} communication points"
    else:
        follows = any(sides.plant.follows_at_once(ours) for ours, _ in sides.wiring.signals)
        if run.verdict.trusted or not follows or loop.answer is not Answer.DIRECT:
            return run
        # corrected steps must halve the residual; others converge as long as it does not grow
        gain, corrects = loop_gain(sides, step), loop.plant.can_save and loop.controller.can_save
        if gain < (WORST_CONTRACTION if corrects else 1.0):
            return run
        found = f"has a loop gain of {gain:.3g}"
    reason = (
        "the plant's outputs and the controller's commands depend on each other without "
        f"delay: this algebraic loop {found}, and a smaller step does not help"
    )
    verdict = replace(run.verdict, trusted=False, reason=reason, advice=_ADVICE, step_helps=False)
    return replace(run, verdict=verdict)
