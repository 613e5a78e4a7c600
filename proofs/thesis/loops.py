"""Loops of the thesis, simulated with exponents by this program."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.solver.kernel import IntegrationError
from ballscrew.solver.spectrum import follow_returns, follow_tangents
from ballscrew.stability.lyapunov import LyapunovRun, loop_maker, loop_order
from thesis.printed import BITS, SETPOINT, STOP

Figures = dict[str, Any]


Vector = npt.NDArray[np.float64]


SWING = 1e-6  # amplitude in the last two seconds below which the loop is at rest [m]


SEEN = 1e-5  # the same for a reader of a picture of 8 cm [m]


def hats(sigma0: float, sigma1: float) -> dict[str, float]:
    """Parameters of the linearizing controller."""
    return {"sigma0_hat": sigma0, "sigma1_hat": sigma1}


def loop_run(
    controller: str,
    values: dict[str, float] | None = None,
    stop: float = STOP,
    setpoint: float = SETPOINT,
    plant: str = "plant",
) -> Any:
    """One step to a set-point in one solver, on a grid of one millisecond."""
    reference = Reference.constant(setpoint)
    return run_monolithic(Loop(controller, plant, reference, stop, controller_values=values), 1e-3)


def growth(
    controller: str,
    values: dict[str, float] | None,
    stop: float,
    setpoint: float = SETPOINT,
    tolerance: float = 1e-9,
    points: int = 2,
) -> tuple[Vector, Vector]:
    """Times [s] and the largest exponent's estimate times time [bits], by the first tangent."""
    model = loop_maker(Loop(controller, reference=setpoint, controller_values=values))(tolerance)
    first = loop_order(model.kernel)[0]
    frame = np.eye(len(model.x))[[first]]
    run = follow_tangents(model, np.linspace(0.0, stop, points), count=1, frame=frame)
    if run.failure:
        raise IntegrationError(run.failure)
    return run.time, run.growth[:, 0] * BITS


def spectrum_figures(run: LyapunovRun) -> Figures:
    """The part of ``lyapunov.json`` needed here."""
    keep = (
        "time_s", "exponents_bits_per_s", "exponents_error_bits_per_s", "asymptotic_bits_per_s",
        "mean_trace_bits_per_s", "sum_rule_error", "lambda1_times_t_bits", "verdict", "rest",
    )  # fmt: skip
    figures = run.figures()
    return {name: figures[name] for name in keep}


@dataclass(frozen=True)
class End:
    """Motion of a loop in the last two seconds of 20 s, as visible in a picture of the thesis."""

    kind: str  # "diverges", "swings", "stands"
    swing: float  # m to either side
    offset: float  # m from the set-point


def end_of(
    sigma0: float, sigma1: float, controller: str = "iol", setpoint: float = SETPOINT
) -> End:
    """The end of one loop of the plane of Fig. 3.18."""
    model = loop_maker(
        Loop(controller, reference=setpoint, controller_values=hats(sigma0, sigma1))
    )(1e-8)
    x = [s.name for s in model.kernel.states].index("plant_x")
    for start, stop in ((0.0, STOP - 2.0), (STOP - 2.0, STOP)):
        seen = follow_returns(model, start, stop, x, math.inf, 1)
        if seen.diverged:
            return End("diverges", math.inf, math.inf)
        if seen.failure:
            raise IntegrationError(seen.failure)
    swing = float(seen.high[x] - seen.low[x]) / 2.0
    return End("swings" if swing > SWING else "stands", swing, float(model.x[x]) - setpoint)
