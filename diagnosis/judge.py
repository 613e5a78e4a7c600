"""How well the models of a diagnosis do on another record, of which they know nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..identification.motion_parts import PARTS, motion_parts
from ..orchestration.parameter_file import BadParameters, Diagnosed, ParameterFile, Value
from ..orchestration.parameter_reading import read_parameters
from ..records.bad_record import BadRecord
from ..records.identifiable import check_identifiable
from ..records.reading import read_drive_records
from ..records.record import CURRENT, Record
from ..solver.files import write_json
from .balance import Added
from .blocks import Blocks, Estimate
from .causes import CAUSES
from .commanded import by_current
from .diagnosis import Level
from .drive import Drive, drive_of
from .held_out import ends_of_seconds
from .modelled_record import ModelledRecord, lay_along, with_law_force
from .residuals import check_motion, floor, residual

PRIOR, ADJUSTED, CORRECTED = "prior", "adjusted", "corrected"
_COMPARED = ((ADJUSTED, PRIOR), (CORRECTED, PRIOR), (CORRECTED, ADJUSTED))


@dataclass(frozen=True)
class Score:
    """What a model leaves of a record, root mean square.

    Attributes
    ----------
    force : Estimate
        Force that the model does not have, where the drive does not rest [N].
    position : Estimate
        Error of the position predicted from the state at the start of each second [m].
    parts : dict of str to Estimate
        Force by part of the motion, those of `PARTS` that the record has [N].
    """

    force: Estimate
    position: Estimate
    parts: dict[str, Estimate]


@dataclass(frozen=True)
class ModelGain:
    """Share of the mean square of what is left under one model that another takes away."""

    model: str
    over: str
    force: Estimate
    position: Estimate


@dataclass(frozen=True)
class Judgement:
    """How three models do on records that none of them was made from.

    Attributes
    ----------
    records, diagnosed : tuple of str
        Names of the records judged on, and of those that the models come from.
    causes : tuple of str
        What the corrected model has in it.
    seconds : float
        Length of the records [s].
    shares : dict of str to float
        Of the samples that count, those of each part of the motion.
    floor : Level
        What noise of the instruments alone would leave.
    scores : dict of str to Score
        Of the models ``prior``, ``adjusted`` and ``corrected``.
    gains : tuple of ModelGain
    notes : tuple of str
        Warnings.
    """

    records: tuple[str, ...]
    diagnosed: tuple[str, ...]
    causes: tuple[str, ...]
    seconds: float
    shares: dict[str, float]
    floor: Level
    scores: dict[str, Score]
    gains: tuple[ModelGain, ...]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """What goes into ``judgement.json``."""

        def told(estimate: Estimate, unit: str) -> dict[str, Any]:
            interval = estimate.interval and list(estimate.interval)
            return {f"value{unit}": estimate.value, f"interval{unit}": interval}

        return {
            **asdict(self),
            "floor": {"force_N": self.floor.force, "position_m": self.floor.position},
            "scores": {
                name: {
                    "force": told(score.force, "_N"),
                    "position": told(score.position, "_m"),
                    "parts": {part: told(e, "_N") for part, e in score.parts.items()},
                }
                for name, score in self.scores.items()
            },
            "gains": [
                {
                    "model": g.model,
                    "over": g.over,
                    "force": told(g.force, ""),
                    "position": told(g.position, ""),
                }
                for g in self.gains
            ],
        }

    def save(self, folder: Path | str) -> None:
        """Write ``judgement.json`` into `folder`.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "judgement.json", self.to_dict())


def judge(
    data: Sequence[Path | str],
    params: Path | str,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
) -> Judgement:
    """Score the models of a diagnosis on records that it has not seen.

    Parameters
    ----------
    data : sequence of path-like
        Files of measured data, see `read_drive_records`.
    params : path-like
        The ``parameters.toml`` that a diagnosis wrote.
    mapping, units : mapping of str to str, optional
        ``theirs -> ours`` names of columns, and units by our names.
    lead : float, optional
        Way of the screw per turn [m].

    Raises
    ------
    BadRecord, BadParameters
        With one line that says what cannot be used and why.
    """
    file = read_parameters(params)
    return judge_records(read_drive_records(data, mapping, units, lead), file)


