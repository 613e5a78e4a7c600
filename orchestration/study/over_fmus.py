"""Some runs of a study repeated over FMUs with the master, for comparison."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from ...solver.kernel import CONTROLLER, DEFAULT_TOLERANCE, PLANT
from ..loop.closed_loop import run_closed_loop
from ..loop.loop import Loop
from .loop import AnyLoop, of_side

if TYPE_CHECKING:
    from .plan import Duty

SHARE = 20  # one run in this many, drawn at random
ALLOWED = 10.0  # times the effect of units in the last place, or of a tenth of the tolerance
TRUSTED = "trusted"  # the master's verdict on a coupling that converged
ROUND_OFF = 1e-13  # m, of positions in the size of a metre
COMPARED = ("rms_error", "peak_error", "failed")
"""Figures of a run that the table has; two runs' errors differ by no more than their positions."""
TOLERANCES = 40  # number of tolerances for the repetition of a run that seems to differ


@dataclass(frozen=True)
class FmuCheck:
    """One run over FMUs, compared with that of the study."""

    apart: float  # largest distance of the two positions [m]
    # ten times the uncertainty of the study's own run: its largest change by one unit in the last
    # place of any parameter of the plant, by a tenth of the solver's tolerance, or by that of the
    # FMUs' own solvers [m]; if that is less than `apart`, also by tolerances in between. At least
    # the master's own estimate of its coupling error
    allowed: float
    # whether the position over FMUs is that near, and the figures of the table agree with the run
    # over FMUs
    agrees: bool
    # the master's verdict on its coupling: ``trusted`` or ``not converged``; empty if the study's
    # own run failed, so that none was made over FMUs
    coupling: str = ""
    reason: str = ""  # reason of this verdict


def check_over_fmus(
    loop: AnyLoop,
    fmus: tuple[str, str],
    values: Mapping[str, float],
    duty: Duty,
    tolerance: float,
    table: Mapping[str, float],
) -> FmuCheck:
    """Run one loop over FMUs and compare.

    `fmus` are the paths of plant and controller, `values` by the loop's names, `tolerance` and
    `table`, the figures `COMPARED`, those of the study's run.
    """
    reference = duty.signal()
    own = loop.run(values, reference, duty.stop, tolerance)
    if own.stopped:  # a failed run is reported as such already
        return FmuCheck(math.nan, math.nan, bool(table["failed"]))

    def moved(others: Iterable[tuple[Mapping[str, float], float]]) -> float:
        runs = (loop.run(v, reference, duty.stop, t) for v, t in others)
        apart_of = (np.abs(o.position - own.position).max() for o in runs if not o.stopped)
        return float(max(apart_of, default=math.inf))

    # all of them: one alone may by chance leave every count of an encoder unchanged
    finest = min(tolerance / 10, DEFAULT_TOLERANCE)  # the latter is the FMUs' own
    finer = ((values, t) for t in {tolerance / 10, finest})
    uncertain = moved(chain(((v, tolerance) for v in _nearest(loop, values)), finer))
    stop, step = float(own.time[-1]), float(own.time[1])
    over = Loop(
        controller=fmus[1],
        plant=fmus[0],
        reference=reference,
        stop=stop,
        step=step,
        plant_values=of_side(PLANT, values),
        controller_values=of_side(CONTROLLER, values),
        isolate=False,
    )
    found = run_closed_loop(over).run
    position = np.interp(own.time, found.time, found.outputs["x"])
    apart = float(np.abs(position - own.position).max())
    if apart > ALLOWED * uncertain:  # all of them may have no effect by chance
        between = np.geomspace(finest, tolerance, TOLERANCES)
        uncertain = max(uncertain, moved((values, float(t)) for t in between))
    allowed = ALLOWED * max(uncertain, ROUND_OFF)
    verdict = found.verdict
    allowed = max(allowed, float(verdict.error_estimate["x"]))
    error = own.reference - position
    figures = {"rms_error": np.sqrt(np.mean(error**2)), "peak_error": np.abs(error).max()}
    off = max(abs(table[name] - figure) for name, figure in figures.items())
    agrees = apart <= allowed and bool(off <= allowed)  # NaN is not
    return FmuCheck(apart, allowed, agrees, verdict.word, verdict.reason)


def _nearest(loop: AnyLoop, values: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """Yield the values with one parameter of the plant after the other at its next number."""
    for p in loop.parameters:
        if p.name.startswith(PLANT):
            value = values.get(p.name, p.default)
            if value:
                yield {**values, p.name: float(np.nextafter(value, np.inf))}
