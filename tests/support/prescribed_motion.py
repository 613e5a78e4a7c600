"""The force of a single friction law under a prescribed motion.

Within a communication step the velocity is v + a (t - t_step), with constant a. Over several steps,
any piecewise linear velocity is possible, including jumps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import sympy as sp

from ballscrew.plant.law import Law, law
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import TIME, Component, ForceTerm, Input, Output, State, symbol
from ballscrew.solver.kernel import DEFAULT_TOLERANCE, Kernel, Model, Trajectory


def prescribed_motion(friction: Law, name: str = "prescribed_motion") -> Component:
    """A friction law moved with a velocity; states are x, `work` against friction and the law's.

    Outputs are all states, `velocity` [m/s] and the law's outputs, including `friction` [N].
    """
    velocity = symbol("v") + symbol("a") * (TIME - symbol("t_step"))
    term = _switched(friction(velocity))
    states = (
        State("x", "m", "position", velocity, nominal=1e-6),
        State("work", "N*m", "work put in against friction", -term.force * velocity, nominal=1e-6),
        *term.states,
    )
    shown = {o.name for o in term.outputs}
    return Component(
        name=name,
        description=f"Prescribed motion against {term.meaning.split(',')[0]}",
        parameters=term.parameters,
        inputs=(
            Input("v", "m/s", "velocity at the start of the step", nominal=1e-3),
            Input("a", "m/s^2", "acceleration during the step", nominal=1e-2),
            Input("t_step", "s", "start of the communication step", role="internal"),
        ),
        states=states,
        outputs=(
            Output("velocity", "m/s", "velocity", velocity, nominal=1e-3),
            *(
                Output(s.name, s.unit, s.meaning, symbol(s.name), s.nominal)
                for s in states
                if s.name not in shown
            ),
            *term.outputs,
        ),
    )


def _switched(term: ForceTerm) -> ForceTerm:
    """The term with its signs as cases: velocity depends on time, and d sgn/dt does not exist."""

    def cases(expression: sp.Expr) -> sp.Expr:
        return sp.sympify(expression).replace(
            sp.sign, lambda x: sp.Piecewise((1, x > 0), (-1, x < 0), (0, True))
        )

    return replace(
        term,
        force=cases(term.force),
        states=tuple(replace(s, derivative=cases(s.derivative)) for s in term.states),
        outputs=tuple(replace(o, value=cases(o.value)) for o in term.outputs),
    )


@cache
def motion_kernel(name: str) -> Kernel:
    """The compiled component of a law of `LAWS` under prescribed motion."""
    return generate(prescribed_motion(law(name), f"motion_{name}"))


def prescribed_friction(
    name: str,
    times: npt.ArrayLike,
    velocity: npt.ArrayLike,
    values: Mapping[str, float] | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Trajectory:
    """The friction of a law of `LAWS` with velocities [m/s] at times [s], linear in between.

    A time that occurs twice is a jump of the velocity. `values` are parameters, and initial states
    as ``<state>_start``. The outputs are those of `prescribed_motion`.
    """
    model = Model(motion_kernel(name), values, tolerance)
    grid = np.ascontiguousarray(times, dtype=float)
    speeds = np.ascontiguousarray(velocity, dtype=float)
    # velocity at each step's start, its slope, and the start time; then the velocity at the time
    spans = np.diff(grid)
    slopes = np.divide(np.diff(speeds), spans, out=np.zeros(len(spans)), where=spans > 0.0)
    still = np.zeros(len(grid))
    within = np.column_stack([speeds, still, grid])
    within[1:] = np.column_stack([speeds[:-1], slopes, grid[:-1]])
    return model.simulate(grid, (within, np.column_stack([speeds, still, grid])))


def pieces(*legs):
    """Times and velocities of legs (velocity, duration), with jumps between them."""
    times, velocities = [0.0], [legs[0][0]]
    for velocity, duration in legs:
        times += [times[-1], times[-1] + duration]
        velocities += [velocity, velocity]
    return np.array(times), np.array(velocities)


def ways(*legs):
    """The same for legs (velocity, distance)."""
    return pieces(*((velocity, distance / abs(velocity)) for velocity, distance in legs))
