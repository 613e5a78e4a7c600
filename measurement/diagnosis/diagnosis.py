"""The result of a diagnosis: errors, causes, their certainty, and the next experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Mask, Vector
from ...solver.files import write_json
from .causes import CAUSES
from .drive import Drive

if TYPE_CHECKING:
    from .experiment import NextExperiment

NONE, EXPLAINED, PARTLY, UNEXPLAINED = "none", "explained", "partly", "unexplained"
UNDECIDED = "undecided"
ANSWERED = (NONE, EXPLAINED)
"""Verdicts with exit code 0; with the others it is 1."""


@dataclass(frozen=True)
class Level:
    """A residual in the two domains, root mean square."""

    force: float  # at frequencies at which the record gives forces [N]
    position: float | None  # of the prediction from the start of each second, if known [m]


def holds(gain_interval: tuple[float, float], before: Level, after: Level) -> bool:
    """Whether the corrected model is certainly better on held-out data than the one before.

    The lower end of the removed share of the mean square in force is above zero, and the residual
    in position does not grow.
    """
    better = gain_interval[0] > 0.0
    if before.position is None or after.position is None:
        return better
    return better and after.position <= before.position


@dataclass(frozen=True)
class Finding:
    """A cause that is built in, or one that may be true in its place or beside it."""

    name: str
    says: str
    alike: tuple[str, ...]  # others of its entry of the catalogue that explain as much: one answer
    score: float  # gain in the log-likelihood of held-out blocks [nats]
    lead: float  # score less that of the best one of another entry [nats]
    share: float  # removed share of the squares on held-out blocks, when it was found
    parameters: Mapping[str, float]  # its values, SI; empty for one outside the catalogue
    intervals: Mapping[str, tuple[float, float]]  # 95 %, by leaving out one block at a time
    units: Mapping[str, str]
    force: float  # rms effect on a balance of forces, or of voltages converted to a force [N]
    of_friction: float  # the same as a share of the friction
    confirm: str  # experiment that would confirm it
    certain: bool  # whether it is named
    gain_heldout: float  # share that it removes from its balance, beside the other causes
    gain_interval: tuple[float, float]  # 90 %, by leaving out one block at a time
    before: float  # residual of that balance on held-out data without it [N]
    after: float  # and with it [N]


@dataclass(frozen=True)
class Curves:
    """Signals along the records, end to end, shape (n,) each."""

    time: Vector  # within each record [s]
    record: npt.NDArray[np.int64]  # number of the record
    x: Vector  # [m]
    v: Vector  # [m/s]
    force: Vector  # friction and all other opposing forces, by the record [N]
    predicted: Vector  # the same by the prior model [N]
    before: Vector  # force residual of the prior model [N]
    after: Vector  # force residual of the corrected model [N]
    position_before: Vector  # position residual of the prior model; NaN if not known [m]
    position_after: Vector  # position residual of the corrected model, held out [m]
    cause: Vector  # force of the named causes together [N]
    shape: Vector  # force without a known cause; NaN where forces are not known [N]
    telling: Mask  # samples at which forces are known


@dataclass(frozen=True)
class Diagnosis:
    """Errors of a model on records, their causes, and the next experiment.

    Of the residuals, `baseline_residual` is that of the prior model, `adjusted_residual` that with
    values adjusted within their tolerances, `final_residual` that with the causes; the last two are
    on held-out data.
    """

    verdict: str  # "none", "explained", "partly", "unexplained" or "undecided"
    floor: Level  # residual of noise
    baseline_residual: Level
    adjusted_residual: Level
    final_residual: Level
    friction: float  # root mean square along the records [N]
    left_of_friction: float  # final residual, or voltage against current, as a share of it
    unseen: float  # largest fault that would not be seen: twice the noise, or what is left
    gain_interval: tuple[float, float]  # 90 %, of the removed share of the squares
    held_out: str  # what was held out, one at a time: "4 laps", "5 parts"
    causes: tuple[Finding, ...]  # included, also errors of signals, in the order of finding
    suspects: tuple[Finding, ...]  # in addition to or instead of those, the best one first
    alternatives: Mapping[str, tuple[str, ...]]  # suspects that explain as much as a cause
    unnamed: tuple[str, ...]  # how a residual without a known cause varies
    next_experiment: NextExperiment | None
    prior: Drive
    adjusted: Drive  # within the tolerances, and no cause
    corrected: Drive  # values fitted together with the causes
    command: str  # kind of the records' `u`
    command_shift: float  # the command acts before its stamp by this, in sampling intervals
    adjustments: Mapping[str, float]  # relative changes of the prior values
    noise: Mapping[str, float]  # rms residual of each balance due to noise [N]
    records: tuple[str, ...]
    curves: Curves
    seconds: float  # computing time [s]
    notes: tuple[str, ...] = field(default_factory=tuple)  # warnings

    @property
    def confirmed(self) -> bool:
        """Whether what is built in is certainly better on held-out data."""
        levels = self.adjusted_residual, self.final_residual
        return not self.causes or holds(self.gain_interval, *levels)

    def to_dict(self) -> dict[str, Any]:
        """Content of ``diagnosis.json``."""
        return {f.name: _plain(getattr(self, f.name)) for f in fields(self) if f.name not in _APART}

    def found(self) -> list[tuple[str, dict[str, float]]]:
        """Names and values of the plant's causes, as input of `with_causes`."""
        return [(c.name, dict(c.parameters)) for c in self.causes if c.name in CAUSES]

    def save(self, folder: Path) -> None:
        """Write ``diagnosis.json`` and the commands of the next experiment; see `write_json`."""
        write_json(folder / "diagnosis.json", self.to_dict())
        if self.next_experiment is not None:
            self.next_experiment.motion.save(folder)


_APART = ("prior", "adjusted", "corrected", "command", "command_shift", "curves")
"""Fields of a `Diagnosis` that are written to other files."""


def _plain(value: Any) -> Any:
    """JSON form of a value; levels have their units."""
    if isinstance(value, Level):
        return {"force_N": value.force, "position_m": value.position}
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(v) for name, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value
