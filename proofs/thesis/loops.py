"""Loops of the thesis run by this program; each is run once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from ballscrew.controllers.nctf import STEP_VOLTAGE
from ballscrew.orchestration.loop.closed_loop import metrics
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.plant.axis import axis
from ballscrew.solver.arrays import Vector
from ballscrew.solver.kernel import IntegrationError, Model
from ballscrew.solver.spectrum import follow_returns, follow_tangents
from ballscrew.solver.stored import stored_kernel
from ballscrew.stability.lyapunov import LyapunovRun, loop_lyapunov, loop_maker, loop_order
from thesis import printed as th

SWING = 1e-6  # amplitude in the last two seconds below which the loop is at rest [m]


def hats(system: tuple[float, float]) -> dict[str, float]:
    """Parameters of the linearizing controller, from its estimates of sigma0 and sigma1."""
    return dict(zip(("sigma0_hat", "sigma1_hat"), system, strict=True))


@cache
def step(controller: str, stop: float = th.STOP, plant: str = "plant", **values: float) -> Any:
    """A step to 8 cm in one solver, on a grid of one millisecond."""
    loop = Loop(controller, plant, th.SETPOINT, stop, controller_values=values)
    return run_monolithic(loop, 1e-3)


@cache
def figures(controller: str, stop: float = th.STOP, **values: float) -> Any:
    return metrics(step(controller, stop, **values))


@cache
def spectrum(
    controller: str, stop: float, setpoint: float = th.SETPOINT, **values: float
) -> LyapunovRun:
    """All exponents, after `stop` seconds and in the limit."""
    return loop_lyapunov(Loop(controller, reference=setpoint, stop=stop, controller_values=values))


def axis_under_step(**values: float) -> Model:
    """The axis alone, from rest under 30 V."""
    plant = Model(stored_kernel("plant", axis, "ballscrew.plant.axis"), values)
    plant.set_input("u", STEP_VOLTAGE)
    return plant


def model_of(
    controller: str, tolerance: float, setpoint: float = th.SETPOINT, **values: float
) -> Model:
    return loop_maker(Loop(controller, reference=setpoint, controller_values=values))(tolerance)


def tangents(controller: str, times: Vector, tolerance: float, count: int | None, **values: float):
    """The first tangents, or all, in the thesis' order."""
    model = model_of(controller, tolerance, **values)
    frame = np.eye(len(model.x))[loop_order(model.kernel)[:count]]
    run = follow_tangents(model, times, count=count, frame=frame)
    if run.failure:
        raise IntegrationError(run.failure)
    return run


@cache
def growth(
    controller: str, stop: float, tolerance: float = 1e-9, points: int = 2, **values: float
) -> tuple[Vector, Vector]:
    """Times [s] and the largest exponent's estimate times time [bits], by the first tangent."""
    run = tangents(controller, np.linspace(0.0, stop, points), tolerance, 1, **values)
    return run.time, run.growth[:, 0] * th.BITS


def largest(controller: str, stop: float, tolerance: float = 1e-9, **values: float) -> float:
    """The largest exponent after `stop` seconds [bits/s]."""
    return float(growth(controller, stop, tolerance, **values)[1][-1]) / stop


@dataclass(frozen=True)
class End:
    """Motion of a loop in the last two of 20 s."""

    kind: str  # "diverges", "swings", "stands"
    swing: float  # m to either side
    offset: float  # m from the set-point


@cache
def end_of(sigma0: float, sigma1: float, setpoint: float = th.SETPOINT) -> End:
    model = model_of("iol", 1e-8, setpoint, **hats((sigma0, sigma1)))
    x = [s.name for s in model.kernel.states].index("plant_x")
    for start, stop in ((0.0, th.STOP - 2.0), (th.STOP - 2.0, th.STOP)):
        seen = follow_returns(model, start, stop, x, math.inf, 1)
        if seen.diverged:
            return End("diverges", math.inf, math.inf)
        if seen.failure:
            raise IntegrationError(seen.failure)
    return _ended(seen.high[x] - seen.low[x], model.x[x] - setpoint)


def _ended(moved: float, offset: float) -> End:
    swing = float(moved) / 2.0
    return End("swings" if swing > SWING else "stands", swing, float(offset))


def scipy_course(
    system: tuple[float, float], method: str, rtol: float, atol: float, times: Vector | None = None
) -> Any:
    """A linearizing loop, whose first state is x, by SciPy with one absolute tolerance for all."""
    model = model_of("iol", 1e-8, **hats(system))

    def far(t: float, state: Vector) -> float:
        return 1.0 - abs(float(state[0]))

    far.terminal = True  # type: ignore[attr-defined]
    with np.errstate(all="ignore"):
        told = {"method": method, "rtol": rtol, "atol": atol, "events": far, "t_eval": times}
        return solve_ivp(model.derivatives, (0.0, th.STOP), model.x.copy(), **told)


@cache
def scipy_end(system: tuple[float, float], method: str, rtol: float, atol: float) -> End:
    run = scipy_course(system, method, rtol, atol)
    if run.t[-1] < th.STOP:
        return End("diverges", math.inf, math.inf)
    x = run.y[0]
    return _ended(np.ptp(x[run.t >= th.STOP - 2.0]), x[-1] - th.SETPOINT)
