"""A friction law as the estimator sees it, and the coordinates in which it is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..plant.bliman_sorine import PARAMETERS as BLIMAN_SORINE
from ..plant.classical import classical
from ..plant.dahl import PARAMETERS as DAHL
from ..plant.lugre import PARAMETERS as LUGRE
from ..plant.maxwell_slip import ELEMENTS
from ..plant.maxwell_slip import PARAMETERS as MAXWELL_SLIP
from ..solver.component import symbol

Vector = npt.NDArray[np.float64]

OFFSET = "offset"
"""Name of the constant force [N], against motion in +x as the plants have it."""


@dataclass(frozen=True)
class Law:
    """A friction law as the estimator sees it: its parameters, in the order of the equations.

    Attributes
    ----------
    directional : bool
        Whether either direction has parameters of its own.
    offset : bool
        Whether a constant force is fitted beside it.
    """

    name: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    directional: bool = False
    offset: bool = False


LAWS = {
    name: Law(
        name, tuple(p.name for p in own), tuple(p.unit for p in own), name.startswith("directional")
    )
    for name, own in {
        **dict.fromkeys(("lugre", "modified_lugre", "directional_lugre"), LUGRE),
        "dahl": DAHL,
        "bliman_sorine": BLIMAN_SORINE,
        "maxwell_slip": MAXWELL_SLIP,
        "classical": classical(symbol("v")).parameters,
    }.items()
}


def values_of(law: Law, coordinates: Vector) -> Vector:
    """Parameters from the coordinates in which they are fitted.

    Logarithms, except for two laws. Bliman-Sorine's f1 and f2 grow together as eta nears one, while
    their difference and f2*(1 - eta) hardly change: these two, eps_f and eta's odds are its
    coordinates. Maxwell slip's shares are one together, since a common factor is that of Fc and Fs:
    their ratios to the last are its coordinates, and the last's own coordinate does nothing.
    A constant force beside the law is its own coordinate [N], the last.

    Parameters
    ----------
    law : Law
    coordinates : ndarray, shape (..., p) or (..., 2 p)
        One more where the law has an offset.
    """
    if law.offset:
        of_law = values_of(replace(law, offset=False), coordinates[..., :-1])
        return np.concatenate([of_law, coordinates[..., -1:]], axis=-1)
    values = np.exp(coordinates)
    if law.name == "bliman_sorine":
        parts = []
        for k in range(0, coordinates.shape[-1], 4):
            c, b, eps_f, odds = np.moveaxis(values[..., k : k + 4], -1, 0)
            eta = odds / (1 + odds)
            f2 = b * (1 + odds)
            parts += [c + f2, f2, eps_f, eta]
        return np.stack(parts, axis=-1)
    if law.name == "maxwell_slip":
        for k in range(ELEMENTS, coordinates.shape[-1], len(law.parameters)):
            shares = values[..., k : k + ELEMENTS]
            shares[..., -1] = 1.0
            shares /= shares.sum(axis=-1, keepdims=True)
    return np.asarray(values)


def coordinates_of(law: Law, values: Vector) -> Vector:
    """The inverse of `values_of`, for one set of parameters, shape (p,)."""
    if law.name == "bliman_sorine":
        f1, f2, eps_f, eta = values
        return np.asarray(np.log([f1 - f2, f2 * (1 - eta), eps_f, eta / (1 - eta)]))
    coordinates = np.log(values)
    if law.name == "maxwell_slip":
        coordinates[ELEMENTS : 2 * ELEMENTS] -= coordinates[2 * ELEMENTS - 1]
    return np.asarray(coordinates)
