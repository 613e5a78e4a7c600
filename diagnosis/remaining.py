"""What a diagnosis says beside its causes: where the residual is, what was out of reach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .causes import CAUSES
from .diagnosis import NONE, UNEXPLAINED, Level, NextExperiment, NotNamed, OutOfReach
from .drive_model import DriveModel
from .evidence import Conditioned, conditioned
from .experiment_motions import UNNAMED
from .explanation import Explanation
from .found_cause import FREED_SHOWN, SEEN, SMALLEST, whole_force
from .machine_reach import reach_of
from .modelled_record import ModelledRecord
from .next_experiment import motion_for, trial_for
from .noise_floor import AT_FLOOR, NoiseFloor
from .nonparametric import LIVES
from .problem import Candidate, Problem
from .residuals import Residual


def above_floor(left: Residual, lowest: NoiseFloor, repeated: bool) -> list[str]:
    """What to say of more than noise that is left on data held out."""
    notes = []
    if left.force_rms > AT_FLOOR * lowest.force:
        usual = "instruments and white noise make"
        known = "laps differ by and an uncertain motion makes" if repeated else usual
        more = "" if repeated else "; laps of one motion would show what of it repeats"
        notes.append(
            f"what is left, {left.force_rms:.3g} N, is more than twice {lowest.force:.3g} N, which "
            f"is what {known}: a part of it may have a cause{more}"
        )
    if not lowest.has_current(left):
        notes.append(
            "the motor's force by the voltage and by the current differ by "
            f"{left.by_current_rms:.3g} N, where noise makes {lowest.by_current:.3g} N: look at "
            "the units and signs of u and i, at R and at ke"
        )
    return notes


def below_floor(lowest: NoiseFloor, friction: float, lives: Sequence[str]) -> str:
    """What a model without a named fault may still have wrong: silence is not safety.

    Parameters
    ----------
    friction : float
        Root mean square along the motion [N].
    lives : sequence of str
        Where free functions find structure.
    """
    most = AT_FLOOR * lowest.force
    found = f"; a free function finds structure {' and '.join(lives)}" if lives else ""
    return (
        f"not ruled out: a fault of up to {most:.3g} N ({100.0 * most / friction:.3g} % of the "
        f"friction), twice what noise makes{found}"
    )


def where_residual_is(
    first_alone: Mapping[str, float],
    verdict: str,
    unnamed: Sequence[str],
    baseline: Level,
    lowest: Level,
) -> str:
    """How large the residual is, and where that lives which causes explain, in one sentence.

    Where structure is left without a name, the verdict alone says where.
    """
    size = (
        f"The prior model leaves {baseline.force:.3g} N rms in force (noise alone: "
        f"{lowest.force:.3g} N) and {_length(baseline.position)} in position over a second "
        f"({_length(lowest.position)})"
    )
    if verdict == NONE:
        return f"{size}; values within their tolerances leave no more than twice the noise."
    alone = {n: g for n, g in first_alone.items() if n in LIVES}
    if verdict == UNEXPLAINED or unnamed or not alone:
        return f"{size}."
    best = max(alone, key=lambda n: alone[n])
    return f"{size}; before anything was named, it lives {LIVES[best]}."


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
