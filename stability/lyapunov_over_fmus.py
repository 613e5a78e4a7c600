"""Lyapunov exponents of a closed loop of two FMUs, by name or by file."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..orchestration.loop.loop import Loop
from ..orchestration.loop.whole_loop import held_loop_kernel
from ..solver.errors import UserError
from ..solver.spectrum import Spectrum
from .fmu_parts import opened_parts
from .loop_lyapunov import loop_lyapunov
from .lyapunov import SAMPLES, LyapunovRun, Watching
from .signal_motion import signal_motion
from .tangents_over_fmus import ACCURACY, TangentRun

FINER = 0.1  # of the accuracy of the tangents, with half the step: the change is the error


def loop_lyapunov_over_fmus(
    loop: Loop, progress: Callable[[str], None] | None = None
) -> LyapunovRun:
    """Exponents of a closed loop from its FMUs and their master.

    For two parts with equations, the errors of the exponents are their differences from those of
    one solver, and the verdict comes from the equations, whose motion is computed far beyond
    `stop`. A loop with an FMU file has no equations: the errors are the changes by a finer run, the
    verdict comes from the signals until the end of the run, and no limits are known.

    Parameters
    ----------
    loop : Loop
        With a communication step. Its plant has tangents; a controller without tangents is probed.
    progress : function of str, optional

    Raises
    ------
    UserError
        If this is not possible for the loop.
    FmuError, CouplingError, StepFailed
        If a file is not an FMU that can run here, or the parts do not fit or reject their values.
    """
    stop, step, known = loop.stop, loop.step, None
    assert step is not None
    if loop.plant.has_equations and loop.controller.has_equations:
        if held_loop_kernel(loop.plant.name, loop.controller.name).sample_time:
            raise UserError(
                f"{loop.controller.own_name} is sampled, and FMUs of sampled parts "
                "have no tangents; use the equations, --via model"
            )
        known = loop_lyapunov(loop, watching=Watching(progress))
    with opened_parts(loop) as parts:
        if progress:
            progress(f"the FMUs over {stop:g} s")
        run = parts.follow(loop, step, ACCURACY)
        method = f"{parts.said()}, {run.method}; {run.accuracy}"
        if known:
            return replace(known, spectrum=_spectrum(run), tighter=known.spectrum, method=method)
        if progress:
            progress(f"the FMUs over {stop:g} s, again with finer steps")
        return LyapunovRun(
            list(run.states),
            _spectrum(run),
            _spectrum(parts.follow(loop, 0.5 * step, FINER * ACCURACY)),
            signal_motion(run, parts.nominal(loop.mapping), run.growth[:, 0]),
            math.nan,
            loop.title,
            f"{method}; finite-time only: without equations the motion is not known beyond "
            f"{stop:g} s",
            loop=loop,
        )


def _spectrum(run: TangentRun) -> Spectrum:
    """The run on a grid of few times; the states of the FMUs are not known."""
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