def judge_records(records: Sequence[Record], file: ParameterFile) -> Judgement:
    """As `judge`, of records and a parameter file in memory."""
    told = _told(file)
    models = _models(file, told)
    records = [_commanded(r, told) for r in records]
    notes = check_identifiable(records)
    courses = [_laid(r, models[PRIOR], told) for r in records]
    check_motion(courses, models[PRIOR])
    nothing = Added.nothing(courses)
    named = _named(courses, models[CORRECTED], file, told)
    left = {
        name: residual(courses, model, named if name == CORRECTED else nothing)
        for name, model in models.items()
    }
    telling = left[PRIOR].telling
    parts = [motion_parts(c) for c in courses]
    masks = {name: np.concatenate([p[name] for p in parts]) & telling for name in PARTS}
    squares = Blocks(ends_of_seconds(courses))
    lowest = floor(courses, models[ADJUSTED])
    return Judgement(
        records=tuple(r.name for r in records),
        diagnosed=told.records,
        causes=tuple(told.causes),
        seconds=float(sum(len(c.x) * c.step for c in courses)),
        shares={n: float(m.sum() / max(telling.sum(), 1)) for n, m in masks.items() if m.any()},
        floor=Level(lowest.force_rms, lowest.position_rms),
        scores={
            name: Score(
                squares.rms(found.force, telling),
                squares.rms(found.position),
                {n: squares.rms(found.force, m) for n, m in masks.items() if m.any()},
            )
            for name, found in left.items()
        },
        gains=tuple(
            ModelGain(
                model,
                over,
                squares.gain(left[over].force, left[model].force, telling),
                squares.gain(left[over].position, left[model].position),
            )
            for model, over in _COMPARED
        ),
        notes=tuple(notes),
    )


# -- the models ------------------------------------------------------------------------------


def _told(file: ParameterFile) -> Diagnosed:
    if file.diagnosis is None:
        raise BadParameters(
            f"{file.path}: has no table [diagnosis]; expected the parameters.toml that ballscrew "
            "diagnose writes, with the prior and the adjusted values in it"
        )
    return file.diagnosis


def _models(file: ParameterFile, told: Diagnosed) -> dict[str, Drive]:
    """The three models, by name; causes that are forces stand beside the corrected one."""

    def model(where: str, values: Mapping[str, Value]) -> Drive:
        missing = [n for n in told.prior if n not in values]
        if missing:
            raise BadParameters(f"{file.path}: [{where}] has no {missing[0]!r}")
        own = {n: values[n] for n in told.prior}
        return drive_of(replace(file, law=told.law, plant=own, found={}, tolerance={}))

    def plain(values: Mapping[str, float]) -> dict[str, Value]:
        return {n: Value(v) for n, v in values.items()}

    return {
        PRIOR: model("diagnosis.prior", plain(told.prior)),
        ADJUSTED: model("diagnosis.adjusted", plain(told.adjusted)),
        CORRECTED: model("plant", file.plant),
    }


def _commanded(record: Record, told: Diagnosed) -> Record:
    """The record with the command that the models take."""
    current = by_current(record) if told.command == CURRENT else None
    if current is not None:
        return current
    if record.current_alone:
        raise BadRecord(
            f"{record.name}: has the current i and no command u; the model was diagnosed with a "
            f"{told.command} as u"
        )
    if record.command != told.command:
        raise BadRecord(
            f"{record.name}: u is a {record.command}, but the model was diagnosed with a "
            f"{told.command} as u; judge it on such a record, or say its unit with --unit u=UNIT"
        )
    return record


def _laid(record: Record, model: Drive, told: Diagnosed) -> ModelledRecord:
    """The record with its motion; the command acts when it did where the models come from."""
    course = lay_along(record, model)
    return replace(course, calibration={**course.calibration, "command_shift": told.command_shift})


def _named(
    courses: Sequence[ModelledRecord], model: Drive, file: ParameterFile, told: Diagnosed
) -> Added:
    """What the named causes add along each record; those that are values are in the model."""
    forces, commands = [], []
    for course in courses:
        alone = [with_law_force(course, model)]
        added = Added.nothing(alone)
        for name, values in told.causes.items():
            if name not in CAUSES:
                raise BadParameters(
                    f"{file.path}: [diagnosis.causes] there is no {name!r}; there are "
                    f"{', '.join(CAUSES)}"
                )
            if "warming" in values and "temperature" not in course.record.signals:
                raise BadRecord(
                    f"{course.record.name}: has no column 'temperature', with which {name} changes"
                )
            try:
                shape = CAUSES[name].at(alone, model, values)
                sizes = [1.0 if shape.sure is not None else values[n] for n in shape.amplitudes]
            except KeyError as error:
                raise BadParameters(
                    f"{file.path}: [diagnosis.causes.{name}] has no {error.args[0]!r}"
                ) from error
            if not shape.freed:
                added = added.more(shape, np.array(sizes))
        forces += added.force
        commands += added.command
    return Added(forces, commands)
