"""Pictures of Lyapunov exponents and their convergence."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..orchestration.page import COLOURS_OF_PAGES, Line, Picture
from ..orchestration.pictures import COLOURS, DASHES, STYLE, new_figure
from .lyapunov import bars

if TYPE_CHECKING:
    from ..solver.spectrum import Spectrum
    from .lyapunov import LyapunovRun

Vector = npt.NDArray[np.float64]

_BITS = 1.0 / math.log(2.0)
_NEUTRAL = "constant for a neutral direction, rising for chaos, falling for rest"
_TRANSIENT = 0.25  # of the time; a picture hides its estimates at first


def pictures_of_exponents(run: LyapunovRun) -> list[Picture]:
    """Pictures of each exponent over time, with its error if known, for the page of `run`."""
    time, rates = _descending(run.spectrum)
    if not len(time):
        return []
    finer = _descending(run.tighter) if run.tighter is not None else (time[:0], rates[:0])
    known = len(finer[0]) == len(time) and np.allclose(finer[0], time)
    apart = bars(rates, finer[1]) if known else None
    pictures = []
    for k, values in enumerate(rates.T):
        colour = f"c{k % COLOURS_OF_PAGES}"
        lines = [Line(f"exponent {k + 1}", colour, time, values)]
        if apart is not None:
            band = _around(time, values, apart[:, k])
            lines.append(Line("95 % interval", f"{colour} band", *band))
        limits, errors = run.motion.limit, run.motion.limit_error
        if limits is not None and errors is not None and k < len(limits):
            limit, error = _BITS * limits[k], _BITS * errors[k]
            ends = time[[0, -1]]
            lines.append(Line("limit", "level dashed", ends, np.full(2, limit)))
            lines.append(Line("error of the limit", "level band", *_around(ends, limit, error)))
        late = [line.y[line.x >= _TRANSIENT * time[-1]] for line in lines]
        pictures.append(
            Picture(
                f"exponent{k}",
                f"Exponent {k + 1}" + (", the largest" if k == 0 else ""),
                _says(run, k),
                "time [s]",
                "exponent up to now [bits/s]",
                tuple(lines),
                span=_span(np.concatenate(late)),
            )
        )
    drift = (Line("exponent 1 times time", "c0", time, rates[:, 0] * time),)
    what = f"{_NEUTRAL.capitalize()}."
    label = "exponent 1 times time [bits]"
    title = "Whether the largest exponent is zero"
    return [*pictures, Picture("drift", title, what, "time [s]", label, drift)]


def moved_by(run: LyapunovRun) -> str:
    """How the second run differs, from which the error of the exponents is found."""
    if math.isnan(run.tolerance):
        return "half the step"
    over_fmus = run.loop is not None and run.loop.step is not None
    return "one solver without FMUs" if over_fmus else "a tenth of the tolerance"


def _descending(spectrum: Spectrum) -> tuple[Vector, npt.NDArray[np.float64]]:
    """Times and running estimates [bits/s], the largest at the end first."""
    time = spectrum.time[1:]
    rates = spectrum.growth[1:] / (time - spectrum.time[0])[:, None] * _BITS
    return time, rates[:, np.argsort(-rates[-1], kind="stable")] if len(time) else rates


def _around(time: Vector, middle: Any, error: Any) -> tuple[Vector, Vector]:
    """The border of a band: its upper side forwards, then its lower side backwards."""
    high, low = (np.broadcast_to(middle + sign * error, time.shape) for sign in (1, -1))
    keep = np.isfinite(high) & np.isfinite(low)
    return (
        np.concatenate([time[keep], time[keep][::-1]]),
        np.concatenate([high[keep], low[keep][::-1]]),
    )


def _span(values: Vector) -> tuple[float, float] | None:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    low, high = float(finite.min()), float(finite.max())
    more = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    return low - more, high + more


def _says(run: LyapunovRun, k: int) -> str:
    value, error = run.exponents[k] * _BITS, run.error[k] * _BITS
    said = f"{value:.6g} bits/s at the end, "
    said += (
        "its error not known" if np.isnan(error) else f"+- {error:.2g} (95 %, from {moved_by(run)})"
    )
    return f"{said}. The first {_TRANSIENT:.0%} may be outside: a double click shows all."


def convergence_figure(run: LyapunovRun) -> Any:
    """A figure of the running estimates against time, with their limits."""
    import matplotlib as mpl

    time, rates, _ = run.running()
    rates = rates * _BITS
    if not len(time):  # the time for computing was used up before the first estimate
        time, rates = np.zeros(1), np.full((1, rates.shape[1]), np.nan)
    with mpl.rc_context(STYLE):
        figure, ((axes,), (drift,)) = new_figure(2, 1, (8, 7.5))
        for k in range(rates.shape[1]):
            finite = np.isfinite(rates[:, k])
            style: dict[str, Any] = {
                "color": COLOURS[k % len(COLOURS)],
                "ls": DASHES[k % len(DASHES)],
                "label": f"exponent {k + 1}: {rates[-1, k]:.5g} bits/s",
            }
            axes.plot(time[finite], rates[finite, k], **style)
        if run.motion.limit is not None:
            for value in run.motion.limit:
                axes.axhline(value * _BITS, color="#555555", lw=0.8, ls=":")
            axes.plot([], [], color="#555555", lw=0.8, ls=":", label="limits")
        axes.set_yscale("symlog", linthresh=_threshold(rates))
        axes.set_ylabel("exponent up to now [bits/s]")
        axes.set_title(
            f"{run.label}: {run.motion.kind.value}" if run.label else run.motion.kind.value
        )
        axes.legend(loc="upper right", ncols=2)
        first = rates[:, 0] * time
        drift.plot(time, first, color=COLOURS[0])
        drift.set_ylabel("exponent 1 times time [bits]")
        drift.set_title(_NEUTRAL.capitalize())
        drift.set_xlabel("time [s]")
        figure.align_ylabels()
    return figure


def _threshold(rates: Any) -> float:
    """Limit of the linear part of a logarithmic axis: below the smallest last estimate."""
    last = np.abs(rates[-1][np.isfinite(rates[-1])])
    last = last[last > 0.0]
    return float(10.0 ** np.floor(np.log10(last.min()))) if len(last) else 1.0
