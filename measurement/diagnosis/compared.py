"""The result of `compare`: residuals of models on records, in newtons and metres."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...solver.arrays import Mask, Vector
from ...solver.files import write_json
from .blocks import Estimate

MODEL, PRIOR, ADJUSTED, CORRECTED = "model", "prior", "adjusted", "corrected"
ALL, REST = "all", "rest"


@dataclass(frozen=True)
class Left:
    """Rms residuals of a model in a part of the motion; None if not known.

    Attributes
    ----------
    force : Estimate or None
        Force missing in the model [N]; at rest, the force beyond its stiction.
    position : Estimate or None
        Error of the position predicted from the state at the start of each second [m].
    """

    force: Estimate | None
    position: Estimate | None


@dataclass(frozen=True)
class Gain(Left):
    """Share of the mean square residual of one model that another model removes."""

    model: str
    over: str


@dataclass(frozen=True)
class Traces:
    """Signals shown in the picture, the records end to end, shape (n,) each.

    Attributes
    ----------
    time : ndarray
        Time from the first record's start, without the time between records [s].
    x, v : ndarray
        Measured, smoothed [m], [m/s].
    required : ndarray
        Force of the command less mass times acceleration: friction and all other forces that oppose
        motion in +x [N].
    rests, counted : ndarray of bool
        Samples at rest, and samples at which forces are known.
    starts : ndarray of bool
        First sample of each second, where the state is set to the recorded state.
    left : dict of str to ndarray
        By model: force missing in the model [N].
    predicted : dict of str to ndarray
        By model: position predicted from each second's start [m].
    curves : dict of str to two ndarrays
        By model: velocities [m/s] and friction in steady sliding [N]; for a model with causes, the
        mean of its force along the records.
    """

    time: Vector
    x: Vector
    v: Vector
    required: Vector
    rests: Mask
    counted: Mask
    starts: Mask
    left: dict[str, Vector]
    predicted: dict[str, Vector]
    curves: dict[str, tuple[Vector, Vector]]


@dataclass(frozen=True)
class Compared:
    """Errors of models on records.

    Attributes
    ----------
    records : tuple of str
        Their names.
    diagnosed, causes : tuple of str
        If the file comes from a diagnosis: its records, and the causes included in
        ``corrected``.
    seconds : float
        Length of the records [s].
    friction : float
        Root mean square of the force required by the motion, over samples where forces are known
        [N].
    shares : dict of str to float
        Share of time in each part of the motion, see `PARTS`.
    models : dict of str to dict of str to Left
        By model and by part of the motion, all of it first: the one ``model`` of the file, or
        ``prior``, ``adjusted`` and ``corrected`` of a diagnosis.
    floor : Left
        Residuals due to instrument noise alone.
    gains : tuple of Gain
        Gains of one model over another.
    notes : tuple of str
        Warnings.
    traces : Traces
    """

    records: tuple[str, ...]
    diagnosed: tuple[str, ...]
    causes: tuple[str, ...]
    seconds: float
    friction: float
    shares: dict[str, float]
    models: dict[str, dict[str, Left]]
    floor: Left
    gains: tuple[Gain, ...]
    notes: tuple[str, ...]
    traces: Traces

    @property
    def says(self) -> str:
        """The result in a sentence."""
        *_, (name, parts) = self.models.items()
        whole, who = parts[ALL], "the model" if name == MODEL else f"the {name} model"
        words = "no force can be computed"
        if whole.force:
            share = 100 * whole.force.value / self.friction
            words = (
                f"{who} leaves {whole.force.value:.2g} N rms of a friction of "
                f"{self.friction:.3g} N rms ({share:.2g} %)"
            )
        if whole.position:
            words += f"; its position drifts {length(whole.position.value)} rms within a second"
        return words

    def to_dict(self) -> dict[str, Any]:
        """Content of ``compare.json``."""

        def told(found: Left, force: str = "_N", position: str = "_m") -> dict[str, Any]:
            both = (("force", found.force, force), ("position", found.position, position))
            return {
                name: e and {f"value{u}": e.value, f"interval{u}": e.interval and [*e.interval]}
                for name, e, u in both
            }

        return {
            "says": self.says,
            "records": list(self.records),
            "diagnosed": list(self.diagnosed),
            "causes": list(self.causes),
            "seconds": self.seconds,
            "friction_N": self.friction,
            "shares": self.shares,
            "models": {
                name: {part: told(found) for part, found in parts.items()}
                for name, parts in self.models.items()
            },
            "floor": told(self.floor),
            "gains": [{"model": g.model, "over": g.over, **told(g, "", "")} for g in self.gains],
            "notes": list(self.notes),
        }

    def save(self, folder: Path | str) -> None:
        """Write ``compare.json`` into `folder`; raises OSError if it cannot be written."""
        write_json(Path(folder) / "compare.json", self.to_dict())


def length(metres: float) -> str:
    """A length as text, in mm or um."""
    return f"{1e3 * metres:.2g} mm" if metres >= 1e-4 else f"{1e6 * metres:.2g} um"
