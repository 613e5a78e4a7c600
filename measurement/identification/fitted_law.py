"""A friction law for the estimator, and the coordinates in which it is fitted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from ...plant import LAWS as NAMES
from ...plant.law import claims, law
from ...plant.lugre import PARAMETERS as LUGRE
from ...plant.maxwell_slip import ELEMENTS
from ...solver.arrays import Vector
from ...solver.component import Parameter, symbol

OFFSET = "offset"
"""Name of the constant force [N], against motion in +x as in the plants."""
MASS = "m"
"""Name of the mass [kg] between the force sensor and the friction."""
BRISTLES = ("lugre", "modified_lugre", "directional_lugre")
"""LuGre and related laws. Kv of these is fixed, because records give no information on it."""
DRAWN = ("bliman_sorine", "maxwell_slip")
"""Laws with parameters that depend on several coordinates: their intervals are drawn."""


@dataclass(frozen=True)
class FittedLaw:
    """A friction law for the estimator: its parameters, in the order of the equations."""

    name: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    directional: bool = False  # whether each direction has its own parameters
    rigid: bool = False  # whether the body sticks without any motion
    mass: bool = False  # whether the mass is also fitted
    offset: bool = False  # whether a constant force is also fitted

    @property
    def beside(self) -> tuple[str, ...]:
        """Parameters fitted in addition to the law, in the order of their coordinates, the last."""
        return (MASS,) * self.mass + (OFFSET,) * self.offset

    @property
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

    def values_at(self, coordinates: Vector) -> Vector:
        """Parameters from the coordinates in which they are fitted.

        Coordinates are logarithms, except for two laws. Bliman-Sorine's f1 and f2 grow together as
        eta approaches one, while their difference and f2*(1 - eta) hardly change. Its coordinates
        are these two, eps_f and the odds of eta. The shares of Maxwell slip add up to one, since a
        common factor is equivalent to a factor of Fc and Fs. Its coordinates are their ratios to
        the last share; the coordinate of the last share has no effect. The mass is a logarithm,
        too. A constant force is its own coordinate [N], the last.

        Parameters
        ----------
        coordinates : ndarray, shape (..., p) or (..., 2 p)
            With one more for each name in `beside`.
        """
        if self.beside:
            split = coordinates.shape[-1] - len(self.beside)
            of_law = replace(self, mass=False, offset=False).values_at(coordinates[..., :split])
            rest = coordinates[..., split:].copy()
            rest[..., : self.mass] = np.exp(rest[..., : self.mass])
            return np.concatenate([of_law, rest], axis=-1)
        values = np.exp(coordinates)
        if self.name == "bliman_sorine":
            parts = []
            for k in range(0, coordinates.shape[-1], 4):
                c, b, eps_f, odds = np.moveaxis(values[..., k : k + 4], -1, 0)
                f2 = b * (1 + odds)
                parts += [c + f2, f2, eps_f, odds / (1 + odds)]
            return np.stack(parts, axis=-1)
        if self.name == "maxwell_slip":
            for k in range(ELEMENTS, coordinates.shape[-1], len(self.parameters)):
                shares = values[..., k : k + ELEMENTS]
                shares[..., -1] = 1.0
                shares /= shares.sum(axis=-1, keepdims=True)
        return np.asarray(values)

    def coordinates_of(self, values: Vector) -> Vector:
        """The inverse of `values_at`, for one set of parameters, shape (p,)."""
        if self.name == "bliman_sorine":
            f1, f2, eps_f, eta = values
            return np.asarray(np.log([f1 - f2, f2 * (1 - eta), eps_f, eta / (1 - eta)]))
        coordinates = np.log(values)
        if self.name == "maxwell_slip":
            coordinates[ELEMENTS : 2 * ELEMENTS] -= coordinates[2 * ELEMENTS - 1]
        return np.asarray(coordinates)

    def presliding_way(self, values: Mapping[str, float], end: str = "") -> float:
        """Presliding distance [m], of the parameters whose names have this end."""
        own = {n: values[n + (end or self.ends[0])] for n in self.parameters}
        if self.name == "maxwell_slip":
            return own["Fs"] / sum(own[f"k{i}"] for i in range(1, ELEMENTS + 1))
        if self.name in BRISTLES:
            return own["Fs"] / own["sigma0"]
        stiffness = claim_of(self.name, "stiffness", own)
        rigid = 2e-5  # assumed for a law without a stiffness
        return abs(claim_of(self.name, "steady_state", own) / stiffness) if stiffness else rigid


def _fitted(name: str) -> FittedLaw:
    """A law of the plants; parameters with a default of 0 are not fitted."""
    both = name.removeprefix("directional_")
    own: tuple[Parameter, ...] = LUGRE if name in BRISTLES else law(both)(symbol("v")).parameters
    own = tuple(p for p in own if p.default > 0)
    names, units = tuple(p.name for p in own), tuple(p.unit for p in own)
    return FittedLaw(name, names, units, both != name, claims(name).stiffness is None)


LAWS = {name: _fitted(name) for name in NAMES}


def without_direction(name: str) -> str:
    """A parameter's name without its direction."""
    return name.removesuffix("_pos").removesuffix("_neg")


def claim_of(name: str, what: str, values: Mapping[str, float], speed: float = 1e-6) -> float:
    """Value of a field of a law's `Claims`; 0 if the law does not claim it.

    Parameters
    ----------
    name, what : str
    values : mapping of str to float
        Values of the fitted parameters; the others have their defaults.
    speed : float
        Speed [m/s].
    """
    promise = getattr(claims(name), what)
    if promise is None:
        return 0.0
    known = {p.name: p.default for p in law(name)(symbol("v")).parameters} | {"v": speed}
    return float(sp.sympify(promise).subs({symbol(n): v for n, v in (known | {**values}).items()}))


def assumed_damping(sigma0: float, sigma2: float, mass: float = 1.0, share: float = 1.0) -> float:
    """sigma1 of LuGre for a share of the critical damping of a mass on its bristles [N*s/m]."""
    return share * 2 * math.sqrt(sigma0 * mass) - sigma2
