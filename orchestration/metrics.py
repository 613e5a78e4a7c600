"""Figures of merit of a closed-loop run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from .loop_run import LoopRun

BAND = 0.02


@dataclass(frozen=True)
class Metrics:
    """Figures of merit; None where the run does not define one.

    Attributes
    ----------
    peak_voltage, peak_voltage_time : float
        Largest magnitude of the command, a voltage [V] unless the plant says otherwise, and when
        [s].
    settling_time_2pct : float or None
        Time after which the error stays within 2 % of the step [s]; None if it does not, or if the
        set-point moves.
    overshoot : float or None
        How far the block goes past the set-point [m]; None if the set-point moves.
    steady_state_error : float
        Set-point less position at the end [m].
    iae : float
        Integral of the absolute error [m*s], trapezoidal.
    rms_error, largest_error : float or None
        Root mean square over the run and largest magnitude of set-point less position [m]; None if
        the set-point is constant.
    """

    peak_voltage: float
    peak_voltage_time: float
    settling_time_2pct: float | None
    overshoot: float | None
    steady_state_error: float
    iae: float
    rms_error: float | None
    largest_error: float | None

    def to_dict(self) -> dict[str, float | None]:
        return asdict(self)


def units_of_figures(units: Mapping[str, str]) -> dict[str, str]:
    """The unit of each figure of a run, from those of its signals, or the axis' where none is said.

    Parameters
    ----------
    units : mapping of str to str
        Of ``x`` and ``u``, as `LoopRun.units`.
    """
    x, u = units.get("x") or "m", units.get("u") or "V"
    return {
        "peak_voltage": u,
        "peak_voltage_time": "s",
        "settling_time_2pct": "s",
        "overshoot": x,
        "steady_state_error": x,
        "iae": f"{x}*s",
        "rms_error": x,
        "largest_error": x,
        "coupling_residual_max": u,
    }


def metrics(run: LoopRun, position: str = "x", command: str = "u") -> Metrics:
    """Compute the figures of merit of a run.

    Parameters
    ----------
    run : LoopRun
    position, command : str
        Names of the controlled output and of the command.
    """
    time, x, goal = run.time, run.outputs[position], run.reference
    voltage = np.abs(run.commands[command])
    peak = int(np.argmax(voltage))
    error = goal - x
    constant = bool(np.all(goal == goal[0]))
    step = float(goal[0] - x[0])
    duration = max(float(time[-1] - time[0]), np.finfo(float).tiny)
    mean_square = float(np.trapezoid(error**2, time)) / duration
    return Metrics(
        peak_voltage=float(voltage[peak]),
        peak_voltage_time=float(time[peak]),
        settling_time_2pct=_settling(time, error, abs(step)) if constant and step else None,
        overshoot=float(max(0.0, np.max(-error * np.sign(step)))) if constant and step else None,
        steady_state_error=float(error[-1]),
        iae=float(np.trapezoid(np.abs(error), time)),
        rms_error=None if constant else float(np.sqrt(mean_square)),
        largest_error=None if constant else float(np.max(np.abs(error))),
    )


def _settling(
    time: npt.NDArray[np.float64], error: npt.NDArray[np.float64], step: float
) -> float | None:
    outside = np.flatnonzero(np.abs(error) > BAND * step)
    if not len(outside):
        return float(time[0])
    k = int(outside[-1])
    if k + 1 == len(time):
        return None
    before, after = abs(error[k]), abs(error[k + 1])
    share = (before - BAND * step) / (before - after)
    return float(time[k] + share * (time[k + 1] - time[k]))
