"""The result of a diagnosis: errors, causes, their certainty, and the next experiment."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from ...solver.files import write_atomically
from .causes import CAUSES
from .drive import Drive
from .experiment_motions import Motion

NONE, EXPLAINED, PARTLY, UNEXPLAINED = "none", "explained", "partly", "unexplained"
UNDECIDED = "undecided"
ANSWERED = (NONE, EXPLAINED)
"""Verdicts with exit code 0; with the others it is 1."""


@dataclass(frozen=True)
class Level:
    """A residual in the two domains.

    Attributes
    ----------
    force : float
        Root mean square, at frequencies at which the record gives forces [N].
    position : float or None
        Root mean square error of the prediction from the start of each second [m], if known.
    """

    force: float
    position: float | None


def holds(gain_interval: tuple[float, float], before: Level, after: Level) -> bool:
    """Whether the corrected model is certainly better on held-out data than the model without it.

    Parameters
    ----------
    gain_interval : tuple of float
        95 % interval of the removed share of the mean square in force.
    before, after : Level
        Residual on held-out data without and with the causes found.
    """
    better = gain_interval[0] > 0.0
    if before.position is None or after.position is None:
        return better
    return better and after.position <= before.position


@dataclass(frozen=True)
class SuspectFound:
    """One member of a set.

    Attributes
    ----------
    name, says : str
    probability : float
        Probability among all hypotheses.
    parameters : mapping of str to float
        Its values, SI; empty for a suspect outside the catalogue.
    intervals : mapping of str to (float, float)
        95 % intervals, computed by leaving out one block of the records at a time.
    units : mapping of str to str
    force : float
        Its rms effect on a balance of forces, or of voltages
        converted to a force [N].
    of_friction : float
        `force` as a share of the friction.
    confirm : str
        Experiment that would confirm it.
    """

    name: str
    says: str
    probability: float
    parameters: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    units: Mapping[str, str]
    force: float
    of_friction: float
    confirm: str


@dataclass(frozen=True)
class FoundCause(SuspectFound):
    """A suspect that is included in the model.

    Attributes
    ----------
    certain : bool
        Whether it is named; otherwise it is only the most probable one.
    gain_heldout : float
        Share of the mean square of the force residual that it removes, on data not used
        to select or fit it, with all other causes included.
    gain_interval : tuple of float
        95 % interval, by resampling the seconds of the record.
    gain_alone : float
        The same share without other causes.
    before, after : float
        Force residual on held-out data without and with it [N].
    """

    certain: bool
    gain_heldout: float
    gain_interval: tuple[float, float]
    gain_alone: float
    before: float
    after: float


@dataclass(frozen=True)
class NextExperiment:
    """The next experiment.

    Attributes
    ----------
    says : str
        Purpose.
    motion : Motion
        Motion of the machine.
    """

    says: str
    motion: Motion


@dataclass(frozen=True)
class Curves:
    """Signals for pictures, records end to end, shape (n,) each.

    Attributes
    ----------
    time, record : ndarray
        Time within each record [s], and number of the record.
    x, v : ndarray
        Position [m] and velocity [m/s].
    force, predicted : ndarray
        Friction and all other opposing forces, by the record and by the prior model [N].
    before, after : ndarray
        Force residual of the prior and of the corrected model [N].
    position_before, position_after : ndarray
        Position residual of the same models, the corrected one held out [m]; NaN if not known.
    cause : ndarray
        Force of the named causes together [N].
    shape : ndarray
        Force of the residual without a known cause [N]; NaN where forces are not known.
    telling : ndarray of bool
        Samples at which forces are known.
    """

    time: Vector
    record: npt.NDArray[np.int64]
    x: Vector
    v: Vector
    force: Vector
    predicted: Vector
    before: Vector
    after: Vector
    position_before: Vector
    position_after: Vector
    cause: Vector
    shape: Vector
    telling: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Diagnosis:
    """Result of a study.

    Attributes
    ----------
    verdict : {"none", "explained", "partly", "unexplained", "undecided"}
    where : str
        Size of the residual, and the motion at which it occurs, in a sentence.
    floor, baseline_residual, adjusted_residual, final_residual : Level
        Residual of noise; of the prior model; with values adjusted within their tolerances; with
        the causes. The last two are on held-out data.
    left_of_friction : float
        Final residual on held-out data, as a share of the friction along the records. It is the
        residual of the force from the voltage, or the difference between voltage and current,
        whichever is larger.
    unseen : float
        Largest fault that these records would not show, as a share of the friction: twice the
        noise, or the whole final residual.
    gain_interval : tuple of float
        95 % interval of the removed share of the adjusted residual's mean square in force.
    held_out : str
        What was held out, one at a time: "4 laps", "5 parts".
    causes : tuple of FoundCause
        Included causes from the catalogue, and errors of recorded signals, in the order in which
        they were found.
    suspects : tuple of SuspectFound
        Other possible causes, in addition to or instead of those, the most probable first. Together
        they contain the true cause in 95 of 100 records like those of the calibration.
    alternatives : mapping of str to tuple of str
        By included cause that is not certain: suspects that explain the data as well in its place,
        if only noise is left.
    unnamed : tuple of str
        How a residual without a known cause varies.
    next_experiment : NextExperiment or None
    prior, adjusted, corrected : Drive
        The prior model; with values adjusted within their tolerances and no cause; with the values
        fitted together with the causes.
    command : {"voltage", "current", "force"}
        Kind of the records' `u`.
    command_shift : float
        Time by which the command acts before its stamp, in sampling intervals.
    adjustments : mapping of str to float
        Relative changes of the prior values.
    noise : mapping of str to float
        Root mean square residual of each balance due to noise [N].
    notes : tuple of str
        Warnings.
    """

    verdict: str
    where: str
    floor: Level
    baseline_residual: Level
    adjusted_residual: Level
    final_residual: Level
    left_of_friction: float
    unseen: float
    gain_interval: tuple[float, float]
    held_out: str
    causes: tuple[FoundCause, ...]
    suspects: tuple[SuspectFound, ...]
    alternatives: Mapping[str, tuple[str, ...]]
    unnamed: tuple[str, ...]
    next_experiment: NextExperiment | None
    prior: Drive
    adjusted: Drive
    corrected: Drive
    command: str
    command_shift: float
    adjustments: Mapping[str, float]
    noise: Mapping[str, float]
    records: tuple[str, ...]
    curves: Curves
    seconds: float
    notes: tuple[str, ...] = field(default_factory=tuple)

    def to_dict(self) -> dict[str, Any]:
        """Content of ``diagnosis.json``."""
        return {f.name: _plain(getattr(self, f.name)) for f in fields(self) if f.name not in _APART}

    def found(self) -> list[tuple[str, dict[str, float]]]:
        """Names and values of the plant's causes, as input of `with_causes`."""
        return [(c.name, dict(c.parameters)) for c in self.causes if c.name in CAUSES]

    def save(self, folder: Path) -> None:
        """Write ``diagnosis.json``, and the command file of the next experiment, if there is one.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"
        write_atomically(folder / "diagnosis.json", text.encode())
        if self.next_experiment is not None:
            self.next_experiment.motion.save(folder)


_APART = ("prior", "adjusted", "corrected", "command", "command_shift", "curves")
"""Fields of a `Diagnosis` that are written to other files."""


def _plain(value: Any) -> Any:
    """JSON form of a value; levels have their units."""
    if isinstance(value, Level):
        return {"force_N": value.force, "position_m": value.position}
    if isinstance(value, Motion):
        return value.to_dict()
    if is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(v) for name, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value


def names_of(causes: Sequence[SuspectFound]) -> str:
    """Names of the causes, for sentences."""
    return ", ".join(c.name for c in causes) or "no cause"
