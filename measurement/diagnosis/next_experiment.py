"""A motion for the present machine that is expected to reduce the number of suspects.

It stays within the range of the machine that the records show.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ...solver.arrays import Matrix, Vector
from ..records.record import Record
from .balance import responses
from .bands import cut, products
from .causes import EVERY, OUTSIDE
from .diagnosis import NextExperiment
from .experiment_motions import Motion, reach_of, survey
from .modelled_record import lay_along, with_own_offsets
from .rule import Explained
from .scores import Hypothesis
from .study import Study, base_columns, told_of

_MOST = 3  # suspects in the text
_TELLS = 6.0  # difference of log-likelihoods at which two suspects are distinguished
_SAMPLES = 20_000  # most samples of a simulated motion
_SLOW = ("friction_drift", "resistance_drift")
_LONGER = 3.0  # length over that of the records, if a suspect is slow


def next_experiment(found: Explained, quiet: bool) -> NextExperiment:
    """The motion and its purpose; `quiet` if no fault was found."""
    doubtful = [*(m for m in found.built if m.alike or not m.certain), *found.suspects]
    told = [m for m in doubtful if m.name != OUTSIDE]
    told = sorted(told, key=lambda m: -m.score)[:_MOST]
    reach = reach_of(found.study.courses)
    longer = _LONGER if any(m.name in _SLOW for m in told) else 1.0
    motion = survey(reach, found.study.model, longer * reach.lasts)
    if quiet:
        says = "these records show no fault; this motion may show faults that need more motion"
    elif not told:
        says = "part of the residual has no known cause"
    elif len(told) == 1:
        says = f"what would confirm {told[0].name}: {EVERY[told[0].name].confirm}"
    else:
        others = " or ".join(m.name for m in told[1:])
        says = f"these records cannot distinguish {told[0].name} from {others}"
        alike = _alike(found, told, motion)
        if alike:
            says += "; this motion will not distinguish " + ", ".join(
                f"{a} from {b}" for a, b in alike
            )
            says += (
                f", and each of them corrects the model equally well: {EVERY[alike[0][0]].confirm}"
            )
    return NextExperiment(says, motion)


def _alike(found: Explained, told: Sequence[Hypothesis], motion: Motion) -> list[tuple[str, str]]:
    """Pairs of suspects that the motion cannot distinguish, with values fitted."""
    study = _foreseen(found, motion)
    weights = 1.0 / _noise(found, study)
    base = base_columns(study)
    columns = [_columns(study, base, m) for m in told]
    _, spread = study.prior()

    def hidden(k: int, j: int) -> bool:
        # if each record has its own values, use those of the last record
        own = told[k].amplitude[-columns[k].shape[2] :]
        signal = (columns[k] @ own)[:, :, None]
        all_ = np.concatenate([signal, base[0][:, :, 1:], columns[j]], axis=2)
        return _apart(study, all_, weights, spread) < _TELLS

    pairs = itertools.combinations(range(len(told)), 2)
    return [(told[k].name, told[j].name) for k, j in pairs if hidden(k, j) and hidden(j, k)]


def _foreseen(found: Explained, motion: Motion) -> Study:
    """The motion as a simulated record, with the command computed by the model."""
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
    """Variance of each used band of the new motion, from the records [N^2]."""
    known, new = (np.flatnonzero(s.bands.used) for s in (found.study, study))
    return np.asarray(np.interp(new, known, found.variance))


def _columns(study: Study, base: Sequence[Matrix], member: Hypothesis) -> Matrix:
    """Effect of a suspect of amplitude one along the new motion."""
    form = member.form
    if form.freed:
        at = [1 + study.values.index(n) for n in form.freed]
        return base[0][:, :, at]
    made = EVERY[member.name].at(study.courses, study.model, form.values)
    columns = responses(study.courses, study.model, made)[0]
    # if each record has its own phase, use that of the last record
    return columns[:, :, -len(member.amplitude) :]


def _apart(study: Study, columns: Matrix, weights: Vector, spread: Vector) -> float:
    """Loss of log-likelihood if the other columns are fitted to the first one."""
    lines = study.bands.lines([columns])
    used = np.flatnonzero(study.bands.used)
    all_ = products(lines, lines)[:, used].sum(axis=0)
    inner = np.einsum("b,bij->ij", weights, all_)
    precision = np.zeros(len(inner) - 1)
    precision[: len(spread)] = spread**-2.0
    return float(0.5 * told_of(inner, np.array([0]), precision)[0, 0])
