"""Growth of finite perturbations, for loops whose tangents give no information."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..solver.kernel import Model
from ..solver.spectrum import follow_returns

Vector = npt.NDArray[np.float64]

SIZES = (1e-6, 1e-4, 1e-2)  # nominal magnitudes
DIRECTIONS = 6
SEED = 0


@dataclass(frozen=True)
class PerturbationGrowth:
    """Distance of motions that begin close to each other.

    Attributes
    ----------
    size : float
        Of the perturbation of each state, over its nominal magnitude.
    middle, end : float
        Distances half-way and at the end, over the size: geometric means over all directions.
    span : float
        Duration of the motions [s].
    """

    size: float
    middle: float
    end: float
    span: float

    @property
    def rate(self) -> float:
        """Mean growth over the second half [nats/s]; minus infinity if the motions have met."""
        if self.end == 0.0:
            return -math.inf
        return math.log(self.end / self.middle) / (0.5 * self.span)


def perturbation_growth(model: Model, time: float, span: float) -> list[PerturbationGrowth]:
    """Growth of finite perturbations in random directions.

    After E. Aurell et al., J. Phys. A 30, 1 (1997).

    Distances are the largest of the states' differences over their nominal magnitudes.

    Parameters
    ----------
    model : Model
        Not changed.
    time, span : float
        The present, and the duration of the motions [s].

    Returns
    -------
    list of PerturbationGrowth
        One for each size, without sizes for which a motion failed.
    """
    nominal = model.kernel.nominal
    kept = model.x.copy(), model.u.copy(), model.info.copy()

    def followed(state: Vector) -> list[Vector]:
        model.x[:], model.u[:], model.info[:] = state, kept[1], kept[2]
        seen = []
        for start in (time, time + 0.5 * span):
            if follow_returns(model, start, start + 0.5 * span, 0, np.inf, 0).failure:
                return []
            seen.append(model.x.copy())
        return seen

    random = np.random.default_rng(SEED)
    directions = [random.uniform(-1.0, 1.0, len(nominal)) for _ in range(DIRECTIONS)]
    found = []
    own = followed(kept[0])
    for size in SIZES if own else ():
        shares = []
        for direction in directions:
            start = size * direction / np.abs(direction).max()
            other = followed(kept[0] + start * nominal)
            if other:
                pairs = zip(other, own, strict=True)
                shares.append([float(np.abs((a - b) / nominal).max() / size) for a, b in pairs])
        if len(shares) == DIRECTIONS:
            with np.errstate(divide="ignore"):
                middle, end = np.exp(np.log(shares).mean(axis=0)).tolist()
            found.append(PerturbationGrowth(size, middle, end, span))
    model.x[:], model.u[:], model.info[:] = kept
    return found
