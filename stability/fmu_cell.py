"""One cell of a map over FMUs: a coupled run, judged by its signals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..fmus.reading import FmuError
from ..orchestration.closed_loop import run_parts
from ..orchestration.fmu_instance import StepFailed
from ..orchestration.limits import BadParameter
from ..orchestration.loop import Loop
from ..orchestration.loop_run import CouplingError, LoopRun
from ..orchestration.wiring import WiringError
from ..solver.tape import UnsupportedComponent
from .attractor import Attractor
from .cell import LAST, NO_DESIGN, Cell, reason_of, undecided_cell
from .fmu_parts import FmuParts, OverFmus, opened_parts
from .fmu_with_tangents import TangentsImpossible
from .lyapunov import agree
from .map_plan import BadMap, MapPlan
from .signal_motion import signal_motion
from .tangents_over_fmus import ACCURACY, TangentRun

POSITION = "x"
_BITS = 1.0 / math.log(2.0)
REFUSED = "a part rejects these values"


def run_fmu_cell(
    plan: MapPlan, fmus: OverFmus, parts: FmuParts, x: float, y: float, share: float
) -> Cell:
    """Run one loop of a map over FMUs.

    If both parts have tangents, or an exponent is requested, one tangent is followed, and its
    correction determines the steps; if even the shortest steps are too long for it, there is no
    exponent. Without tangents, the motion is that of a run whose coupling is trusted, or else of
    two runs that agree, one with half the step.

    Parameters
    ----------
    plan : MapPlan
    fmus : OverFmus
        The plan's.
    parts : FmuParts
        With the number of tangents of `fmus`.
    share : float
        Factor on the plan's step; its square is the factor on the accuracy of the tangent.

    Raises
    ------
    TangentsImpossible, WiringError, CouplingError
        If the parts cannot be coupled in this way.
    """
    try:
        loop = plan.loop_at(x, y)
    except ValueError as error:
        return undecided_cell(NO_DESIGN, str(error))
    assert loop.step is not None
    step, lambda1 = share * loop.step, math.nan
    run: TangentRun | LoopRun
    try:
        if fmus.tangents:
            followed = parts.follow(loop, step, share**2 * ACCURACY, fmus.tangents)
            growth = followed.growth[:, 0]
            run, motion = followed, signal_motion(followed, parts.nominal(loop.mapping), growth)
            if plan.exponents and not run.stopped and not followed.unmet:
                lambda1 = float(growth[-1]) / loop.stop * _BITS
        else:
            run, motion = _coupled(loop, parts, step)
    except StepFailed as error:
        return undecided_cell(REFUSED, str(error))
    reason = reason_of(motion)
    if run.stopped or POSITION not in run.outputs:
        return Cell(motion.kind, math.nan, lambda1, math.nan, reason)
    factor, offset = run.scale
    position = (run.outputs[POSITION] - offset) / factor
    tail = position[run.time >= (1.0 - LAST) * run.time[-1]]
    swing = 0.5 * float(np.ptp(tail))
    return Cell(motion.kind, float(position[-1]) - loop.set_point, lambda1, swing, reason)


def _coupled(loop: Loop, parts: FmuParts, step: float) -> tuple[LoopRun, Attractor]:
    """A run without tangents, or the finer one of two, and its long-term motion."""

    def at(step: float) -> tuple[LoopRun, Attractor]:
        with parts.fresh() as (plant, controller):
            run, _ = run_parts(loop, plant, controller, step)
        return run, signal_motion(run, parts.nominal(loop.mapping))

    run, motion = at(step)
    if run.verdict.trusted:
        return run, motion
    finer, again = at(0.5 * step)
    return finer, agree(motion, again, "half the step")


def check_parts(plan: MapPlan, fmus: OverFmus) -> None:
    """Make sure, by one step, that the FMUs can be coupled in the way of the cells.

    Raises
    ------
    BadMap
    """
    loop = plan.loop
    brief = replace(plan, loop=replace(loop, stop=min(loop.step or loop.stop, loop.stop)))
    try:
        with opened_parts(loop, fmus.tangents) as parts:
            run_fmu_cell(brief, fmus, parts, *plan.point(0), 1.0)
    except (
        FmuError,
        WiringError,
        CouplingError,
        BadParameter,
        TangentsImpossible,
        UnsupportedComponent,
    ) as error:
        raise BadMap(str(error)) from error
