"""A friction law for the estimator, and the coordinates in which it is fitted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import sympy as sp

from ...plant.law import Estimation, claims, law
from ...solver.arrays import Matrix, Vector
from ...solver.component import symbol

OFFSET = "offset"
"""Name of the constant force [N], against motion in +x as in the plants."""
MASS = "m"
"""Name of the mass [kg] between the force sensor and the friction."""
FORMS = ("bristles", "power", "relaxing", "elements", "dry", "solved")
"""Forms of laws in ``c/laws.c``; the last is for a law without an exact step there."""


@dataclass(frozen=True)
class FittedLaw:
    """A friction law for the estimator: its parameters, in the order of the equations."""

    name: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    directional: bool = False  # whether each direction has its own parameters
    rigid: bool = False  # whether the body sticks without any motion
    unseen: tuple[str, ...] = ()  # parameters that keep their defaults
    mass: bool = False  # whether the mass is also fitted
    offset: bool = False  # whether a constant force is also fitted

    @cached_property
    def asks(self) -> Estimation:
        """What the law's file says about its estimation."""
        return claims(self.name).estimation

    @property
    def form(self) -> str:
        """One of `FORMS`."""
        return self.asks.form or FORMS[-1]

    @property
    def together(self) -> tuple[str, ...]:
        """Parameters that depend on several coordinates: intervals of the law are drawn."""
        return self.asks.together

    @property
    def beside(self) -> tuple[str, ...]:
        """Parameters fitted in addition to the law, in the order of their coordinates, the last."""
        return (MASS,) * self.mass + (OFFSET,) * self.offset

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the law's parameters in the plants, forwards first."""
        if not self.directional:
            return self.parameters
        return tuple(f"{n}_{side}" for side in ("pos", "neg") for n in self.parameters)

    @property
    def ends(self) -> tuple[str, ...]:
        """Endings of the parameters' names, one for each set of them."""
        return ("_pos", "_neg") if self.directional else ("",)

    @property
    def fitted_units(self) -> tuple[str, ...]:
        """Units of `names` and `beside`."""
        return self.units * len(self.ends) + ("kg",) * self.mass + ("N",) * self.offset

    def values_at(self, coordinates: Matrix) -> Matrix:
        """Parameters from the coordinates in which they are fitted, shape (..., p) of both.

        Coordinates are logarithms of the parameters, or of the numbers that the law's file has in
        their place; the mass is a logarithm, too. A constant force is its own coordinate [N], the
        last.
        """
        values = np.array(coordinates, dtype=float)
        logarithms = values[..., : values.shape[-1] - self.offset]
        np.exp(logarithms, out=logarithms)
        if self.asks.parameters:
            for first in range(0, len(self.names), len(self.parameters)):
                own = values[..., first : first + len(self.parameters)]
                made = self.asks.parameters(*np.moveaxis(own, -1, 0))
                own[...] = np.stack([*made], axis=-1)
        return values

    def coordinates_of(self, values: Vector) -> Vector:
        """The inverse of `values_at`, for one set of parameters, shape (p,)."""
        return np.log([*self.asks.numbers(*values)] if self.asks.numbers else values)

    def presliding_way(self, values: Mapping[str, float], end: str = "") -> float:
        """Presliding distance [m], of the parameters whose names have this end."""
        own = {n: values[n + (end or self.ends[0])] for n in self.parameters}
        both = self.name.removeprefix("directional_")
        stiffness = claim_of(both, "stiffness", own)
        rigid = 2e-5  # assumed for a law without a stiffness
        static = own["Fs"] if "Fs" in own else claim_of(both, "steady_state", own)
        return abs(static / stiffness) if stiffness else rigid


@cache
def fitted_law(name: str) -> FittedLaw:
    """A law of the plants; parameters with a default of 0 are not fitted."""
    both, claim = name.removeprefix("directional_"), claims(name)
    every = law(name)(symbol("v")).parameters
    one_way = every if both == name else law(both)(symbol("v")).parameters
    unseen = tuple(p.name for p in every if p.name in claim.estimation.unseen)
    own = [p for p in one_way if p.default > 0 and p.name not in unseen]
    names, units = tuple(p.name for p in own), tuple(p.unit for p in own)
    return FittedLaw(name, names, units, both != name, claim.stiffness is None, unseen)


def name_and_end(parameter: str) -> tuple[str, str]:
    """A parameter's name without its direction, and the ending for that."""
    name = parameter.removesuffix("_pos").removesuffix("_neg")
    return name, parameter[len(name) :]


def claim_of(name: str, what: str, values: Mapping[str, float], speed: Any = 1e-6) -> Any:
    """Value of a field of a law's `Claims`; 0 if the law does not claim it.

    Parameters
    ----------
    name, what : str
    values : mapping of str to float
        Values of the fitted parameters; the others have their defaults.
    speed : float or ndarray
        Speed, or several, for each of which there is a value [m/s].
    """
    promise = getattr(claims(name), what)
    if promise is None:
        return 0.0
    known = {p.name: p.default for p in law(name)(symbol("v")).parameters} | {**values}
    numbers = {symbol(n): value for n, value in known.items()}
    if isinstance(speed, float):
        return float(sp.sympify(promise).subs(numbers | {symbol("v"): speed}))
    return sp.lambdify(symbol("v"), sp.sympify(promise).subs(numbers))(speed)


def assumed_damping(sigma0: float, sigma2: float, mass: float = 1.0, share: float = 1.0) -> float:
    """sigma1 of LuGre for a share of the critical damping of a mass on its bristles [N*s/m]."""
    return share * 2 * math.sqrt(sigma0 * mass) - sigma2
