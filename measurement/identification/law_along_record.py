"""The friction laws along a given motion, compiled: what the estimators fit, see ``c/laws.c``.

The equations come from ``plant``, see `laws_in_c`; a test compares each law with a stiff solver.
For a law without an exact step there, the core solves its equations from sample to sample, which
takes ten times as long.
"""

from __future__ import annotations

import ctypes as ct
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...plant import LAWS
from ...plant.law import Law, law
from ...plant.modified_lugre import KV
from ...solver.arrays import Matrix, Vector
from ...solver.component import Component, Input, symbol
from ...solver.core import NEXT_STEP, SUFFIX, at, library
from ...solver.kernel import DEFAULT_TOLERANCE, Model
from ...solver.stored import stored_kernel
from .fitted_law import FORMS, fitted_law

Bounds = npt.NDArray[np.int64]

SHARPNESS = KV.default  # of the modified law [s/m]; records give no information on it


class _Equations(ct.Structure):
    _fields_ = (
        *((name, ct.c_void_p) for name in ("step", "output", "instance", "x", "v", "p")),
        *((name, ct.c_void_p) for name in ("next_step", "start", "friction")),
        ("states", ct.c_int64),
        ("tolerance", ct.c_double),
    )


class LawEquations:
    """A law's equations at an `address` for compiled code, with the memory for their solution."""

    def __init__(self, name: str) -> None:
        part = f"along_{name}"
        module = LAWS[name].partition(":")[0]
        kernel = stored_kernel(part, lambda: _along(law(name), part), __name__, module)
        model = Model(kernel)
        if len(model.x) > (most := ct.c_int64.in_dll(_library(), "most_states").value):
            raise ValueError(f"{name} has {len(model.x)} states, expected {most} at most")
        self._defaults = model.p.copy()
        names = [p.name for p in kernel.parameters]
        self._fitted = [names.index(n) for n in fitted_law(name).parameters]
        outputs, start = np.zeros(len(kernel.outputs)), model.x.copy()
        friction = [o.name for o in kernel.outputs].index("friction")
        memory = model.x, model.u, model.p, outputs, model.atol, model.info
        x, u, p, y, atol, info = memory
        instance = model.system.instance(x, u, p, y, atol, info)
        step, output = (
            ct.cast(getattr(library(), f"core_{n}"), ct.c_void_p).value for n in ("step", "output")
        )
        places = instance.address, at(x), at(u), at(p), at(info[NEXT_STEP:]), at(start)
        equations = _Equations(step, output, *places, at(y[friction:]), len(x), DEFAULT_TOLERANCE)
        self._kept = model, memory, start, instance, equations
        self.address = ct.addressof(equations)

    def completed(self, fitted: Vector) -> Vector:
        """All parameters of the law, from the fitted ones."""
        values = self._defaults.copy()
        values[self._fitted] = fitted
        return values


equations_of = cache(LawEquations)


def _along(friction: Law, name: str) -> Component:
    """The component of a law at a velocity `v`."""
    term = friction(symbol("v"))
    return Component(
        name=name,
        description=f"Along a record: {term.meaning.split(',')[0]}",
        parameters=term.parameters,
        inputs=(Input("v", "m/s", "velocity", nominal=1e-3),),
        states=term.states,
        outputs=tuple(o for o in term.outputs if o.name == "friction"),
    )


class _Law(ct.Structure):
    kept: tuple[Vector, Vector]
    _fields_ = (
        ("form", ct.c_int32),
        ("count", ct.c_int32),
        ("forwards", ct.c_void_p),
        ("backwards", ct.c_void_p),
        ("sharpness", ct.c_double),
        ("equations", ct.c_void_p),
    )


