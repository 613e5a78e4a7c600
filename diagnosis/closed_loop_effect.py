"""Effect of the causes found on a closed loop and on its long-term motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..fmus.catalogue import component
from ..solver.codegen import generate
from ..solver.component import Component, ContractError, symbol
from ..solver.connect import connect
from ..solver.delay_states import with_delay_states
from ..solver.kernel import IntegrationError, Model, Trajectory
from ..solver.tape import UnsupportedComponent
from ..stability.attractor import classify_attractor

Vector = npt.NDArray[np.float64]

CONTROLLER = "nctf"
SETPOINT = 0.08  # [m]
STOP = 5.0  # [s]
STEP = 1e-3  # time step of the result [s]
TOLERANCE = 1e-8
_ROUNDS = 3  # longer runs, to find rest or a cycle
_SETTLED = 0.02


class NoClosedLoop(RuntimeError):
    """The loop cannot be run; the message says why."""


@dataclass(frozen=True)
class LoopCourse:
    """One plant under the controller.

    Attributes
    ----------
    x, u : ndarray, shape (n,)
        Position [m] and command [V].
    settling : float or None
        Time after which the error stays below 2 % of the step [s].
    overshoot, error : float
        Overshoot past the set-point, and error at the end, as magnitudes [m].
    peak : float
        Largest magnitude of the command [V].
    becomes : str
        Long-term motion, as in `ballscrew map`.
    evidence : str
    slowest : float or None
        Real part of the slowest eigenvalue at the final rest [1/s].
    """

    x: Vector
    u: Vector
    settling: float | None
    overshoot: float
    error: float
    peak: float
    becomes: str
    evidence: str
    slowest: float | None


@dataclass(frozen=True)
class ClosedLoopEffect:
    """The prior and the extended plant under one controller.

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s]
    """

    time: Vector
    prior: LoopCourse
    extended: LoopCourse

    @property
    def farthest(self) -> float:
        """Largest distance between the two motions [m]."""
        return float(np.abs(self.extended.x - self.prior.x).max())

    @property
    def says(self) -> str:
        """The effect in one sentence."""
        changed = (
            f"the kind of motion does not change: {self.prior.becomes}"
            if self.prior.becomes == self.extended.becomes
            else f"the kind of motion changes: {self.extended.becomes}, not {self.prior.becomes}"
        )
        return (
            f"under {CONTROLLER} with its default gains the position differs by up to "
            f"{1e6 * self.farthest:.3g} um; {changed}"
        )


def closed_loop_effect(prior_model: Component, extended: Component) -> ClosedLoopEffect:
    """Run both plants to one set-point, plant and controller as one system of equations.

    One solver runs the loop, not the master: this takes hundredths of a second once compiled, and
    the stability of the same compiled equations is computed.

    Raises
    ------
    NoClosedLoop
        If a plant does not fit the controller, or the solver cannot continue.
    """
    time = np.linspace(0.0, STOP, round(STOP / STEP) + 1)
    try:
        loops = [_loop(plant) for plant in (prior_model, extended)]
        return ClosedLoopEffect(time, *(_course(loop, time) for loop in loops))
    except (UnsupportedComponent, ContractError) as error:
        raise NoClosedLoop(
            f"the plant does not fit the controller {CONTROLLER}: {error}"
        ) from error
    except IntegrationError as error:
        raise NoClosedLoop(f"the solver cannot continue: {error}") from error


def _loop(plant: Component) -> Component:
    controller = component(CONTROLLER)
    # the controller may have unused ports, and not every plant has bristles or a current
    rates = [*controller.derivatives, *(o.value for o in controller.all_outputs)]
    used = set().union(*(rate.free_symbols for rate in rates))
    wanted = (i for i in controller.inputs if i.role == "reference" or symbol(i.name) in used)
    return connect(plant, replace(controller, inputs=tuple(wanted)))


def _run(loop: Component, time: Vector) -> tuple[Model, Trajectory]:
    model = Model(generate(loop), tolerance=TOLERANCE)
    for given in model.kernel.inputs:
        if given.role == "reference":
            model.set_input(given.name, SETPOINT)
    model.settle(0.0)
    return model, model.simulate(time)


def _course(loop: Component, time: Vector) -> LoopCourse:
    model, run = _run(loop, time)
    if loop.delays:  # the long-term motion is computed from states only
        model, _ = _run(with_delay_states(loop), time)
    motion = classify_attractor(model, STOP, STOP, exponents=False, rounds=_ROUNDS)
    x, u = run.outputs["x"], run.outputs["u"]
    rest = motion.equilibrium
    return LoopCourse(
        x,
        u,
        _settling(time, x),
        float(max(0.0, (x - SETPOINT).max())),
        float(abs(SETPOINT - x[-1])),
        float(np.abs(u).max()),
        motion.kind.value,
        motion.evidence,
        None if rest is None else rest.slowest,
    )


def _settling(time: Vector, x: Vector) -> float | None:
    outside = np.flatnonzero(np.abs(x - SETPOINT) > _SETTLED * SETPOINT)
    if not len(outside):
        return 0.0
    last = int(outside[-1])
    return float(time[last + 1]) if last + 1 < len(time) else None
