"""Identify a friction law's parameters from records."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtrc

from ...orchestration.loop.parameter_file import BALL_SCREW, DRIVE, TURNS, ParameterFile, Value
from ...plant import LAWS
from ...plant.ball_screw import PARAMETERS as AXIS
from ...plant.instruments.amplifier import PARAMETERS as AMPLIFIER
from ...solver.errors import BadParameter, nearest
from ..records.reading import INTEGRATED, read_force_records
from ..records.record import FORCE, TORQUE, Record
from .fit import fit_along, fit_late_records
from .fitted_law import MASS, OFFSET, fitted_law
from .identifiability import ways, which_would_do, why_not
from .identification import SIDES, Identification
from .intervals import Fit, Interval
from .layout import StackedRecords
from .left_over import gain_words

Records = Sequence[Record]
Intervals = Mapping[str, Interval]
Fixed = Mapping[str, float]


def check_held(law: str, fixed: Fixed, offset: bool = False) -> None:
    """Raise BadParameter if a parameter cannot be fixed, or an offset cannot be fitted.

    `fixed` has values by the law's names, or `OFFSET` [N]; `offset`: a constant force is fitted.
    """
    names, together = fitted_law(law).names, fitted_law(law).together
    for name, value in fixed.items():
        if name in together:
            others = ", ".join(n for n in together if n != name)
            both = f"{name} of {law} is fitted together with {others}"
            raise BadParameter(f"{both} and cannot be fixed alone")
        if name not in (*names, OFFSET):
            near, there = nearest(name, [*names, OFFSET]), ", ".join(names)
            known = f"it has {there}, and there is {OFFSET}"
            raise BadParameter(f"{law} has no parameter {name!r}{near}; {known}")
        if not math.isfinite(value) or (name != OFFSET and value <= 0):
            wanted = "number above 0; a small value removes its effect"
            wanted = "finite number" if name == OFFSET else wanted
            raise BadParameter(f"{name} is {value:g}, expected a {wanted}")
    if offset and OFFSET in fixed:
        raise BadParameter(f"{OFFSET} is held at {fixed[OFFSET]:g} N and fitted; choose one")
    if offset and fitted_law(law).directional:
        both = f"{law} has separate friction for each direction"
        why = "which cannot be distinguished from a constant force"
        raise BadParameter(f"{both}, {why}; fix {OFFSET} at a value")


def identify_files(
    records: Sequence[Record | Path | str],
    law: str,
    fixed: Mapping[str, float] | None,
    offset: bool,
    file: ParameterFile | None,
    mass: float | bool,
    *columns: Any,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identify from records, or files with these mapping, units and lead; see `identify`.

    The mass of files is that of `file` if it is not given; True: it is fitted.
    """
    mapping, units, lead = columns
    if file:
        file = file.checked().with_lead(lead)
        lead = lead or file.lead
    known = file.plant[MASS].value if file and MASS in file.plant else None
    how = mapping, units, known if isinstance(mass, bool) else mass, lead
    progress("reading")
    found: list[Record] = []
    for record in records:
        found += [record] if isinstance(record, Record) else read_force_records([record], *how)
    return identify(found, law, file, fixed, offset, mass is True, progress)


