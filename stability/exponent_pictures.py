"""Pictures of Lyapunov exponents and their convergence."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..orchestration.loop.pictures import COLOURS, DASHES, STYLE, new_figure

if TYPE_CHECKING:
    from .lyapunov import LyapunovRun

_BITS = 1.0 / math.log(2.0)
_NEUTRAL = "constant for a neutral direction, rising for chaos, falling for rest"


def moved_by(run: LyapunovRun) -> str:
    """How the second run differs, from which the error of the exponents is found."""
    if math.isnan(run.tolerance):
        return "half the step"
    over_fmus = run.loop is not None and run.loop.step is not None
    return "one solver without FMUs" if over_fmus else "a tenth of the tolerance"


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
