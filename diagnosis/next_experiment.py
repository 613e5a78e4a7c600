"""A motion for the machine at hand that tells a cause from those that it is mistaken for.

It stays within what the records show that the machine can do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..records.record import Record
from .balance import responses
from .bands import cut, products
from .causes import CAUSES
from .causes.cause import CONSTANT_SPEEDS
from .diagnosis import NextExperiment
from .drive import Drive
from .experiment_motions import POSITION, UNNAMED, Motion, constant_speeds
from .explained import Explained
from .machine_reach import Reach, reach_of
from .modelled_record import lay_along, with_own_offsets
from .scores import OUTSIDE
from .sets import Likely
from .signals import entry
from .study import Study, base_columns

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_MOST = 5  # suspects that a motion is chosen for
_TELLS = 6.0  # natural logarithms, by which the likelihood of one has to fall behind
_SAMPLES = 20_000  # of a motion that is looked at


def next_experiment(found: Explained) -> NextExperiment:
    """The motion after which the fewest suspects are to be expected."""
    reach, model = reach_of(found.study.courses), found.study.model
    doubtful = [*(m for m in found.built if not m.certain), *found.suspects]
    told = [m for m in doubtful if m.suspect is not None and m.name != OUTSIDE]
    told = sorted(told, key=lambda m: -m.probability)[:_MOST]
    if len(told) < 2:
        name = told[0].name if told else UNNAMED
        says = "structure is left that no cause has"
        if told:
            says = f"what would confirm {name}: {entry(name).confirm}"
        return NextExperiment(says, motion_for(name, reach, model), trial_for(name))
    sizes: dict[str, tuple[str, float, Motion]] = {}
    for m in told:
        motion = motion_for(m.name, reach, model)
        if motion.kind not in {k for k, *_ in sizes.values()}:
            sizes[m.name] = (motion.kind, _left_after(found, told, motion), motion)
    # of motions that are as good, that of the likelier suspect
    name = min(sizes, key=lambda n: round(sizes[n][1], 1))
    _, left, motion = sizes[name]
    says = (
        f"these records cannot tell {told[0].name} from "
        f"{' or '.join(m.name for m in told[1:3])}; of {len(told)} suspects "
        f"{left:.2g} are to be expected after this motion"
    )
    return NextExperiment(says, motion, trial_for(name))


def _left_after(found: Explained, told: Sequence[Likely], motion: Motion) -> float:
    """How many suspects are to be expected after a motion, each as likely as it is now.

    One stays beside the true one if, with values fitted, it leaves little of what that does.
    """
    if motion.reference != POSITION:  # what a command does is the suspects' own question
        return 0.5 * (1.0 + len(told))
    study = _foreseen(found, motion)
    weights = 1.0 / _noise(found, study)
    base = base_columns(study)
    values = base[0][:, :, 1:]
    columns = [_columns(study, base, m) for m in told]
    _, spread = study.prior()
    expected, total = 0.0, sum(m.probability for m in told)
    for k, (m, mine) in enumerate(zip(told, columns, strict=True)):
        assert m.suspect is not None
        signal = mine @ m.suspect.amplitude
        alike = 1.0
        for j, other in enumerate(columns):
            if j != k:
                all_ = np.concatenate([signal[:, :, None], values, other], axis=2)
                alike += _apart(study, all_, weights, spread) < _TELLS
        expected += m.probability / max(total, 1e-300) * alike
    return expected


def _foreseen(found: Explained, motion: Motion) -> Study:
    """The motion as it would be recorded, with the command that the model asks for."""
    model, like = found.study.model, found.study.courses[0]
    step = max(like.step, motion.duration / _SAMPLES)
    time = np.arange(0.0, motion.duration, step)
    x = np.interp(time, motion.time, motion.values)
    v = np.gradient(x, step)
    force = model.friction(x, v, step) + model.linear_friction * v
    force += model.inertia * np.gradient(v, step)
    u = force / model.per_command + (model.back_emf * v if model.has_motor else 0.0)
    signals = {"time": time, "u": u, "x": x}
    if like.has_current:
        signals["i"] = force / model.per_ampere
    record = Record("next", signals, step, like.record.command)
    courses = with_own_offsets([lay_along(record, model)], model)
    return Study(courses, model, found.study.prior_model, cut(courses, model))


def _noise(found: Explained, study: Study) -> Vector:
    """Variance of each band that is used of the new motion, as the records have it [N^2]."""
    known, new = (np.flatnonzero(s.bands.used) for s in (found.study, study))
    return np.asarray(np.interp(new, known, found.variance))


def _columns(study: Study, base: Sequence[Matrix], member: Likely) -> Matrix:
    """What a suspect of amplitude one does along the new motion."""
    assert member.suspect is not None
    shape = member.suspect.form.shape
    if shape.freed:
        at = [1 + study.values.index(n) for n in shape.freed]
        return base[0][:, :, at]
    made = entry(member.name).at(study.courses, study.model, shape.values)
    columns = responses(study.courses, study.model, made)[0]
    # a phase that each record has for itself is the last one's
    return columns[:, :, -len(member.suspect.amplitude) :]


def _apart(study: Study, columns: Matrix, weights: Vector, spread: Vector) -> float:
    """What the first column keeps when the others are fitted to it, in natural logarithms."""
    lines = study.bands.lines([columns])
    used = np.flatnonzero(study.bands.used)
    all_ = products(lines, lines)[:, used].sum(axis=0)
    inner = np.einsum("b,bij->ij", weights, all_)
    at = np.arange(1, len(inner))
    inner[at[: len(spread)], at[: len(spread)]] += spread**-2.0
    inner[at, at] *= 1.0 + 1e-9
    inner[at, at] += 1e-30
    cross = inner[1:, 0]
    return float(0.5 * (inner[0, 0] - cross @ np.linalg.solve(inner[1:, 1:], cross)))


def motion_for(cause: str, reach: Reach, model: Drive) -> Motion:
    """The motion that tells a cause, or what has no name, on the machine of these records.

    Parameters
    ----------
    cause : str
        A name of `CAUSES`, or `UNNAMED`.
    reach : Reach
    model : Drive
        As far as it is known: friction, and the force of the command.
    """
    return (CAUSES[cause].motion if cause in CAUSES else constant_speeds)(reach, model)


def trial_for(cause: str) -> str:
    """The trial of the virtual rig, by name, that does the same there."""
    return CAUSES[cause].trial if cause in CAUSES else CONSTANT_SPEEDS
