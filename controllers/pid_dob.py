"""Position PID with a disturbance observer.

The observer (K. Ohnishi, M. Shibata and T. Murakami, IEEE/ASME Transactions on Mechatronics 1, 56
(1996)) compares the voltage that the rigid axis would need for the measured velocity with
the actual one, through the filter ``Q(s) = 1/(Tq s + 1)``:

    d_hat = Q (v + lag dv/dt)/b - Q u

Written with the state ``q = d_hat - lag/(b Tq) v`` it needs no derivative. On the rigid axis under
a constant disturbance ``d`` [V], ``d - d_hat`` decays with the pole ``-1/Tq``.
"""

from __future__ import annotations

from ..solver.component import Component, Parameter, State, symbol
from .limited import limit, voltage_law
from .pid import PID_VOLTAGE, pid_integral, pid_parameters
from .pid import TUNABLE as PID_TUNABLE
from .rigid_axis import model_parameters, rigid_axis

FILTER_RATIO = 20.0
"""Filter time divided by the electrical time constant, which the observer's model neglects."""

TUNABLE = {**PID_TUNABLE, "Tq": (2e-4, 0.5)}


def pid_dob() -> Component:
    """`u` [V] from x, v and x_d."""
    b, lag, time = symbol("b"), symbol("lag"), symbol("Tq")
    speed = symbol("v")
    disturbance = symbol("q") + lag / (b * time) * speed
    command = PID_VOLTAGE - disturbance
    rate = ((1 - lag / time) * speed / b - limit(command) - symbol("q")) / time
    default = FILTER_RATIO * rigid_axis().electrical_time
    source = f"{FILTER_RATIO:g} L/R: slow against what the model leaves out"
    slow = Parameter("Tq", default, "s", "time constant of the observer's filter", source, 1e-6)
    return voltage_law(
        "pid_dob",
        "Position PID with a disturbance observer",
        (*pid_parameters(), *model_parameters(), slow),
        command,
        (
            pid_integral(command),
            State("q", "V", "filtered part of the estimated disturbance", rate, nominal=1.0),
        ),
    )
