"""Trials of the worlds: hidden effects, and evaluation of answers."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from worlds import OUTSIDE as NOT_IN_CATALOGUE
from worlds import WORLDS, Unusable, draw_case, effects_of, write_case

from ballscrew import read_drive_records, read_parameters
from ballscrew.measurement.diagnosis.model import Drive, commanded, drive_of
from ballscrew.measurement.diagnosis.scores import OUTSIDE as IN_NO_CAUSE
from ballscrew.measurement.records.record import Record

FAULTLESS, CAUSE, OUTSIDE, SIGNAL = "faultless", "cause", "outside", "signal"
FAULTLESS_EACH = 10  # faultless records per record of each cause
KEPT = Path(__file__).resolve().parents[1] / "out" / "worlds"
VISIBLE = 12.0  # least ratio at which an answer is required
# equivalent names: a wrong value of these is that cause
SYNONYMS = {"m": "unmodelled_inertia", "Jm": "unmodelled_inertia", "offset": "load_bias"}
# a late command and early stamps of the command are equal in a record
LATE = {"input_delay", "time_shift"}


@dataclass(frozen=True)
class Trial:
    """One record to be diagnosed."""

    world: str
    group: str
    effect: str  # empty without an effect
    seed: int

    @property
    def key(self) -> str:
        """The trial as a single word."""
        return f"{self.world}:{self.effect or FAULTLESS}:{self.seed}"


@dataclass(frozen=True)
class Drawn:
    """A drawn record on disk, with the truth on its effect.

    Attributes
    ----------
    folder : Path
        Folder with ``record.csv`` and so on, and ``believed.toml``; they do not contain the truth.
    ratio : float
        Visibility of the effect; 0 for a faultless record.
    shared : list of str
        Other causes with the same shape.
    """

    folder: Path
    ratio: float
    shared: list[str]

    def read(self) -> tuple[list[Record], Drive]:
        """The records, and the model assumed by their user."""
        paths = sorted(self.folder.glob("record*.csv"))
        believed = drive_of(read_parameters(self.folder / "believed.toml"))
        records, model, _ = commanded(read_drive_records(paths), believed)
        return records, model


def drawn(trial: Trial) -> Drawn:
    """Draw a record, or take it from ``out/worlds`` if it was drawn before.

    Raises
    ------
    Unusable
    """
    folder = KEPT / _of_worlds() / trial.key.replace(":", "-")
    told = folder / "told.json"
    if not told.exists():
        part = folder.with_name(folder.name + ".part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        try:
            case = draw_case(trial.world, (trial.effect,) if trial.effect else (), trial.seed)
            write_case(case, part)
            sight = case.sights[0] if case.sights else None
            truth = {"ratio": sight.ratio, "shared": sight.shared} if sight else {}
        except Unusable as reason:
            truth = {"unusable": str(reason)}
        (part / told.name).write_text(json.dumps(truth), encoding="utf-8")
        part.rename(folder)
    truth = json.loads(told.read_text(encoding="utf-8"))
    if "unusable" in truth:
        raise Unusable(truth["unusable"])
    return Drawn(folder, truth.get("ratio", 0.0), truth.get("shared", []))


@cache
def _of_worlds() -> str:
    """A name for records drawn by these worlds."""
    sources = sorted(Path(__file__).with_name("worlds").glob("*.py"))
    return hashlib.sha256(b"".join(s.read_bytes() for s in sources)).hexdigest()[:12]


def truth_of(effect: str) -> str:
    """The name that must be in an answer."""
    return IN_NO_CAUSE if effect in NOT_IN_CATALOGUE else effect


def right_names(effect: str, shared: Sequence[str]) -> set[str]:
    """The true cause, and causes with the same shape in the record."""
    truth = truth_of(effect)
    same = {"parameter_error"} if truth in SYNONYMS.values() else set()
    return {truth, *shared, *same, *(LATE if truth in LATE else ())}


def plan_trials(
    each: int,
    first_seed: int,
    worlds: tuple[str, ...] = tuple(WORLDS),
    at_least: tuple[int, int] = (0, 0),
) -> list[Trial]:
    """The trials, with all worlds and effects alternately.

    Parameters
    ----------
    each : int
        Records of every cause and signal in every world; ten times as many faultless ones, and four
        fifths as many of each effect outside the catalogue.
    first_seed : int
    worlds : tuple of str
    at_least : tuple of int
        Faultless records of every world, and records with effects, as evenly over effects as
        possible.
    """
    placed = []
    for world in worlds:
        causes, outside, signals = effects_of(world)
        kinds = [(CAUSE, name, each) for name in causes]
        kinds += [(OUTSIDE, name, -(-4 * each // 5)) for name in outside]
        kinds += [(SIGNAL, name, each) for name in signals]
        missing = max(at_least[1] - sum(count for *_, count in kinds), 0)
        share, rest = divmod(missing, len(kinds))
        kinds = [(*kind, n + share + (k < rest)) for k, (*kind, n) in enumerate(kinds)]
        kinds.insert(0, (FAULTLESS, "", max(FAULTLESS_EACH * each, at_least[0])))
        for kind, (group, name, count) in enumerate(kinds):
            for k in range(count):
                trial = Trial(world, group, name, first_seed + k)
                placed.append(((k + 0.5) / count, kind, trial))
    return [trial for *_, trial in sorted(placed, key=lambda p: p[:2])]
