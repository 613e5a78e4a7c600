"""Diagnosis of a drive's model from records: errors of the model, and their causes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ...orchestration.loop.parameter_file import TURNS
from ...solver.arrays import Vector
from ..records.examine import check_identifiable
from ..records.record import Record
from .balance import Added, residual, rms
from .causes import CAUSES, OUTSIDE
from .diagnosis import Curves, Diagnosis, Verdict, finding, holds
from .experiment import next_experiment
from .fit import study_of
from .held_out import HeldOut, NoiseFloor, Remainder, held_out, noise_floor, remainder
from .model import Drive, commanded
from .motion import jumps_of, opposing
from .rule import Explained, built, explained

MOST = 0.5  # share of the squares that, if it certainly goes, explains in part without a name


def diagnose_records(
    records: Sequence[Record],
    prior_model: Drive,
    progress: Callable[[str], None] = lambda doing: None,
    take: str | None = None,
) -> Diagnosis:
    """Find the errors of a simulation of recorded runs.

    `take` is a cause to include in the model in any case; its gain is measured like that of any
    other. `prior` of the result has the records' command. Raises `BadRecord`.
    """
    began = time.perf_counter()
    records, prior_model, notes = commanded(records, prior_model)
    notes += [TURNS] * prior_model.turns + check_identifiable(records)
    progress("fitting values")
    study = study_of(records, prior_model)
    progress("searching for causes")
    found = explained(study, take)
    progress("testing on held-out data")
    held = held_out(found)
    courses, corrected, named = built(study, found.forms, found.fit.amplitude[0])
    left = residual(courses, corrected, named)
    lowest = noise_floor(found, left)
    along = np.concatenate([opposing(c, study.model) for c in study.courses])
    friction = max(rms(along[held.all.telling]), 1e-300)
    causes = tuple(finding(found, h, friction) for h in found.built)
    suspects = tuple(finding(found, h, friction) for h in found.suspects)
    interval = found.gain([]).interval if found.built else (0.0, 0.0)
    before, fitted, final = map(held.level, ("prior", "none", "all"))
    remains = remainder(found, held.all, lowest, friction)
    better = holds(interval, fitted, final)
    settled = better and not remains.something and not remains.hidden
    either = found.alternatives if settled else {}
    verdict = _verdict(found, remains, settled, better, either, interval[0])
    notes += [*jumps_of(study.courses), *_notes(found, held, lowest, remains)]
    quiet = not found.built and not remains.something
    done = verdict == "explained" and not either
    floors = zip(("force_N", "voltage_N"), (lowest.force, lowest.by_current), strict=True)
    return Diagnosis(
        verdict=verdict,
        floor=held.level("noise", lowest.force),
        baseline_residual=before,
        adjusted_residual=fitted,
        final_residual=final,
        friction=friction,
        unseen=remains.unseen,
        gain_interval=interval,
        held_out=f"{len(study.bands.parts)} parts",
        causes=causes,
        suspects=suspects,
        alternatives=either,
        unnamed=(found.outside.form.lives,) if found.outside else (),
        next_experiment=None if done else next_experiment(found, quiet),
        prior=prior_model,
        adjusted=built(study, [], found.catalogue.without([]).amplitude[0])[1],
        corrected=corrected,
        command=records[0].command,
        command_shift=courses[0].calibration["command_shift"],
        adjustments={
            n: corrected.values[n] / prior_model.values[n] - 1.0 for n in prior_model.adjustable
        },
        noise=dict(list(floors)[: len(courses[0].channels)]),
        records=tuple(r.name for r in records),
        curves=_curves(found, prior_model, held, left.force, named),
        seconds=time.perf_counter() - began,
        notes=tuple(notes),
    )


def _verdict(
    found: Explained,
    remains: Remainder,
    settled: bool,
    better: bool,
    either: Mapping[str, tuple[str, ...]],
    gone: float,
) -> Verdict:
    """Verdict from what is left, and from whether the causes are certain.

    A cause with one alternative explains the error, too, if only noise is left with either. `gone`
    is the share of the squares that certainly goes with what is built in.
    """
    certain = any(m.certain for m in found.built)
    if settled and found.built:
        if sum(map(len, either.values())) <= 1 and OUTSIDE not in sum(either.values(), ()):
            return "explained"
        return "partly" if certain else "undecided"
    if certain or gone >= MOST:
        return "partly"
    if remains.something or (found.built and not better):
        return "unexplained"
    return "undecided" if remains.hidden or remains.doubtful else "none"


def _curves(
    found: Explained, prior_model: Drive, held: HeldOut, after: Vector, named: Added
) -> Curves:
    courses, free = found.study.courses, found.outside
    predicted = np.concatenate([opposing(c, prior_model) for c in courses])
    nothing = Added.nothing(courses)
    unnamed = nothing.more(free.form, free.amplitude) if free else nothing
    return Curves(
        time=np.concatenate([c.time for c in courses]),
        record=np.repeat(np.arange(len(courses)), [len(c.x) for c in courses]),
        x=np.concatenate([c.x for c in courses]),
        v=np.concatenate([c.v for c in courses]),
        force=predicted + held.prior.force,
        predicted=predicted,
        before=held.prior.force,
        after=after,
        position_before=held.positions["prior"],
        position_after=held.positions["all"],
        cause=np.concatenate(named.force),
        shape=np.where(held.prior.telling, np.concatenate(unnamed.force), np.nan),
        telling=held.prior.telling,
    )


def _notes(
    found: Explained, held: HeldOut, lowest: NoiseFloor, remains: Remainder
) -> Iterator[str]:
    study, left = found.study, held.all
    if remains.unrepeated:
        yield (
            f"the residual, {left.force_rms:.3g} N, is more than twice {lowest.force:.3g} N, the "
            "noise from differences between laps and the uncertain motion: a part of it may have "
            "a cause"
        )
    if remains.contradicts:
        yield (
            "the motor's forces computed from the voltage and from the current differ by "
            f"{left.by_current_rms:.3g} N, but noise only makes {lowest.by_current:.3g} N: check "
            "the units and signs of u and i, and the values of R and ke"
        )
    if own := [f"{c.own_offset:+.3g} N in {c.record.name}" for c in study.courses if c.offset_name]:
        yield f"additional offsets to that of {study.courses[0].record.name}: {', '.join(own)}"
    if ends := study.at_ends(found.fit.amplitude[0]):
        yield (
            f"at their limit: {', '.join(ends)}. A tolerance is too narrow, "
            "or they compensate for an unknown cause"
        )
    if held.why:
        yield f"no position is predicted: {held.why}"
    if remains.doubtful and (first := found.best):
        size = f"; --take {first.name} gives its size" if first.name in CAUSES else ""
        yield (
            f"the best score is {first.score:.0f}, of {first.name} with "
            f"{100 * first.gain.share:.2g} % of the squares: more than noise has, and not enough "
            f"to be found{size}"
        )
