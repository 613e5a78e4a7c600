"""One cell of a map: run a loop with these parameters, and classify its long-term motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..orchestration.loop.whole_loop import model_of
from ..solver.core import System
from ..solver.kernel import CONTROLLER, PLANT, Model
from ..solver.spectrum import follow_returns, follow_tangents
from .attractor import EXPONENTS, LONGER_RUN, OTHER_SOLVER, Attractor, Kind
from .budget import becomes
from .map_plan import MapPlan, kernel_of
from .store import Columns

LAST = 0.1  # share of the run over which the oscillation is measured
REASONS = {  # of undecided cells, by what would decide
    LONGER_RUN: "no rest and no periodic returns until the budget is used up",
    EXPONENTS: "returns that are not periodic",
    OTHER_SOLVER: "the solver cannot continue",
}
NO_DESIGN = "no controller can be designed for this plant"
_BITS = 1.0 / math.log(2.0)


def model_at(
    plan: MapPlan, x: float, y: float, tolerance: float, system: System | None = None
) -> Model:
    return model_of(kernel_of(plan), plan.loop_at(x, y), tolerance, system)


@dataclass(frozen=True)
class Cell:
    """Long-term motion of one loop.

    Attributes
    ----------
    verdict : Kind
    final_error : float
        Set-point minus position at the end of the run [m].
    lambda1 : float
        Largest finite-time exponent [bits/s]; NaN if not requested.
    oscillation : float
        Half the range of the position over the last tenth of the run [m].
    reason : str
        Why it is undecided: one of a few reasons, a colon, and the evidence.
    """

    verdict: Kind
    final_error: float
    lambda1: float
    oscillation: float
    reason: str = ""


def run_cell(
    plan: MapPlan, x: float, y: float, tolerance: float, system: System | None = None
) -> Cell:
    """Run one loop of a map, with the equations of a previous cell if given."""
    try:
        model = model_at(plan, x, y, tolerance, system)
    except ValueError as none:
        return undecided_cell(NO_DESIGN, str(none))
    setpoint = next(
        (model.u[k] for k, i in enumerate(model.kernel.inputs) if i.role == "reference"), 0.0
    )
    position = next(k for k, s in enumerate(model.kernel.states) if s.name == PLANT + "x")
    begin = (1.0 - LAST) * plan.loop.stop
    growth = math.nan
    if plan.exponents:
        run = follow_tangents(model, np.array([0.0, begin]), count=1)
        lost, away, at = run.failure, run.diverged, begin
        frame, growth = run.frame, float(run.growth[-1, 0])
    else:
        passes = follow_returns(model, 0.0, begin, 0, np.inf, 0)
        lost, away, at = passes.failure, passes.diverged, passes.end
    if not lost:
        last = model.x.copy()
        mode = model.u.copy()
        passes = follow_returns(model, begin, plan.loop.stop, position, np.inf, 1)
        lost, away, at = passes.failure, passes.diverged, passes.end
        if plan.exponents and not lost:
            end = model.x.copy(), model.u.copy()
            model.x[:], model.u[:] = last, mode
            tail = follow_tangents(model, np.array([begin, plan.loop.stop]), count=1, frame=frame)
            growth += float(tail.growth[-1, 0])
            model.x[:], model.u[:] = end
    if lost:
        ended = undecided_cell(REASONS[OTHER_SOLVER], lost)
        if away:
            ended = Cell(Kind.DIVERGES, math.nan, math.nan, math.nan)
        return replace(ended, lambda1=growth / at * _BITS)
    error = float(setpoint - model.x[position])
    swing = 0.5 * float(passes.high[position] - passes.low[position])
    motion = becomes(model, plan.loop.stop, plan.loop.stop)
    return Cell(motion.kind, error, growth / plan.loop.stop * _BITS, swing, reason_of(motion))


def undecided_cell(reason: str, evidence: str) -> Cell:
    """A cell without a result, with the reason."""
    return Cell(Kind.UNDECIDED, math.nan, math.nan, math.nan, f"{reason}: {evidence}")


def reason_of(motion: Attractor) -> str:
    """Why a motion is undecided; empty if it is not."""
    if motion.kind is not Kind.UNDECIDED:
        return ""
    would = motion.would_decide
    return f"{REASONS.get(would, f'needed for a decision: {would}')}: {motion.evidence}"


def run_chunk(plan: MapPlan, cells: Sequence[int], share: float) -> Columns:
    """Run some cells at this share of the tolerance; return their columns of the map's table."""
    system = kernel_of(plan).system()
    columns: Columns = {
        "cell": list(cells),
        plan.x.name: [],
        plan.y.name: [],
        "verdict": [],
        "final_error": [],
        "lambda1_bits_per_s": [],
        "oscillation_amplitude": [],
        "reason": [],
    }
    for cell in cells:
        x, y = plan.point(cell)
        found = run_cell(plan, x, y, share * plan.tolerance, system)
        numbers = found.final_error, found.lambda1, found.oscillation
        row = (x, y, found.verdict.value, *numbers, found.reason)
        for name, value in zip(list(columns)[1:], row, strict=True):
            unknown = isinstance(value, float) and math.isnan(value)
            columns[name].append(None if unknown else value)
    return columns


def stuck_growth(plan: MapPlan, x: float, y: float) -> float:
    """Fastest growth of the loop while stuck: bristles at rest move with the block [1/s].

    The friction law's smooth sign is set to one: its argument is made large while the velocity goes
    to zero. The zero eigenvalue, for deflection without motion, is left out; the sign of the
    largest real part is the criterion of Routh and Hurwitz.
    """
    model = model_at(plan, x, y, plan.tolerance)
    names = [p.name for p in model.kernel.parameters]
    for sharpness in (PLANT + "Kv", CONTROLLER + "Kv"):
        if sharpness in names:
            model.p[names.index(sharpness)] = 1e16
    state = np.zeros(len(model.x))
    states = [s.name for s in model.kernel.states]
    state[states.index(PLANT + "v")] = 1e-10
    state[states.index(PLANT + "x")] = plan.loop.set_point
    nominal = np.array([s.nominal for s in model.kernel.states])
    a = model.jacobian(0.0, state) * nominal[None, :] / nominal[:, None]
    values = np.linalg.eigvals(a)
    keep = np.ones(len(values), dtype=bool)
    keep[int(np.argmin(np.abs(values)))] = False
    return float(values[keep].real.max())
