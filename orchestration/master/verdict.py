"""Whether a coupled run can be trusted, judged by runs of the same loop with other steps.

The *rungs* of a run with step H are runs with 4 H, 2 H, H, H/2 and H/4; `master.py` does as many as
are needed. They are corrected if states can be saved, even if the run is not. If a halving of the
step moves the outputs by a share q < 0.7 of what the halving before moved them, all halvings to
come move them by at most q / (1 - q) of the last move together. This, and the difference of the run
from the finest rung, is its estimated error. If the finest rung has a quarter of the step, what is
to come is twice the last move, also for moves without a rule; more, if all three q are above 0.7.

The verdict follows from these numbers only, not from the parts or the coupling.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector

ACCURACY = 0.01  # largest share of an output's range that its estimated error may be
WORST_CONTRACTION = 0.5  # share of the residual that a correction may leave in an algebraic loop
CONVERGES = 0.7  # largest ratio of two successive moves of runs that converge
# shares of the allowed error: a move below the first, after one below the second, may be round-off
NEGLIGIBLE = 0.01, 0.1
AT_A_QUARTER = 2.0  # last moves that are to come after a rung with a quarter of the step


@dataclass(frozen=True)
class Verdict:
    """Verdict on a run."""

    trusted: bool
    reason: str  # one sentence with the deciding number
    advice: str  # empty if trusted
    error_estimate: dict[str, float] = field(default_factory=dict)  # largest, by output
    contraction: float = float("nan")  # of the correction; not finite if nothing was corrected
    step_helps: bool = True  # whether a shorter step may give a trusted run

    @property
    def word(self) -> str:
        return "trusted" if self.trusted else "not converged"


@dataclass(frozen=True)
class Rung:
    """A run with one step: times (k,), and the outputs that are judged (k, n)."""

    step: float  # [s]
    times: Vector
    outputs: Vector
    failure: str = ""  # why it ended early


def moves(rungs: Sequence[Rung], scale: Vector) -> list[float]:
    """By which share of its range each halving moved the output that it moved most."""
    return [float((apart(*pair) / scale).max()) for pair in pairwise(rungs)]


def factor_of(last: float, before: float) -> float:
    """What all halvings to come may move, as a multiple of the last move; infinite if unknown.

    It is at least 1, because the runs may not converge as regularly as the last ones.
    """
    if last <= NEGLIGIBLE[0] * ACCURACY and before <= NEGLIGIBLE[1] * ACCURACY:
        return 1.0
    share = last / before if before > 0.0 else np.inf
    return max(1.0, share / (1.0 - share)) if share <= CONVERGES else np.inf


def verdict_of(
    first: Verdict,
    names: Sequence[str],
    run: Rung,
    rungs: Sequence[Rung],
    around: Vector | float = 0.0,
    timed: Vector | float = 0.0,
    otherwise: bool = False,
) -> Verdict:
    """The verdict on a run from two or more rungs, each with half of the step of the one before.

    Parameters
    ----------
    first : Verdict
        With the advice for a run that is not trusted, and the contraction.
    names : sequence of str
        Of the outputs.
    run : Rung
    rungs : sequence of Rung
        With decreasing steps. If there are only two, they are taken to converge.
    around : ndarray, shape (n,), optional
        Parts of the outputs' jumps that may belong on the other side of a communication point.
    timed : ndarray, shape (n,), optional
        Effect of commands that may arrive a step too late or too early.
    otherwise : bool
        There is one step only: the last rung exchanges its signals in another way.
    """
    rungs = [_at_points(run, rung) for rung in rungs]
    scale, finest = scales(run.outputs), rungs[-1]
    moved = moves(rungs, scale)
    factor = factor_of(*moved[:-3:-1]) if len(moved) > 1 else 1.0
    if finest.step < 0.3 * run.step:
        slow = min(b / (a or np.inf) for a, b in pairwise(moved)) if len(moved) > 3 else 0.0
        factor = slow / (1.0 - slow) if CONVERGES < slow < 1.0 else AT_A_QUARTER
    by = f"by runs with steps down to {finest.step:g} s"
    left = first.contraction if np.isfinite(first.contraction) else 0.0
    if otherwise:  # what a correction leaves comes on top
        factor = 1.0 / (1.0 - left) if left <= WORST_CONTRACTION else np.inf
        by = "by a run that exchanges the signals in another way"
    converges = np.isfinite(factor)
    error = apart(run, finest) + (factor if converges else 1.0) * apart(*rungs[-2:])
    error = np.maximum(error, timed) + around
    share = error / scale
    worst = int(np.argmax(np.where(np.isfinite(share), share, np.inf)))
    size, part = f"{error[worst]:.3g}", f"{100 * share[worst]:.3g} % of its range"
    found = replace(first, error_estimate=dict(zip(names, error.tolist(), strict=True)))
    if share[worst] <= ACCURACY and converges:
        reason = f"the coupling moved no output by more than {part} ({names[worst]}: {size}), {by}"
        return replace(found, trusted=True, reason=reason, advice="")
    reason = f"the coupling may have moved {names[worst]} by {size}, {part}, {by}; "
    reason += f"{100 * ACCURACY:g} % is allowed"
    if otherwise and not converges:
        reason += f", and a correction leaves {100 * left:.2g} % of the coupling residual"
    elif not converges:
        reason += (
            f", and they do not converge: the last halving moved one by {100 * moved[-1]:.2g} %, "
            f"the one before by {100 * moved[-2]:.2g} %"
        )
    return replace(found, reason=reason)


def _at_points(run: Rung, rung: Rung) -> Rung:
    """A rung with a shorter step at the points of a run only: between them nothing is judged."""
    rows = rows_at(run, rung)
    if not rung.step < 0.9 * run.step or rows[-1] >= len(rung.times):
        return rung
    return replace(rung, times=rung.times[rows], outputs=rung.outputs[rows])


def rows_at(run: Rung, fine: Rung) -> npt.NDArray[np.intp]:
    """Rows of a finer run at the times of a run; beyond its last row if it ended early."""
    return np.searchsorted(fine.times, run.times - 1e-6 * fine.step)


def apart(coarse: Rung, fine: Rung) -> Vector:
    """Largest difference of each output at the times of the coarse run, (n,), see `largest`."""
    rows, run = rows_at(coarse, fine), coarse.outputs
    if rows[-1] >= len(fine.times):  # it ended early
        return np.full(run.shape[1], np.inf)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(run - fine.outputs[rows])
    return largest(np.where(np.isfinite(error), error, np.inf), run)


def largest(error: Vector, run: Vector) -> Vector:
    """Largest error of each output of a run (k, n); for a flag, the share of time with an error.

    A flag (0 or 1) that changes a little earlier or later is wrong by its full range at one point,
    even if the shift is very small; its effects are visible in the other outputs.
    """
    flags = np.isin(run, (0.0, 1.0)).all(axis=0) & (run.min(axis=0) < run.max(axis=0))
    return np.asarray(np.where(flags, np.minimum(error, 1.0).mean(axis=0), error.max(axis=0)))


def scales(run: Vector) -> Vector:
    """Range of each output; if it hardly moves, a millionth of its size."""
    span = run.max(axis=0) - run.min(axis=0)
    floor: Vector = np.maximum(span, 1e-6 * np.abs(run).max(axis=0))
    return np.where(floor > 0, floor, 1.0)
