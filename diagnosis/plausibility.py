"""Whether a cause can be what it would have to be: in size, in kind, and for the instruments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .balance import calibrated
from .causes import CAUSES
from .causes.cause import engaged
from .drive_model import DriveModel
from .explanation import OWN, Explanation, amplitudes, can_be, scores
from .held_out import with_values
from .modelled_record import ModelledRecord, calibration_priors, opposing
from .problem import Problem
from .search import added_by

Folds = npt.NDArray[np.int64]

_SLIDES = 0.9  # of the sliding friction, that has come up
_ACTS = 0.8  # of the largest force of a cause: where it acts
_SOME = 0.2  # of the time that it acts
_LEAST_LEFT = 0.2  # of the friction, that has to be left for more than that time
_SAMPLES = 3  # within which what a reversal does cannot be seen
_BETWEEN = (0.1, 0.9)  # of a record: where a change can be told from another value
_NEAR_TOLERANCE = 0.25  # of a tolerance's whole width
_AT_END = 0.02  # of a range's width
_MOST_AT_ENDS = 2  # values at the end of their range, beside two that may be anything
_LIKE = (0.25, 2.5)  # size in one part of the data, relative to that in all
_AGREE = 0.75  # of the information: parts whose size is like that


def at_an_end(now: Explanation, k: int, courses: Sequence[ModelledRecord]) -> str:
    """Why a change in time is none: another constant value does nearly the same; empty if not."""
    member = now.members[k]
    longest = max(float(c.time[-1]) for c in courses)
    times = [member.shape.values[n] for n in CAUSES[member.name].when if n in member.shape.values]
    if all(_BETWEEN[0] * longest < t < _BETWEEN[1] * longest for t in times):
        return ""
    return "it comes at the start or the end of the record only"


def drives(problem: Problem, now: Explanation, k: int, courses: Sequence[ModelledRecord]) -> str:
    """Why a friction cannot be one: it would hardly brake, or even drive; empty if it can."""
    if not CAUSES[now.members[k].name].of_friction:
        return ""
    fitted = amplitudes(problem, now)
    friction = [m for m in now.members if CAUSES[m.name].of_friction]
    added = added_by(friction, fitted, courses).force
    model = with_values(problem, fitted)
    shares, sizes = [], []
    for c, more in zip(courses, added, strict=True):
        law = opposing(c, model)
        sliding = (np.abs(engaged(c, model)) > _SLIDES) & ~c.rests
        shares.append(1.0 + more[sliding] / law[sliding])
        sizes.append(np.abs(more[sliding]))
    size = np.concatenate(sizes)
    acts = size >= _ACTS * size.max(initial=0.0)
    left = float(np.quantile(np.concatenate(shares)[acts], _SOME)) if np.any(acts) else 1.0
    return "" if left > _LEAST_LEFT else "hardly any friction would be left with it"


def size_differs(problem: Problem, now: Explanation, k: int, folds: Folds) -> str:
    """Why a member's size cannot be one number; empty if it can."""
    found = scores(problem, now, k)
    estimate = found.estimate()
    member = now.members[k]
    if member.shape.sure is not None and not OWN[0] < float(estimate[0]) < OWN[1]:
        return f"its size is {float(estimate[0]):.2g} of what its shape asks for"
    likes, informations = [], []
    for fold in np.unique(folds):
        mine = folds == fold
        information = float(estimate @ found.pieces[mine].sum(axis=0) @ estimate)
        if information > 0.0:
            size = float(estimate @ found.by_stretch[mine].sum(axis=0)) / information
            likes.append(_LIKE[0] < size < _LIKE[1])
            informations.append(information)
    share = float(np.dot(likes, informations)) / max(sum(informations), 1e-300)
    return "" if share >= _AGREE else "its size differs between parts of the data"


def follows_within_a_sample(model: DriveModel, courses: Sequence[ModelledRecord]) -> bool:
    """Whether the drive's velocity has followed its command before the next sample is taken."""
    return model.inertia < model.damping * max(c.step for c in courses)


def not_shown(problem: Problem, now: Explanation, k: int, courses: Sequence[ModelledRecord]) -> str:
    """Why instruments could not show a cause of this size; empty if they could."""
    member, course = now.members[k], courses[0]
    fitted = amplitudes(problem, now)
    late, way = CAUSES[member.name].late, CAUSES[member.name].way
    if way:
        too_short = way(problem.model, member.shape.values) < max(
            c.record.resolution for c in courses
        )
        return "its way is less than a count of the encoder" if too_short else ""
    # a command that acts later than it is written may be a recorder's
    later, least = np.inf, calibration_priors(course)["command_shift"].high * course.step
    if late:
        place = 1 + len(problem.names) + list(calibrated(courses)).index("command_shift")
        early = (course.calibration["command_shift"] + fitted[place]) * course.step
        later = sum(share * member.shape.values.get(n, 0.0) for n, share in late.items()) - early
        least *= 1.0 + 2.0 * _NEAR_TOLERANCE
    elif "m" in member.shape.freed:
        # the drive follows its command later by the mass over what slows it
        slowed = max(problem.model.damping, 1e-9)
        column = member.columns[member.shape.freed.index("m")]
        found = problem.model.values["m"] * (1.0 + fitted[column])
        later = abs(found - problem.prior_model.values["m"]) / slowed
    return "a command may be recorded as early as that" if later < least else ""


def within_tolerance(
    problem: Problem, now: Explanation, k: int, courses: Sequence[ModelledRecord]
) -> str:
    """Why a freed value is no error: it is absurd, or hardly an error; empty if it is one."""
    member = now.members[k]
    if not member.shape.freed:
        return ""
    if not can_be(problem, now):
        return "a value would be beyond the range of what can be wrong"
    fitted = amplitudes(problem, now)[member.columns]
    places = member.columns - 1
    near = _NEAR_TOLERANCE * (problem.high - problem.low)[places]
    if np.any((fitted > problem.low[places] - near) & (fitted < problem.high[places] + near)):
        return "a value is hardly beyond its tolerance"
    if len(member.shape.freed) > 1 and len(at_ends(problem, now, courses)) >= _MOST_AT_ENDS:
        return "other values stand at the end of their range beside it"
    return ""


def at_ends(problem: Problem, now: Explanation, courses: Sequence[ModelledRecord]) -> list[str]:
    """Values and calibrations that stand at the end of what they can be, freed ones left out."""
    fitted = amplitudes(problem, now)[problem.prior.columns]
    near = _AT_END * (problem.high - problem.low)
    ends = (fitted < problem.low + near) | (fitted > problem.high - near)
    freed = [c for m in now.members if m.shape.freed for c in m.columns]
    names = [*problem.names, *calibrated(courses)]
    return [
        n
        for n, c, e in zip(names, problem.prior.columns, ends, strict=True)
        if e and c not in freed
    ]


def crossed(courses: Sequence[ModelledRecord]) -> float:
    """Way that the drive goes after a reversal before samples tell anything of it, usually [m]."""
    ways = []
    for c in courses:
        turns = np.flatnonzero((c.v[1:] > 0.0) != (c.v[:-1] > 0.0))
        ways.append(0.5 * np.abs(c.mean_a[turns]) * (max(_SAMPLES, c.width) * c.step) ** 2)
    return float(np.median(np.concatenate(ways))) if any(len(w) for w in ways) else 0.0
