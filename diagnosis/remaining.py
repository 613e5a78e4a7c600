"""What a diagnosis says beside its causes: where the residual is, what was out of reach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .causes import CAUSES
from .diagnosis import NONE, Level, NextExperiment, NotNamed, OutOfReach
from .drive_model import DriveModel
from .evidence import Conditioned, conditioned
from .experiment_motions import UNNAMED
from .explanation import Explanation
from .found_cause import FREED_SHOWN, SEEN, SMALLEST, whole_force
from .machine_reach import reach_of
from .modelled_record import ModelledRecord
from .next_experiment import motion_for, trial_for
from .nonparametric import LIVES
from .problem import Candidate, Problem
from .search import Found

AT_FLOOR = 2.0  # times the floor: more is not explained


def above_floor(final: Level, lowest: Level, repeated: bool) -> str:
    known = "its laps differ by" if repeated else "the instruments show"
    more = "" if repeated else "; laps of one motion would show what of it repeats"
    return (
        f"what is left, {final.force:.3g} N, is more than {lowest.force:.3g} N, which is what "
        f"{known}: a part of it may have a cause{more}"
    )


def where_residual_is(found: Found, verdict: str, baseline: Level, lowest: Level) -> str:
    """Where the residual lives, and how large it is, in one sentence."""
    size = (
        f"{baseline.force:.3g} N rms in force (noise alone: {lowest.force:.3g} N) and "
        f"{_length(baseline.position)} in position over a second ({_length(lowest.position)})"
    )
    alone = {n: g for n, g in found.first_alone.items() if n in LIVES}
    if verdict == NONE or not alone:
        return (
            f"The prior model leaves {size}; none of it has a structure beyond noise and "
            "values within their tolerances."
        )
    best = max(alone, key=lambda n: alone[n])
    return f"The prior model leaves {size}; what noise does not explain of it lives {LIVES[best]}."


def _length(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm" if metres >= 1e-4 else f"{1e6 * metres:.3g} um"


def out_of_reach(
    courses: Sequence[ModelledRecord], model: DriveModel, problem: Problem, best: Explanation
) -> tuple[OutOfReach, ...]:
    """Causes that would not have shown had they been as large as a twentieth of the friction."""
    left = conditioned(problem.columns.products(), best.priors)
    size = SMALLEST * model.friction_scale
    out = []
    for cause in CAUSES.values():
        if cause.name in best.causes:
            continue
        because = cause.beyond(courses, model)
        if because:
            out.append(OutOfReach(cause.name, because))
            continue
        mine = [c for c in problem.candidates if c.name == cause.name]
        shown = [_shows(c, left, size, model) for c in mine]
        if not shown:
            out.append(OutOfReach(cause.name, "the motion gives it nothing to show at"))
        elif max(shown) < SEEN:
            out.append(
                OutOfReach(
                    cause.name,
                    f"at {100 * SMALLEST:.0f} % of the friction it would stand out by "
                    f"{max(shown):.2g} standard deviations only, and {SEEN:g} are asked for",
                )
            )
    return tuple(out)


def _shows(candidate: Candidate, left: Conditioned, size: float, model: DriveModel) -> float:
    """Standard deviations by which a candidate whose force is of this size stands out."""
    norms = np.sqrt(np.maximum(np.diag(left.of(candidate.columns)[0]), 0.0))
    shape = candidate.shape
    if shape.freed:
        return float(FREED_SHOWN * norms.max())
    rms = np.sqrt(np.mean(whole_force(model, shape) ** 2, axis=0))
    return (
        float(np.max(norms * size / np.maximum(rms, 1e-300), initial=0.0))
        if np.any(rms > 0)
        else 0.0
    )


def next_experiment(
    refused: Sequence[NotNamed],
    structure: bool,
    courses: Sequence[ModelledRecord],
    model: DriveModel,
) -> NextExperiment | None:
    """What would tell apart what this record cannot."""
    for r in refused:
        if r.like:
            motion = motion_for(r.name, reach_of(courses), model)
            says = f"{r.name} cannot be told from {r.like} here ({CAUSES[r.name].confirm})"
            return NextExperiment(says, motion, trial_for(r.name))
    if structure:
        motion = motion_for(UNNAMED, reach_of(courses), model)
        return NextExperiment("structure is left that no cause has", motion, trial_for(UNNAMED))
    return None
