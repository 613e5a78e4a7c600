"""The result of `compare`: residuals of models on records, in newtons and metres; its picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from ...orchestration.loop.pictures import COLOURS, DASHES, STYLE, new_figure
from ...orchestration.loop.shown import length, shown_unit
from ...solver.arrays import Mask, Vector
from ...solver.files import write_json

ALL, REST = "all", "rest"
_MOST_POINTS = 6000
_SHOWN = (0.002, 0.998)  # quantiles of a curve at the lower and upper end of a picture
_MEASURED, _REST = "#000000", "#e8e8e8"
_BINS, _LEAST_IN_BIN = 60, 20  # parts of a signal's range, and samples in each that count
_DRAWS = 2000
_FEWEST = 4  # blocks needed for an interval
_NORMAL = 1.96  # quantile of the normal distribution


@dataclass(frozen=True)
class Estimate:
    """A value and its 95 % interval; None if there are too few blocks for an interval."""

    value: float
    interval: tuple[float, float] | None


@dataclass(frozen=True)
class Left:
    """Rms residuals of a model in a part of the motion; None if not known."""

    force: Estimate | None  # missing in the model [N]; at rest, beyond its stiction
    position: Estimate | None  # error of the prediction from the start of each second [m]


@dataclass(frozen=True)
class Gain(Left):
    """Share of the mean square residual of one model that another model removes."""

    model: str
    over: str


@dataclass(frozen=True)
class Traces:
    """Signals shown in the picture, the records end to end, shape (n,) each."""

    time: Vector  # from the first record's start, without the time between records [s]
    x: Vector  # measured, smoothed [m]
    v: Vector  # [m/s]
    required: Vector  # force of the command less mass times acceleration [N]
    rests: Mask
    counted: Mask  # samples at which forces are known
    starts: Mask  # first sample of each second, where the state is set to the recorded state
    left: dict[str, Vector]  # by model: force missing in it [N]
    predicted: dict[str, Vector]  # by model: position predicted from each second's start [m]


@dataclass(frozen=True)
class Compared:
    """Errors of models on records.

    The models are the one ``model`` of a file, or ``prior``, ``adjusted`` and ``corrected`` of a
    diagnosis.
    """

    records: tuple[str, ...]  # their names
    diagnosed: tuple[str, ...]  # if the file comes from a diagnosis: its records
    causes: tuple[str, ...]  # and the causes in ``corrected``
    seconds: float  # length of the records [s]
    friction: float  # rms force required by the motion, where forces are known [N]
    shares: dict[str, float]  # share of time in each part of the motion, see `PARTS`
    models: dict[str, dict[str, Left]]  # by model, and by part of the motion, all of it first
    floor: Left  # due to the noise of the instruments alone
    gains: tuple[Gain, ...]  # of one model over another
    notes: tuple[str, ...]  # warnings
    traces: Traces

    @property
    def says(self) -> str:
        """The result in a sentence."""
        *_, (name, parts) = self.models.items()
        whole, who = parts[ALL], "the model" if name == "model" else f"the {name} model"
        words = "no force can be computed"
        if whole.force:
            share = 100 * whole.force.value / self.friction
            words = (
                f"{who} leaves {whole.force.value:.2g} N rms of a friction of "
                f"{self.friction:.3g} N rms ({share:.2g} %)"
            )
        if whole.position:
            drift = length(whole.position.value)
            words += f"; its position drifts {drift} rms within a second"
        return words

    def to_dict(self) -> dict[str, Any]:
        """Content of ``compare.json``."""

        def numbers(found: Left, force: str = "_N", position: str = "_m") -> dict[str, Any]:
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
                name: {part: numbers(found) for part, found in parts.items()}
                for name, parts in self.models.items()
            },
            "floor": numbers(self.floor),
            "gains": [{"model": g.model, "over": g.over, **numbers(g, "", "")} for g in self.gains],
            "notes": list(self.notes),
        }

    def save(self, folder: Path | str) -> None:
        """Write ``compare.json`` into `folder`; raises OSError if it cannot be written."""
        write_json(Path(folder) / "compare.json", self.to_dict())


def compare_figure(found: Compared) -> Any:
    """Error of the position and the force over time, and friction over velocity."""
    import matplotlib as mpl

    t = found.traces
    begins_again = np.append(t.starts[1:], False)
    with mpl.rc_context(STYLE):
        figure, ((off, force, over_velocity),) = new_figure(1, 3, (18, 5.5))
        off.sharex(force)
        figure.suptitle(found.says[0].upper() + found.says[1:], fontsize=12)
        errors = {n: x - t.x for n, x in t.predicted.items()}
        size, unit = shown_unit(np.concatenate([*errors.values(), np.zeros(1)]), "m")
        force.plot(t.time, t.required, color=_MEASURED, lw=1.2, label="required by the motion")
        some = np.flatnonzero(t.counted)
        some = some[:: max(1, len(some) // _MOST_POINTS)]
        look = {"ms": 2.5, "color": COLOURS[5], "label": "record, while moving", "rasterized": True}
        over_velocity.plot(1e3 * t.v[some], t.required[some], ".", **look)
        for k, (name, left) in enumerate(t.left.items()):
            label = name if name == "model" else f"{name} model"
            style = {"color": COLOURS[(1, 4, 0)[k]], "ls": DASHES[k], "lw": 1.3, "label": label}
            if name in errors:
                off.plot(t.time, np.where(begins_again, np.nan, size * errors[name]), **style)
            force.plot(t.time, t.required - left, **style)
            v, friction = binned(t.v, t.required - left, t.counted, alike=True)
            over_velocity.plot(1e3 * v, friction, **{**style, "lw": 2.0})
        grey = "; grey: at rest" if t.rests.any() else ""
        off.set_title("Error of the position, predicted each second", loc="left")
        off.set(ylabel=f"predicted minus measured [{unit}]", xlabel=f"time [s]{grey}")
        force.set_title("Force against the motion", loc="left")
        force.set(ylabel="force [N]", xlabel="time [s]")
        over_velocity.set_title("Friction over velocity", loc="left")
        over_velocity.set(xlabel="velocity [mm/s]", ylabel="friction [N]")
        low, high = np.quantile(t.required, _SHOWN)  # a jump of friction makes few samples large
        room = 0.1 * max(high - low, 1e-9)
        force.set_ylim(low - room, high + room)
        over_velocity.sharey(force)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], t.rests, [0]])))
        for begin, end in zip(t.time[edges[::2]], t.time[edges[1::2] - 1], strict=True):
            for axes in (off, force):
                axes.axvspan(begin, end, color=_REST, lw=0, zorder=0)
        known = force.get_legend_handles_labels()
        figure.legend(*known, loc="outside lower left", ncols=4, fontsize=10)
        over_velocity.legend(loc="upper left", fontsize=10)
    return figure


def binned(x: Vector, y: Vector, keep: Mask, alike: bool = False) -> tuple[Vector, Vector]:
    """Means of y over parts of the range of x, NaN for parts with almost no samples.

    The parts have equal width or, with `alike`, equal numbers of samples, for speeds held constant.
    """
    if not np.any(keep) or np.ptp(x[keep]) == 0:
        return np.array([np.nan]), np.array([np.nan])
    if alike:
        order = np.flatnonzero(keep)[np.argsort(x[keep], kind="stable")]
        parts = np.array_split(order, min(2 * _BINS, max(1, len(order) // _LEAST_IN_BIN)))
        return np.array([x[k].mean() for k in parts]), np.array([y[k].mean() for k in parts])
    count, edges = np.histogram(x[keep], _BINS)
    total, _ = np.histogram(x[keep], edges, weights=y[keep])
    mean = np.where(count >= _LEAST_IN_BIN, total / np.maximum(count, 1), np.nan)
    return 0.5 * (edges[1:] + edges[:-1]), mean


# -- intervals -----------------------------------------------------------------------------------


class Blocks:
    """Signals cut into blocks.

    Neighbouring blocks are drawn together, as many as the cube root of the number of blocks,
    because an effect longer than a block is no new evidence. A few blocks scatter less than the
    population, so the interval is widened as in Student's distribution.

    Parameters
    ----------
    ends : sequence of int
        Ends of the blocks among n samples: 0, ..., n.
    """

    def __init__(self, ends: Sequence[int]) -> None:
        self._starts = np.array(ends[:-1])
        self._blocks = len(self._starts)
        together = max(round(self._blocks ** (1 / 3)), 1)
        draws = (_DRAWS, -(-self._blocks // together))
        first = np.random.default_rng(0).integers(0, self._blocks, draws)
        drawn = (first[:, :, None] + np.arange(together)) % self._blocks
        self._drawn = drawn.reshape(_DRAWS, -1)
        independent = self._blocks / together
        free = max(independent - 1.0, 1.0)
        self._wider = float(student.ppf(0.975, free)) / _NORMAL * math.sqrt(independent / free)

    def rms(self, values: Vector, counted: Mask | None = None) -> Estimate:
        """Root mean square of values, shape (n,), over the counted samples."""
        mask = np.ones(len(values), dtype=bool) if counted is None else counted
        found = self._ratio(values**2 * mask, mask.astype(float))
        ends = found.interval and (math.sqrt(found.interval[0]), math.sqrt(found.interval[1]))
        return Estimate(math.sqrt(found.value), ends)

    def gain(self, before: Vector, after: Vector, counted: Mask | None = None) -> Estimate:
        """Share by which the mean square falls from `before` to `after`, shape (n,)."""
        mask = np.ones(len(before), dtype=bool) if counted is None else counted
        left = self._ratio(after**2 * mask, before**2 * mask)
        ends = left.interval and (1.0 - left.interval[1], 1.0 - left.interval[0])
        return Estimate(1.0 - left.value, ends)

    def _ratio(self, above: Vector, below: Vector) -> Estimate:
        """Ratio of the sums of two arrays of non-negative values, each shape (n,)."""
        tops, bottoms = (np.add.reduceat(values, self._starts) for values in (above, below))
        top, bottom = float(tops.sum()), float(bottoms.sum())
        if top == 0.0 or bottom == 0.0:
            return Estimate(0.0 if bottom else 1.0, None)
        if min(np.count_nonzero(tops), np.count_nonzero(bottoms)) < _FEWEST:
            return Estimate(top / bottom, None)
        up, down = (sums[self._drawn].sum(axis=1) for sums in (tops, bottoms))
        kept = (up > 0.0) & (down > 0.0)
        middle = math.log(top / bottom)
        quantiles = np.quantile(np.log(up[kept] / down[kept]), [0.025, 0.975])
        low, high = middle + self._wider * (quantiles - middle)
        return Estimate(top / bottom, (math.exp(low), math.exp(high)))
