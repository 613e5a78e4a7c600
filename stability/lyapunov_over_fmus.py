"""Lyapunov exponents of a closed loop of two FMUs, by name or by file."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..fmus.catalogue import has_equations, name_of
from ..orchestration.parts import label_of
from ..orchestration.whole_loop import held_loop_kernel
from ..solver.spectrum import Spectrum
from ..solver.tape import UnsupportedComponent
from .fmu_parts import ALL, FmuLoop, opened_parts
from .fmu_with_tangents import TangentsImpossible
from .loop_lyapunov import loop_lyapunov
from .lyapunov import SAMPLES, LyapunovRun, NoExponents, Watching
from .signal_motion import signal_motion
from .tangents_over_fmus import ACCURACY, TangentRun

FINER = 0.1  # of the accuracy of the tangents, at half the step: what that moves is the error


def loop_lyapunov_over_fmus(
    loop: FmuLoop, stop: float, step: float, progress: Callable[[str], None] | None = None
) -> LyapunovRun:
    """Exponents of a closed loop from its FMUs and their master.

    Of two parts of the catalogue the errors of the exponents are their distances to those of one
    solver, and the verdict is that of the equations, which follow the motion far beyond `stop`.
    Of a loop with a file there are no equations: the errors are what a finer run moves, the
    verdict is what the signals tell until `stop`, and no limits are known.

    Parameters
    ----------
    loop : FmuLoop
        Its plant has tangents; a controller without is probed.
    stop, step : float
        Length of the motion and communication step [s].

    Raises
    ------
    NoExponents
        If the loop cannot be followed so.
    FmuError, WiringError, StepFailed
        If a file is no FMU that can run here, or the parts do not fit or refuse their values.
    """
    parts_of_loop = loop.plant, loop.controller
    known = None
    if all(map(has_equations, parts_of_loop)):
        if held_loop_kernel(*parts_of_loop).sample_time:
            raise NoExponents(
                f"{name_of(loop.controller)} is sampled, and no FMU has tangents of a sampled "
                "part; use the equations, --via model"
            )
        given = loop.setpoint, loop.plant, loop.plant_values, loop.controller_values
        known = loop_lyapunov(loop.controller, stop, *given, watching=Watching(progress))
    try:
        with opened_parts(*parts_of_loop, ALL) as parts:
            if progress:
                progress(f"the FMUs over {stop:g} s")
            run = loop.followed(parts, stop, step, ACCURACY)
            method = f"{parts.said()}, {run.method}; {run.accuracy}"
            if known:
                return replace(
                    known, spectrum=_spectrum(run), tighter=known.spectrum, method=method
                )
            if progress:
                progress(f"the FMUs over {stop:g} s, once more and finer")
            return LyapunovRun(
                list(run.states),
                _spectrum(run),
                _spectrum(loop.followed(parts, stop, 0.5 * step, FINER * ACCURACY)),
                signal_motion(run, loop.nominal(parts), run.growth[:, 0]),
                math.nan,
                f"{label_of(loop.controller)} on {label_of(loop.plant)}",
                f"{method}; finite-time only: without equations nothing is known beyond {stop:g} s",
            )
    except (TangentsImpossible, UnsupportedComponent) as error:
        raise NoExponents(str(error)) from error


def _spectrum(run: TangentRun) -> Spectrum:
    """The run on a grid of few times; what states the FMUs have is not known."""
    keep = np.unique(np.linspace(0, len(run.time) - 1, SAMPLES + 1).astype(int))
    count = run.growth.shape[1]
    return Spectrum(
        run.time[keep],
        np.full((len(keep), count), np.nan),
        run.growth[keep],
        run.trace[keep],
        np.eye(count),
        0,
        run.stopped,
        run.diverged,
    )
