"""One cell of a map over FMUs: a coupled run of both, and what its signals tell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..fmus.reading import FmuError
from ..orchestration.closed_loop import BadParameter, Study, run_parts
from ..orchestration.fmu_instance import StepFailed
from ..orchestration.loop_run import CouplingError, LoopRun
from ..orchestration.reference_signal import Reference
from ..orchestration.wiring import WiringError
from ..solver.tape import UnsupportedComponent
from .attractor import Attractor
from .cell import LAST, NO_DESIGN, Cell, reason_of, undecided_cell
from .fmu_parts import FmuLoop, FmuParts, OverFmus, opened_parts
from .fmu_with_tangents import TangentsImpossible
from .lyapunov import agree
from .signal_motion import signal_motion
from .study import BadMap, MapStudy
from .tangents_over_fmus import ACCURACY, TangentRun

POSITION = "x"
_BITS = 1.0 / math.log(2.0)
REFUSED = "a part refuses these values"


def run_fmu_cell(
    study: MapStudy, fmus: OverFmus, parts: FmuParts, x: float, y: float, share: float
) -> Cell:
    """Run one loop of a map over FMUs.

    Where both parts have tangents, or an exponent is asked for, one tangent is followed along, and
    its correction chooses the steps; where even the shortest are too long for it, there is no
    exponent. Where no tangent is followed, a run whose coupling is trusted tells, or else two
    that agree, one of half the step.

    Parameters
    ----------
    study : MapStudy
    fmus : OverFmus
        The study's.
    parts : FmuParts
        With as many tangents as `fmus` says.
    share : float
        Of the study's step, and of its square the accuracy of the tangent.

    Raises
    ------
    TangentsImpossible, WiringError, CouplingError
        If the parts cannot be coupled so.
    """
    try:
        plant_values, controller_values, setpoint = study.values_at(x, y)
    except ValueError as error:
        return undecided_cell(NO_DESIGN, str(error))
    names = study.controller, study.plant
    loop = FmuLoop(*names, setpoint, plant_values, controller_values, fmus.mapping)
    step, lambda1 = share * fmus.step, math.nan
    run: TangentRun | LoopRun
    try:
        if fmus.tangents:
            followed = loop.followed(parts, study.stop, step, share**2 * ACCURACY, fmus.tangents)
            growth = followed.growth[:, 0]
            run, motion = followed, signal_motion(followed, loop.nominal(parts), growth)
            if study.exponents and not run.stopped and not followed.unmet:
                lambda1 = float(growth[-1]) / study.stop * _BITS
        else:
            run, motion = _coupled(loop, parts, study.stop, step)
    except StepFailed as error:
        return undecided_cell(REFUSED, str(error))
    reason = reason_of(motion)
    if run.stopped or POSITION not in run.outputs:
        return Cell(motion.kind, math.nan, lambda1, math.nan, reason)
    factor, offset = run.scale
    position = (run.outputs[POSITION] - offset) / factor
    tail = position[run.time >= (1.0 - LAST) * run.time[-1]]
    swing = 0.5 * float(np.ptp(tail))
    return Cell(motion.kind, float(position[-1]) - setpoint, lambda1, swing, reason)


def _coupled(loop: FmuLoop, parts: FmuParts, stop: float, step: float) -> tuple[LoopRun, Attractor]:
    """A run without tangents, or the finer of two, and what its motion becomes."""

    def at(step: float) -> tuple[LoopRun, Attractor]:
        asked = Study(
            loop.controller,
            loop.plant,
            Reference.constant(loop.setpoint),
            stop,
            step,
            plant_values=loop.plant_values,
            controller_values=loop.controller_values,
            mapping=loop.mapping,
        )
        with parts.fresh() as (plant, controller):
            run, _ = run_parts(asked, plant, controller)
        return run, signal_motion(run, loop.nominal(parts))

    run, motion = at(step)
    if run.verdict.trusted:
        return run, motion
    finer, again = at(0.5 * step)
    return finer, agree(motion, again, "half the step")


def check_parts(study: MapStudy, fmus: OverFmus) -> None:
    """Make sure that the FMUs can be coupled as the cells will couple them, by one step.

    Raises
    ------
    BadMap
    """
    brief = replace(study, stop=min(fmus.step, study.stop))
    try:
        with opened_parts(study.plant, study.controller, fmus.tangents) as parts:
            run_fmu_cell(brief, fmus, parts, *study.point(0), 1.0)
    except (
        *(FmuError, WiringError, CouplingError, BadParameter),
        *(TangentsImpossible, UnsupportedComponent),
    ) as error:
        raise BadMap(str(error)) from error
