"""The friction laws along a given motion, compiled: what the estimators fit, see ``c/laws.c``.

The equations come from ``plant``, see `laws_in_c`; a test compares each law with a stiff solver.
For a law without an exact step there, its equations are solved, see `law_equations`.
"""

from __future__ import annotations

import ctypes as ct
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...solver.core import SUFFIX, at
from .fitted_law import BRISTLES
from .law_equations import equations_of

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Bounds = npt.NDArray[np.int64]

ANY = 5
KINDS = {
    **dict.fromkeys(BRISTLES, 0),
    "dahl": 1,
    "bliman_sorine": 2,
    "maxwell_slip": 3,
    "classical": 4,
    "directional_classical": 4,
}
"""Laws with an exact step in ``c/laws.c``; for all others the equations are solved."""
SHARPNESS = 1e8  # Kv of the modified law [s/m], Table 3.1; records give no information on it


class _Law(ct.Structure):
    kept: tuple[Vector, Vector]
    _fields_ = (
        ("kind", ct.c_int32),
        ("count", ct.c_int32),
        ("forwards", ct.c_void_p),
        ("backwards", ct.c_void_p),
        ("sharpness", ct.c_double),
        ("equations", ct.c_void_p),
    )


@dataclass(frozen=True)
class LawValues:
    """A law with its parameters.

    Attributes
    ----------
    name : str
    forwards, backwards : ndarray
        The law's parameters, in the order of the estimator's ``LAWS``, by direction of motion.
        LuGre's sigma0 depends on the direction in which the bristles are bent. With two additional
        parameters, its curve has another bend at low speed.
    sharpness : float
        Kv of the modified law [s/m]; 0 for abs(v) itself, as in the original.
    """

    name: str
    forwards: Vector
    backwards: Vector
    sharpness: float = SHARPNESS

    def told(self) -> _Law:
        """The law for compiled code; `self` must exist as long as it is used."""
        kind = KINDS.get(self.name, ANY)
        forwards, backwards, equations = self.forwards, self.backwards, None
        if kind == ANY:
            equations = equations_of(self.name)
            forwards, backwards = (equations.completed(q) for q in (forwards, backwards))
        sharpness = 0.0 if self.name == "lugre" else self.sharpness
        law = _Law(kind, len(forwards), at(forwards), at(backwards), sharpness)
        law.equations = equations and equations.address
        law.kept = forwards, backwards
        return law


@cache
def _library() -> Any:
    loaded = ct.CDLL(str(Path(__file__).parent / "c" / f"libidentification{SUFFIX}"))
    array, number, many = ct.c_void_p, ct.c_double, ct.c_int64
    for name, *types in (
        ("friction_along", array, array, array, array, array, many, array, array, array),
        ("mean_friction_along", array, array, array, many, number, ct.c_int, array),
        ("force_behind_spring", array, array, array, many, number, number, number, array),
        ("force_behind_gap", array, array, array, many, number, number, number, array),
        ("score", array, array, array, many, number, array, array, ct.c_int),
        ("with_backlash", array, array, many, array, array),
    ):
        function = getattr(loaded, name)
        function.argtypes = types
        function.restype = number if name == "score" else None
    return loaded


def friction_along(
    law: LawValues,
    x: Vector,
    v: Vector,
    step: Vector,
    starts: Bounds,
    shifts: Vector,
    vibration: Vector,
) -> Vector:
    """Friction along several records, end to end, shape (n,) [N].

    Parameters
    ----------
    law : LawValues
    x, v : ndarray, shape (n,)
        Position [m] and velocity [m/s] at the samples.
    step : ndarray, shape (records,)
        Sampling intervals [s].
    starts : ndarray of int, shape (records + 1,)
        First sample of each record; the last entry is n.
    shifts : ndarray, shape (records,)
        Displacement of each record before its first sample, from a state without force [m].
    vibration : ndarray, shape (records,)
        Mean speed of a vibration that the samples do not show; it reduces the
        deflection without net motion [m/s].
    """
    friction = np.empty(len(x))
    _library().friction_along(
        ct.byref(law.told()),
        at(x),
        at(v),
        at(step),
        starts.ctypes.data,
        len(starts) - 1,
        at(shifts),
        at(vibration),
        at(friction),
    )
    return friction


def mean_friction_along(law: LawValues, x: Vector, v: Vector, step: float, parts: int) -> Vector:
    """Friction along one record, mean over the interval after each sample, shape (n,) [N].

    Between samples the motion is the cubic through both positions and velocities, in `parts` steps;
    the last value repeats that of the previous interval.

    Parameters
    ----------
    law : LawValues
    x, v : ndarray, shape (n,)
        Position [m] and velocity [m/s].
    step : float
        Sampling interval [s].
    parts : int
    """
    friction = np.empty(len(x))
    _library().mean_friction_along(
        ct.byref(law.told()), at(x), at(v), len(x), step, parts, at(friction)
    )
    return friction


def force_behind(
    joint: str, law: LawValues, x: Vector, v: Vector, step: float, size: float, mass: float
) -> Vector:
    """Force on the driving side of a joint with a block and its friction behind it, shape (n,) [N].

    A spring has its own damping, as in machine parts. In a gap, the block starts in the middle;
    contact is lost if the block would have to be pulled, by friction or by its mass, and contact
    again is without rebound.

    Parameters
    ----------
    joint : {"spring", "gap"}
    law : LawValues
    x, v : ndarray, shape (n,)
        Motion on the driving side of the joint [m], [m/s].
    step : float
        Sampling interval [s].
    size, mass : float
        Stiffness of the spring [N/m] or width of the gap [m], and the block's mass [kg].

    Returns
    -------
    ndarray, shape (n,)
        Mean over the interval after each sample [N].
    """
    force = np.empty(len(x))
    follow = getattr(_library(), f"force_behind_{joint}")
    follow(ct.byref(law.told()), at(x), at(v), len(x), step, size, mass, at(force))
    return force


def score(
    force: Vector,
    predicted: Vector,
    spread: Vector,
    count: float,
    gradient: Matrix,
    information: Matrix,
    cost_only: bool,
) -> float:
    """Return minus the log-likelihood of force samples that were rounded to counts.

    Parameters
    ----------
    force, predicted, spread : ndarray, shape (n,)
        Measured and predicted force and the standard deviation before rounding [N].
    count : float
        Resolution of the load cell [N]; 0 for none.
    gradient : ndarray, shape (2, n)
        Filled with the derivatives of the log-likelihood by the prediction and by the spread [1/N].
    information : ndarray, shape (3, n)
        Filled with the expected products of these two: prediction twice, both, spread twice
        [1/N^2], unless `cost_only`.
    """
    arrays = at(force), at(predicted), at(spread)
    return float(
        _library().score(*arrays, len(force), count, at(gradient), at(information), cost_only)
    )


def with_backlash(x: Vector, starts: Bounds, backlash: Vector) -> Vector:
    """Positions that are short by `backlash` [m] after a record's start and after each reversal.

    The error of the reconstruction at corners is the same at all corners and in all records, and a
    replay of the rounded corners shows only a part of it.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Position [m].
    starts : ndarray of int, shape (records + 1,)
    backlash : ndarray, shape (records,)
    """
    dragged = np.empty_like(x)
    _library().with_backlash(at(x), starts.ctypes.data, len(backlash), at(backlash), at(dragged))
    return dragged
