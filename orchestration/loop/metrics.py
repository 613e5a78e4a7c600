"""Figures of merit of a closed-loop run."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from ..master.loop_run import LoopRun
from ..master.reference_signal import Reference

Vector = npt.NDArray[np.float64]

BAND = 0.02  # of a step
COARSE = 0.05  # of the largest error: more between two points is noted
PARTS = 8  # of a step, in which the set-point is looked at


@dataclass(frozen=True)
class Metrics:
    """Figures of merit; None if the run does not define one."""

    # largest magnitude of the command that the limit of the plant passes, in its unit; its time [s]
    peak_voltage: float
    peak_voltage_time: float
    # time after which the error stays within 2 % of the step [s]; None if it does not, or if the
    # set-point moves
    settling_time_2pct: float | None
    # largest distance of the block beyond the set-point [m]; None if the set-point moves
    overshoot: float | None
    steady_state_error: float  # set-point minus position at the end [m]
    iae: float  # integral of the absolute error [m*s], trapezoidal
    # root mean square over the run and largest magnitude of set-point minus position [m]; None if
    # the set-point is constant
    rms_error: float | None
    largest_error: float | None

    def to_dict(self) -> dict[str, float | None]:
        return asdict(self)


def units_of_figures(run: LoopRun) -> dict[str, str]:
    """The unit of each figure of a run; where ``x`` and ``u`` have none, those of the axis."""
    x, u = run.units.get("x") or "m", run.units.get("u") or "V"
    residual = max(run.residual_max, key=lambda n: run.residual_max[n], default="u")
    return {
        **dict.fromkeys(("overshoot", "steady_state_error", "rms_error", "largest_error"), x),
        **dict.fromkeys(("peak_voltage_time", "settling_time_2pct"), "s"),
        "peak_voltage": u,
        "iae": f"{x}*s",
        "coupling_residual_max": u if residual == "u" else run.units.get(residual, ""),
    }


def metrics(run: LoopRun, position: str = "x", command: str = "u") -> Metrics:
    """Figures of merit of a run, from all that is known between its points."""
    known = run.between or run
    time, x, goal = known.time, known.outputs[position], known.reference
    voltage = np.minimum(np.abs(known.commands[command]), run.limit)
    peak = int(np.argmax(voltage))
    error = goal - x
    constant = bool(np.all(goal == goal[0]))
    step = float(goal[0] - x[0])
    beyond = (-np.inf, goal[0]) if step > 0.0 else (goal[0], np.inf)
    duration = max(float(time[-1] - time[0]), np.finfo(float).tiny)
    mean_square = float(np.trapezoid(error**2, time)) / duration
    return Metrics(
        peak_voltage=float(voltage[peak]),
        peak_voltage_time=float(time[peak]),
        settling_time_2pct=_settling(time, error, BAND * abs(step)) if constant and step else None,
        overshoot=overshoot(x, *beyond) if constant and step else None,
        steady_state_error=float(error[-1]),
        iae=float(np.trapezoid(np.abs(error), time)),
        rms_error=None if constant else float(np.sqrt(mean_square)),
        largest_error=None if constant else float(np.max(np.abs(error))),
    )


def coarse_notes(run: LoopRun, reference: Reference, position: str = "x") -> tuple[str, ...]:
    """A note if the error may be larger between communication points than at them."""
    if run.between or run.alone or run.stopped or position not in run.outputs or len(run.time) < 3:
        return ()
    time, x, goal = run.time, run.outputs[position], run.reference
    within = time[:-1] + np.linspace(0.0, 1.0, PARTS + 1)[:, None] * np.diff(time)
    factor, offset = run.scale
    inside = factor * reference.on(within.ravel(), 0).reshape(within.shape) + offset
    above = inside - np.maximum(goal[:-1], goal[1:])
    below = np.minimum(goal[:-1], goal[1:]) - inside
    of_parabola = np.abs(np.diff(x, 2)).max() / 8
    most = max(above.max(), below.max(), of_parabola)
    if not most > COARSE * np.abs(goal - x).max():
        return ()
    return (
        f"steps of {np.diff(time).max():g} s are coarse for the figures, which count communication "
        f"points only: between them the error may move by {most:.2g} more; use a smaller --step",
    )


def settled_from(error: Vector, band: float) -> int | None:
    """The first sample from which on an error stays within a band; None if it ends outside."""
    outside = np.flatnonzero(np.abs(error) > band)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return first if first < len(error) else None


def overshoot(position: Vector, low: float, high: float) -> float:
    """Largest distance of a position beyond a range."""
    return float(max(0.0, position.max() - high, low - position.min()))


def _settling(time: Vector, error: Vector, band: float) -> float | None:
    """Time from which on an error stays within a band, with straight lines between samples."""
    k = settled_from(error, band)
    if k is None:
        return None
    if k == 0:
        return float(time[0])
    before, after = abs(error[k - 1]), abs(error[k])
    return float(time[k - 1] + (before - band) / (before - after) * (time[k] - time[k - 1]))
