"""LQ state feedback with integral action.

The plant's own equations are linearized about slow sliding: the block slides in one direction, so
that Coulomb friction is constant and drops out, and the viscous part remains. For the states
position error, velocity, current and the integral of the error, the gains minimize

    integral of (e/e_max)^2 + (v/v_max)^2 + (w/w_max)^2 + (u/u_max)^2

(A. E. Bryson and Y.-C. Ho, "Applied Optimal Control" (1975): one over the largest acceptable value,
squared). The Riccati equation is solved by `scipy.linalg.solve_continuous_are`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import sympy as sp

from ..plant.axis import axis
from ..plant.ball_screw import ball_screw, bare_ball_screw
from ..plant.instruments import NOMINAL_VOLTAGE
from ..solver.arrays import Matrix
from ..solver.component import Component, ForceTerm, Parameter, symbol
from .limited import U_MAX, tracked_integral, tracking_time, voltage_law

LARGEST_ERROR = 0.05  # m
LARGEST_INTEGRAL = 0.025  # m*s
STATES = ("x", "v", "i")

TUNABLE = {"Kx": (50.0, 5e4), "Kv": (0.0, 500.0), "Kc": (-50.0, 50.0), "Ki": (0.0, 5e4)}


@dataclass(frozen=True)
class LqDesign:
    """The linear plant, the weights, and the resulting gains."""

    dynamics: Matrix  # shape (4, 4); system matrix of x - x_d, v, i and the integral of x - x_d
    effect: Matrix  # shape (4, 1); input matrix of the voltage
    weights: Matrix  # shape (4, 4); weights of the states; that of the voltage is ``1/u_max^2``
    cost: Matrix  # shape (4, 4); solution of the Riccati equation
    gains: Matrix  # shape (4,); ``u = -gains (x - x_d, v, i, integral)``


def rest_sliding(plant_parameters: Mapping[str, float] | None = None) -> tuple[Matrix, Matrix]:
    """A, shape (3, 3), and B, shape (3, 1), of position, velocity and current in sliding."""

    def viscous(velocity: sp.Expr) -> ForceTerm:
        return ForceTerm("friction", -symbol("sigma2") * velocity, "viscous friction")

    values = {p.name: p.default for p in axis().all_parameters} | dict(plant_parameters or {})
    sigma2 = tuple(p for p in ball_screw().all_parameters if p.name == "sigma2")
    plant = bare_ball_screw(lambda v: replace(viscous(v), parameters=sigma2))
    rates = sp.Matrix([plant.derivative(s) for s in STATES])
    numbers = {symbol(n): v for n, v in values.items()}

    def by(names: tuple[str, ...]) -> Matrix:
        slopes = rates.jacobian([symbol(n) for n in names]).subs(numbers).evalf()
        return np.array(slopes, dtype=float)

    return by(STATES), by(("u",))


@cache
def lq_design() -> LqDesign:
    """The design for the nominal plant."""
    from scipy.linalg import solve_continuous_are

    plant, effect = rest_sliding()
    dynamics = np.zeros((4, 4))
    dynamics[:3, :3] = plant
    dynamics[3, 0] = 1.0
    b = np.vstack([effect, [[0.0]]])
    q = np.diag([LARGEST_ERROR**-2, 0.0, 0.0, LARGEST_INTEGRAL**-2])
    r = np.array([[NOMINAL_VOLTAGE**-2]])
    cost = solve_continuous_are(dynamics, b, q, r)
    gains = (b.T @ cost / r).ravel()
    return LqDesign(dynamics, b, q, cost, gains)


def lqi() -> Component:
    """`u` [V] from x, v, i and x_d."""
    # the last digits depend on the linear algebra library; six digits are the same everywhere
    gains = [float(f"{g:.6g}") for g in lq_design().gains]
    source = "Riccati equation of the axis in sliding; weights by Bryson's rule"
    error = symbol("x_d") - symbol("x")
    command = (
        symbol("Kx") * error - symbol("Kv") * symbol("v") - symbol("Kc") * symbol("i") + symbol("w")
    )
    return voltage_law(
        "lqi",
        "LQ state feedback of position, velocity and current with integral action",
        (
            Parameter("Kx", gains[0], "V/m", "gain on the position error", source),
            Parameter("Kv", gains[1], "V*s/m", "gain on the velocity", source),
            Parameter("Kc", gains[2], "V/A", "gain on the current", source),
            Parameter("Ki", gains[3], "V/(m*s)", "gain on the integral of the error", source),
            tracking_time(0.1, "an eighth of Kx/Ki; 0.5 s lets the nominal step overshoot by 8 mm"),
            U_MAX,
        ),
        command,
        (tracked_integral(symbol("Ki") * error, command),),
    )