def identify(
    records: Sequence[Record],
    law: str,
    file: ParameterFile | None = None,
    fixed: Mapping[str, float] | None = None,
    offset: bool = False,
    mass: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identify a law's parameters from records.

    The result's parameter file keeps the known values of the drive, which are `file`. Default: the
    rig's axis for records of the rig; otherwise a drive with their mass, by its force or torque.
    Parameters in `fixed` are not fitted [SI]. The `offset` is a constant force, of a load or a
    load cell's zero; with `mass` one mass is fitted in place of the records'. Raises
    `BadParameter`, and ValueError without records.
    """
    if law not in LAWS:
        raise BadParameter(f"no law {law!r} to identify; there are {', '.join(LAWS)}")
    if not records:
        raise ValueError("no records given; expected one or more")
    fixed = dict(fixed or {})
    check_held(law, fixed, offset)
    given = [replace(r, mass=1.0) for r in records] if mass else list(records)
    beside = (MASS,) * mass + (OFFSET,) * offset
    fitted = fit_late_records(given, law, fixed, beside, progress)
    records, course, fit, left = fitted.records, fitted.course, fitted.fit, fitted.left
    shift = fitted.late if fitted.explained else None
    if mass:
        records = [replace(r, mass=fit.values[MASS]) for r in records]
        course = course.with_mass(fit.values[MASS])
    file = file or _file_of(records, mass)
    progress("judging the parameters")
    judged = {n: _judge(fit, n, course) for n in fit.names}
    progress("fitting each direction")
    per_direction, notes = _each_way(records, fit, judged, course, fixed)
    notes += [TURNS] * file.turns + _remarks(records, fit, offset)
    if OFFSET in judged and file.kind != DRIVE:
        why = 'only kind = "drive" has such a parameter'
        notes.append(f"the offset is not in parameters.toml: {why}")
    if shift and records[0].lags != given[0].lags:
        low, high = (math.nan if end is None else 1e3 * end for end in (shift.low, shift.high))
        late = f"{1e3 * shift.value:.3g} ms later than the motion ({low:.3g} .. {high:.3g} ms)"
        notes.append(f"the force comes {late}: the records were corrected by it")
    if mass:
        notes += _of_mass(judged[MASS], file.plant.get(MASS))
    warnings = [f"{n}: {i.because}" for n, i in judged.items() if not i.identified]
    parts = "; ".join(f"{p.force:.3g} N go {p.words}" for p in left.parts)
    if not fitted.explained:
        times = f"{left.force / left.noise:.3g} times the effect of noise and sampling"
        unexplained = f"the law leaves {left.force:.3g} N of the force unexplained, {times}"
        warnings.append(f"{unexplained}; {parts}")
    elif left.force > 0.02 * course.level:
        notes.append(f"of this, {parts}")
    return Identification(
        law=law,
        records=tuple(records),
        parameters=judged,
        per_direction=per_direction,
        fit=fit,
        course=course,
        left=left,
        time_shift=shift,
        warnings=tuple(warnings),
        notes=tuple(notes),
        file=file,
        fixed=fixed,
    )


def _file_of(records: Records, mass: bool) -> ParameterFile:
    """What is known of the machine: the rig's axis without friction, or a drive by force or torque.

    Without the mass, if `mass` is fitted.
    """
    for record in records:
        if record.about and record.about.get("kind", BALL_SCREW) == BALL_SCREW:
            said, source = record.about.get("parameters", {}), "of the trial's rig"
            own = [p for p in (*AXIS, *AMPLIFIER) if not (mass and p.name == MASS)]
            axis = {p.name: (said.get(f"plant.{p.name}", p.default), p.unit) for p in own}
            return ParameterFile(plant={n: Value(*v, None, source) for n, v in axis.items()})
    command, gain, unit = FORCE, 1.0, "1"
    if lead := records[0].lead:
        command, gain, unit = TORQUE, 2 * math.pi / lead, "N/(N*m)"
    values = {"gain": Value(gain, unit, None, f"the command is the {command}")}
    if not mass:
        said = "of the records: between load cell and block"
        values = {MASS: Value(records[0].mass, "kg", None, said), **values}
    return ParameterFile(kind=DRIVE, command=command, plant=values)


def _each_way(
    records: Records, fit: Fit, judged: Intervals, course: StackedRecords, fixed: Fixed
) -> tuple[dict[str, dict[str, Interval]], list[str]]:
    """Parameters of each direction, if both were recorded, and notes on them."""
    names = fit.law.parameters
    notes: list[str] = []
    split = dict(judged)
    if not fit.law.directional:
        moved = ways(course)
        if len(moved) < 2:
            return {}, [f"motion {moved[0]} only: the other direction is not identified"]
        guess = {n: i.value for n, i in judged.items()}
        held = dict(fixed) | ({OFFSET: guess[OFFSET]} if OFFSET in guess else {})
        apart = fit_along(records, fit.law.name, course, tied=False, guess=guess, fixed=held)
        split = {n: _judge(apart, n, course) for n in apart.names}
        notes = _difference(apart, split, fixed)
    return {side: {n: split[n + end] for n in names} for side, end in SIDES.items()}, notes


def _of_mass(found: Interval, given: Value | None) -> list[str]:
    """Notes on force, lead and units if the fitted mass differs from the given mass."""
    if given is None or not found.identified or found.low is None or found.high is None:
        return []
    if found.low <= given.value <= found.high:
        return []
    said = f"{MASS} is given as {given.value:.4g} kg, but these records give {found.value:.4g} kg"
    return [said + gain_words(found.value, given.value)]


def _remarks(records: Records, fit: Fit, offset: bool) -> list[str]:
    """Notes on the records and on the law."""
    notes = []
    if foreign := [r for r in records if not r.about]:
        way = max(float(np.ptp(r.position)) for r in foreign)
        pull = max(float(np.abs(r.force).max()) for r in foreign)
        sizes = f"positions cover up to {way:.3g} m, forces reach {pull:.3g} N, samples come every"
        step = f"{foreign[0].step:.3g} s: if this is wrong, give the units"
        notes.append(f"without trial.json, by name and unit, {sizes} {step}")
    if offset:
        both = "a constant force and a Coulomb friction that depends on direction"
        same = "the offset assumes the same friction in both directions"
        notes.append(f"in sliding, {both} cannot be distinguished: {same}")
    notes += [INTEGRATED] * any(r.velocity_alone for r in records)
    if fit.law.rigid:
        share = f"{np.mean(~fit.spoken):.0%} of the samples, where the block may stick,"
        only = "only give a lower limit of the static friction"
        notes.append(f"presliding stiffness: the law has none; {share} {only}")
    if not fit.law.asks.form:
        slower = "its equations are solved from sample to sample, which is slower"
        notes.append(f"{fit.law.name} has no fast form in c/laws.c: {slower}")
    if "Kv" in fit.law.unseen:
        notes.append("Kv is fixed at 1e8 s/m: these records do not resolve |v| of 1e-8 m/s")
    return notes


def _judge(fit: Fit, name: str, course: StackedRecords) -> Interval:
    interval = fit.intervals[name]
    if interval.identified:
        return interval
    because, would_do = why_not(fit, name, course), which_would_do(fit, name, course)
    return replace(interval, because=because, would_do=would_do)


def _difference(apart: Fit, split: Intervals, fixed: Fixed) -> list[str]:
    """A note if the two directions differ significantly."""
    names = apart.law.parameters
    free = [j for j, n in enumerate(names) if n not in fixed]
    seen = [j for j in free if all(split[names[j] + end].identified for end in SIDES.values())]
    if not seen:
        return []
    turn = np.eye(len(names), len(apart.coordinates))
    turn = (turn - np.roll(turn, len(names), axis=1))[seen]
    gap = turn @ apart.coordinates
    distance = float(gap @ np.linalg.solve(turn @ apart.covariance @ turn.T, gap))
    if chdtrc(len(seen), distance) > 1e-3:  # probability, if both directions were the same
        return []
    name = names[seen[int(np.argmax(np.abs(gap)))]]
    one, other = split[name + "_pos"], split[name + "_neg"]
    most = f"most in {name}: {one.value:.4g} and {other.value:.4g} {one.unit}"
    both = "one set of parameters for both is a compromise, and its intervals are too narrow"
    return [f"the two directions differ by more than chance ({most}); {both}"]
