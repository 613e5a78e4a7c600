"""Linear axes for the controllers' tests, independent of the plant; formulas are exact for them.

All have the outputs x, v and i, and a constant load `load` [N], which is unknown to controllers.
"""

from __future__ import annotations

import math

import numpy as np

from ballscrew import TIME, Component, Input, Output, Parameter, State, connect, symbol
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import CONTROLLER, PLANT, Model

MOTOR = 37.4e-3 * 2 * math.pi * 1000  # N/A
EMF = 60 / (255 * 2 * math.pi) * 2 * math.pi * 1000  # V*s/m
R, L, M, SIGMA2 = 21.4, 0.953e-3, 1.0, 173.0
DAMPING = SIGMA2 + MOTOR * EMF / R
B = MOTOR / R / DAMPING  # m/(s*V)
LAG = M / DAMPING  # s
TIGHT = 1e-11


def _axis(name: str, *states: State) -> Component:
    return Component(
        name,
        "a linear axis",
        parameters=(Parameter("load", 0.0, "N", "constant load", "the test"),),
        inputs=(Input("u", "V", "voltage"),),
        states=states,
        outputs=(
            Output("x", "m", "position", symbol("x")),
            Output("v", "m/s", "velocity", symbol("v")),
            Output("i", "A", "current", symbol("i")),
        ),
    )


def rigid() -> Component:
    """The axis without inductance: lag dv/dt = b (u - load R/motor) - v."""
    u, v, load = symbol("u"), symbol("v"), symbol("load")
    return _axis(
        "rigid",
        State("x", "m", "position", v, nominal=1e-3),
        State("v", "m/s", "velocity", (B * (u - load * R / MOTOR) - v) / LAG, nominal=1e-3),
        State("i", "A", "none", -symbol("i")),
    )


def sliding() -> Component:
    """The axis with inductance; friction is viscous."""
    u, v, i, load = (symbol(n) for n in ("u", "v", "i", "load"))
    return _axis(
        "sliding",
        State("x", "m", "position", v, nominal=1e-3),
        State("v", "m/s", "velocity", (MOTOR * i - SIGMA2 * v - load) / M, nominal=1e-3),
        State("i", "A", "current", (u - R * i - EMF * v) / L, nominal=1e-2),
    )


def matrices() -> tuple[np.ndarray, np.ndarray]:
    """A and B of `sliding`."""
    a = [[0, 1, 0], [0, -SIGMA2 / M, MOTOR / M], [0, -EMF / L, -R / L]]
    return np.array(a), np.array([[0], [0], [1 / L]])


def loop(
    plant: Component, controller: Component, goal: float = 0.08, tolerance: float = TIGHT, **values
) -> Model:
    """The closed loop; values are the controller's, or the plant's if they begin with plant_."""
    named = {k if k.startswith(PLANT) else CONTROLLER + k: v for k, v in values.items()}
    model = Model(generate(connect(plant, controller)), named, tolerance)
    if "x_d" in [i.name for i in model.kernel.inputs]:
        model.set_input("x_d", goal)
    model.settle(0.0)
    return model


def following(controller: Component, course: object) -> Component:
    """The controller with a set-point as a function of time, and v_d and a_d as its derivatives."""
    rates = [course]
    for _ in range(2):
        rates.append(rates[-1].diff(TIME))
    given = dict(zip(map(symbol, ("x_d", "v_d", "a_d")), rates, strict=True))
    kept = tuple(
        i for i in controller.inputs if i.role not in ("reference", "reference_derivative")
    )
    return controller.substituted(given, inputs=kept)
