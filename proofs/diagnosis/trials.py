"""Trials of the worlds: records with one hidden effect or none, and the right answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from worlds import OUTSIDE, draw_case, effects_of, write_case

from ballscrew import read_drive_records, read_parameters
from ballscrew.measurement.diagnosis.causes import OUTSIDE as IN_NO_CAUSE
from ballscrew.measurement.diagnosis.model import Drive, commanded, drive_of
from ballscrew.measurement.records.record import Record

FAULTLESS = 10  # faultless records of a world, to one of each effect
VISIBLE = 12.0  # least ratio at which an answer is required
# equivalent names: a wrong value of these is that cause
SYNONYMS = {"m": "unmodelled_inertia", "Jm": "unmodelled_inertia", "offset": "load_bias"}
# a late command and early stamps of the command are equal in a record
LATE = {"input_delay", "time_shift"}


@dataclass(frozen=True)
class Trial:
    """One record to be diagnosed."""

    world: str
    effect: str  # empty without an effect
    seed: int

    @property
    def key(self) -> str:
        """The trial as a single word."""
        return f"{self.world}:{self.effect or 'faultless'}:{self.seed}"


@dataclass(frozen=True)
class Drawn:
    """A record as its user has it, with the truth on its effect."""

    records: list[Record]
    model: Drive
    ratio: float  # visibility of the effect; 0 for a faultless record
    shared: Sequence[str]  # other causes with the same shape


def drawn(trial: Trial) -> Drawn:
    """Draw a record, and read it from its files, which do not contain the truth.

    Raises
    ------
    Unusable
    """
    case = draw_case(trial.world, (trial.effect,) if trial.effect else (), trial.seed)
    with TemporaryDirectory() as folder:
        paths, believed = write_case(case, Path(folder))
        model = drive_of(read_parameters(believed))
        records, model, _ = commanded(read_drive_records(paths), model)
    (sight,) = case.sights or (None,)
    return Drawn(records, model, sight.ratio if sight else 0.0, sight.shared if sight else ())


def right_names(effect: str, shared: Sequence[str]) -> set[str]:
    """The true cause, and causes with the same shape in the record."""
    truth = IN_NO_CAUSE if effect in OUTSIDE else effect
    same = {"parameter_error"} if truth in SYNONYMS.values() else set()
    return {truth, *shared, *same, *(LATE if truth in LATE else ())}


def plan_trials(first_seed: int, worlds: Sequence[str]) -> list[Trial]:
    """One record of every effect in every world and ten faultless ones, all alternately."""
    placed = []
    for world in worlds:
        names = ["", *(name for group in effects_of(world) for name in group)]
        for kind, name in enumerate(names):
            count = 1 if name else FAULTLESS
            for k in range(count):
                placed.append(((k + 0.5) / count, kind, Trial(world, name, first_seed + k)))
    return [trial for *_, trial in sorted(placed, key=lambda p: p[:2])]
