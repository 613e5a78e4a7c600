"""Whether a coupled run can be trusted, judged by measurements in the run.

A reference co-run accompanies the run: the same FMUs with another coupling. If the run corrects its
steps, the co-run does not, and vice versa, and their controllers use the signals of a step in
different ways. The difference of the two is the effect of the coupling residual, which the loop
itself propagates; divided by one minus the measured contraction of the correction, it estimates
the error. If the set-point is curved within the steps, which affects both in the same way, a co-run
with half of the step is added. If states cannot be saved, co-runs with a half and a quarter of the
step are used.

If the result is neither clear nor hopeless, or if an output jumps, a second look follows:
corrected co-runs with a half and a quarter of the step, and the outputs close before and after the
communication points next to each jump (`second_look.py`).

The verdict follows from these numbers only, not from the parts or the coupling.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]

ACCURACY = 0.01
"""Largest share of an output's range that its estimated error may be."""
WORST_CONTRACTION = 0.5
"""Correcting must at least halve the residual, or its effect says little about the error."""
CLEAR = 0.1
"""Share of the allowed error up to which the first estimate is enough: it uses one other run, whose
error may have the same sign, for example if both switch a relay late."""
HOPELESS, OFTEN = 10.0, 0.1
"""No second look if the allowed error is exceeded by this factor in this share of all steps."""
STEP_RATIO_ERROR = 2.0
"""Estimated error of the run with a quarter of the step, as a multiple of its difference from the
run with a half. For a coupling of first order, this is twice the true error."""
HALVING = 2.5
"""Estimated error of a run, as a multiple of its difference from the run with half of the step.
For a coupling of first order, this is a quarter more than the true error."""


@dataclass(frozen=True)
class Verdict:
    """Verdict on a run."""

    trusted: bool
    reason: str  # one sentence with the deciding number
    advice: str  # empty if trusted
    error_estimate: dict[str, float] = field(default_factory=dict)  # largest, by plant output
    contraction: float = float("nan")  # of the correction; not finite if nothing was corrected
    step_helps: bool = True  # whether a shorter step may give a trusted run

    @property
    def word(self) -> str:
        return "trusted" if self.trusted else "not converged"


def verdict_of(
    names: list[str],
    run: Vector,
    co_runs: Sequence[Vector],
    contraction: float,
    smaller: str,
    safety: float = 2.0,
    failure: str = "",
    advice: str = "",
) -> Verdict:
    """The verdict on a run (k, n), from it and its reference co-runs.

    The second co-run, with half of the step, is there if the set-point is curved within the steps.
    `smaller` says what to do about a residual that is too large, `failure` why a run ended early,
    `advice` what to do about it. `safety` is 1 if the reference co-run is worse than the run, so
    that the difference is larger than the run's own error; 2 if it is better.
    """
    co_run, *half = co_runs
    rows = min(len(run), len(co_run))
    what = "the coupling residual"
    scale = scales(run[:rows])
    amplification = 1 / (1 - min(contraction, 0.999)) if np.isfinite(contraction) else 1.0
    with np.errstate(invalid="ignore", over="ignore"):
        difference = _worst(np.abs(run[:rows] - co_run[:rows]), run) * amplification
        if half:
            rows = min(len(run), len(half[0]))
            halving = _worst(np.abs(run[:rows] - half[0][:rows]), run)
            difference = np.maximum(difference, HALVING * halving)
            what += ", or the set-point within the steps,"
    share = difference / scale
    estimate = dict(zip(names, difference.tolist(), strict=True))
    worst = int(np.argmax(np.where(np.isfinite(share), share, np.inf)))
    if failure:
        return Verdict(False, failure, advice, estimate, contraction)
    if np.isfinite(contraction) and contraction > WORST_CONTRACTION:
        return Verdict(
            False,
            f"one correction of the coupling residual leaves {100 * contraction:.3g} % of it: the "
            "step is too long for co-simulation of these parts",
            smaller,
            estimate,
            contraction,
        )
    if not np.isfinite(share[worst]) or safety * share[worst] > ACCURACY:
        return Verdict(
            False,
            f"{what} may have moved {names[worst]} by {difference[worst]:.3g}, "
            f"{100 * share[worst]:.3g} % of its range; {100 * ACCURACY / safety:g} % is allowed",
            smaller,
            estimate,
            contraction,
        )
    return Verdict(
        True,
        f"{what} moved no output by more than {100 * share[worst]:.2g} % of its "
        f"range ({names[worst]}: {difference[worst]:.2g})",
        "",
        estimate,
        contraction,
    )


def asks_again(verdict: Verdict, run: Vector, co_run: Vector, safety: float, blind: bool) -> bool:
    """Whether the first estimate leaves open whether a run (k, n) without failures is right.

    They are `blind` if both may have the same error: an output jumps, possibly in both on the wrong
    side of a step's end; or nothing is corrected, and a relay switches late in both.
    """
    share = np.abs(run - co_run) / scales(run)
    if not np.isfinite(share).all():
        return False
    estimate = np.array(list(verdict.error_estimate.values())) / scales(run)
    clear = verdict.trusted and safety * estimate.max() <= CLEAR * ACCURACY
    hopeless = np.mean(share.max(axis=1) > HOPELESS * ACCURACY) > OFTEN
    return bool((blind or not clear) and not hopeless)


def second_verdict(
    first: Verdict,
    run: Vector,
    half: Vector,
    quarter: Vector,
    delayed: Vector | None,
    around: Vector,
) -> Verdict:
    """The verdict from co-runs (k, n) with a half and a quarter of the step, at the run's points.

    `delayed` has a quarter of the step, and commands one such step earlier or later; it is given if
    nothing is corrected. `around` is the part of a jump that may belong on the other side.
    """
    names = list(first.error_estimate)
    error = np.abs(run - quarter) + STEP_RATIO_ERROR * np.abs(half - quarter)
    if delayed is not None:  # the run's commands may be late by four times as much
        error = np.maximum(error, 4 * np.abs(delayed - quarter))
    error += around
    worst_error = _worst(error, run)
    share = worst_error / scales(run)
    worst = int(np.argmax(share))
    estimate = dict(zip(names, worst_error.tolist(), strict=True))
    by = "by co-runs with a half and a quarter of the step"
    size, part = f"{worst_error[worst]:.3g}", f"{100 * share[worst]:.3g} % of its range"
    if not share[worst] <= ACCURACY:
        reason = f"the coupling may have moved {names[worst]} by {size}, {part}, {by}; "
        reason += f"{100 * ACCURACY:g} % is allowed"
        return Verdict(False, reason, first.advice, estimate, first.contraction)
    reason = f"the coupling moved no output by more than {part} ({names[worst]}: {size}), {by}"
    return Verdict(True, reason, "", estimate, first.contraction)


def _worst(error: Vector, run: Vector) -> Vector:
    """Largest error of each output; for a flag (0 or 1), the share of time in which it is wrong.

    A flag that changes a little earlier or later is wrong by its full range at one point, even if
    the shift is very small; its effects are visible in the other outputs.
    """
    flags = np.isin(run, (0.0, 1.0)).all(axis=0) & (run.min(axis=0) < run.max(axis=0))
    return np.asarray(np.where(flags, np.minimum(error, 1.0).mean(axis=0), error.max(axis=0)))


def scales(run: Vector) -> Vector:
    """Range of each output; if it hardly moves, a millionth of its size."""
    span = run.max(axis=0) - run.min(axis=0)
    floor: Vector = np.maximum(span, 1e-6 * np.abs(run).max(axis=0))
    return np.where(floor > 0, floor, 1.0)
