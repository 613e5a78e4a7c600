"""Any friction law along a record: the core solves its equations from sample to sample.

Laws with an exact step are in ``c/laws.c`` and take a tenth of the time.
"""

from __future__ import annotations

import ctypes as ct
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import sympy as sp

from ...plant import LAWS
from ...plant.law import Law, law
from ...solver.component import Component, Input, symbol
from ...solver.core import NEXT_STEP, at, library
from ...solver.kernel import Model
from ...solver.stored import stored_kernel
from .fitted_law import LAWS as FITTED

Vector = npt.NDArray[np.float64]

MOST_STATES = 32  # as in c/laws.c
_TOLERANCE = 1e-9
_PLACES = ("step", "output", "instance", "x", "v", "p", "next_step", "start", "friction")


class _Equations(ct.Structure):
    _fields_ = (
        *((name, ct.c_void_p) for name in _PLACES),
        ("states", ct.c_int64),
        ("tolerance", ct.c_double),
    )


class LawEquations:
    """A law's equations with the memory for their solution.

    Attributes
    ----------
    address : int
        Address for compiled code.
    """

    def __init__(self, name: str) -> None:
        part = f"along_{name}"
        module = LAWS[name].partition(":")[0]
        kernel = stored_kernel(part, lambda: motion_to_and_fro(law(name), part), __name__, module)
        model = Model(kernel, tolerance=_TOLERANCE)
        if len(model.x) > MOST_STATES:
            raise ValueError(f"{name} has {len(model.x)} states, expected {MOST_STATES} at most")
        self._defaults = model.p.copy()
        names = [p.name for p in kernel.parameters]
        self._fitted = [names.index(n) for n in FITTED[name].parameters]
        outputs, start = np.zeros(len(kernel.outputs)), model.x.copy()
        friction = [o.name for o in kernel.outputs].index("friction")
        memory = model.x, model.u, model.p, outputs, model.atol, model.info
        x, u, p, y, atol, info = memory
        instance = model.system.instance(x, u, p, y, atol, info)
        step, output = (
            ct.cast(getattr(library(), f"core_{n}"), ct.c_void_p).value for n in ("step", "output")
        )
        places = instance.address, at(x), at(u), at(p), at(info[NEXT_STEP:]), at(start)
        told = _Equations(step, output, *places, at(y[friction:]), len(x), _TOLERANCE)
        self._kept = model, memory, start, instance, told
        self.address = ct.addressof(told)

    def completed(self, fitted: Vector) -> Vector:
        """All parameters of the law, from the fitted ones."""
        values = self._defaults.copy()
        values[self._fitted] = fitted
        return values


equations_of = cache(LawEquations)


def motion_to_and_fro(friction: Law, name: str) -> Component:
    """The component: a law at a velocity `v`, and half of the time at a velocity `back`.

    Both are equal without vibration. A vibrating body changes direction so fast that only the mean
    of both rates matters.
    """
    there, and_back = friction(symbol("v")), friction(symbol("back"))
    states = tuple(
        replace(s, derivative=(sp.sympify(s.derivative) + sp.sympify(b.derivative)) / 2)
        for s, b in zip(there.states, and_back.states, strict=True)
    )
    return Component(
        name=name,
        description=f"Along a record: {there.meaning.split(',')[0]}",
        parameters=there.parameters,
        inputs=(
            Input("v", "m/s", "velocity", nominal=1e-3),
            Input("back", "m/s", "velocity during the other half of the time", nominal=1e-3),
        ),
        states=states,
        outputs=tuple(o for o in there.outputs if o.name == "friction"),
    )