@dataclass(frozen=True)
class LawValues:
    """A law with its parameters by direction of motion, in the order of `fitted_law`.

    LuGre's sigma0 depends on the direction in which the bristles are bent. With two additional
    parameters, its curve has another bend at low speed.
    """

    name: str
    forwards: Vector
    backwards: Vector
    sharpness: float = SHARPNESS  # Kv of the modified law [s/m]; 0 for abs(v), as in the original

    def for_c(self) -> _Law:
        """The law for compiled code; `self` must exist as long as it is used."""
        fitted = fitted_law(self.name)
        forwards, backwards, equations = self.forwards, self.backwards, None
        if fitted.form == FORMS[-1]:
            equations = equations_of(self.name)
            forwards, backwards = (equations.completed(q) for q in (forwards, backwards))
        sharpness = self.sharpness if "Kv" in fitted.unseen else 0.0
        law = _Law(FORMS.index(fitted.form), len(forwards), at(forwards), at(backwards), sharpness)
        law.equations = equations and equations.address
        law.kept = forwards, backwards
        return law


@cache
def _library() -> Any:
    loaded = ct.CDLL(str(Path(__file__).parent / "c" / f"libidentification{SUFFIX}"))
    loaded.score.restype = ct.c_double
    return loaded


def _call(name: str, *given: Any) -> Any:
    """Call a compiled function with laws, arrays, floats and integers of 64 bits."""

    def taken(value: Any) -> Any:
        if isinstance(value, LawValues):
            return ct.byref(value.for_c())
        if isinstance(value, np.ndarray):
            floats = value.dtype == np.float64
            return ct.c_void_p(at(value) if floats else value.ctypes.data)
        return ct.c_double(value) if isinstance(value, float) else ct.c_int64(value)

    return getattr(_library(), name)(*map(taken, given))


def friction_along(
    law: LawValues, x: Vector, v: Vector, step: Vector, starts: Bounds, own: Matrix
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
    own : ndarray, shape (5, records)
        Displacement of each record before its first sample, from a state without force [m]; the
        position from which its scale is wrong [m], the error of scale there, and its change with
        the distance [1/m]; mean speed of a vibration that the samples do not show, which reduces
        the deflection without net motion [m/s].
    """
    friction = np.empty(len(x))
    _call("friction_along", law, x, v, step, starts, len(step), own, friction)
    return friction


def delayed(forces: Matrix, starts: Bounds, late: Vector) -> Matrix:
    """Forces of records, shape (..., n), delayed by `late` samples of each, shape (records,).

    The filter keeps the size of all frequencies: interpolation would reduce the noise of the
    acceleration, and a fit would then prefer a delay of half a sample.
    """
    n, out = forces.shape[-1], np.empty_like(forces)
    _call("delayed", forces, forces.size // n, n, starts, len(late), late, out)
    return out


def mean_friction_along(law: LawValues, x: Vector, v: Vector, step: float, parts: int) -> Vector:
    """Friction along one record, mean over the interval after each sample, shape (n,) [N].

    Between samples, `step` [s] apart, the motion is the cubic through both positions [m] and
    velocities [m/s], in `parts` steps; the last value repeats that of the previous interval.
    """
    friction = np.empty(len(x))
    _call("mean_friction_along", law, x, v, len(x), float(step), parts, friction)
    return friction


def force_behind(
    joint: str, law: LawValues, x: Vector, v: Vector, step: float, size: float, mass: float
) -> Vector:
    """Force on the driving side of a joint with a block and its friction behind it, shape (n,) [N].

    A spring has its own damping, as in machine parts. In a gap, the block starts in the middle;
    contact is lost if the block would have to be pulled, by friction or by its mass, and contact
    again is without rebound. Forces are means over the interval after each sample.

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
    """
    force = np.empty(len(x))
    sizes = float(step), float(size), float(mass)
    _call(f"force_behind_{joint}", law, x, v, len(x), *sizes, force)
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
    given = force, predicted, spread, len(force), float(count)
    return float(_call("score", *given, gradient, information, cost_only))


def with_backlash(x: Vector, starts: Bounds, backlash: Vector) -> Vector:
    """Positions short by `backlash` [m], of each record, after its start and after each reversal.

    The error of the reconstruction at corners is the same at all corners and in all records, and a
    replay of the rounded corners shows only a part of it.
    """
    dragged = np.empty_like(x)
    _call("with_backlash", x, starts, len(backlash), backlash, dragged)
    return dragged
