"""The equilibrium near a state, and its eigenvalues."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..solver.kernel import Model

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

NEUTRAL = 1e-11  # share of the Jacobian's largest entry below which an eigenvalue is zero
_NEWTON = 30
_CLOSE = 1e-6  # nominal magnitudes; where an eigenvalue is nearly zero, round-off moves it so far


@dataclass(frozen=True)
class Equilibrium:
    """An equilibrium and its linear part.

    Attributes
    ----------
    state : ndarray, shape (n,)
    eigenvalues : ndarray of complex, shape (n,)
        Of the Jacobian [1/s], largest real part first; zeros along a set of equilibria.
    neutral : int
        How many of them are zero: the dimension of the set of equilibria that this one is part of.
    """

    state: Vector
    eigenvalues: npt.NDArray[np.complex128]
    neutral: int

    @property
    def slowest(self) -> float:
        """Real part of the first eigenvalue that is not zero [1/s]; zero if all are."""
        rest = self.eigenvalues[self.eigenvalues != 0.0]
        return float(rest.real.max(initial=-np.inf)) if len(rest) else 0.0


def equilibrium_near(model: Model, time: float) -> Equilibrium | None:
    """The equilibrium next to the model's present state; None if Newton's method finds none.

    Where equilibria form a line, it is the one that the shortest steps lead to.

    Parameters
    ----------
    model : Model
        Stays as it is.
    time : float
        [s], for equations that contain it.
    """
    # Over nominal magnitudes, so that a state's size does not depend on its unit.
    nominal = model.kernel.nominal
    point = model.x.copy()
    for _ in range(_NEWTON):
        rates = model.derivatives(time, point) / nominal
        a = model.jacobian(time, point) * nominal[None, :] / nominal[:, None]
        if not (np.isfinite(rates).all() and np.isfinite(a).all()):
            return None
        step = _shortest_solution(a, rates) * nominal
        point = point - step
        if np.all(np.abs(step) <= _CLOSE * nominal):
            break
    else:
        return None
    a = model.jacobian(time, point) * nominal[None, :] / nominal[:, None]
    values = np.linalg.eigvals(a)
    values = values[np.argsort(-values.real)].astype(complex)
    zero = NEUTRAL * float(np.abs(a).max(initial=0.0))
    neutral = np.abs(values) <= zero
    return Equilibrium(point, np.where(neutral, 0.0, values), int(neutral.sum()))


def _shortest_solution(a: Matrix, b: Vector) -> Vector:
    """Least squares; what is dependent, or nearly, is left where it is.

    A friction law's deflection that hardly moves any more must not be driven along the line of
    equilibria to make its last rate vanish, too.
    """
    return np.asarray(np.linalg.lstsq(a, b, rcond=1e-11)[0])
