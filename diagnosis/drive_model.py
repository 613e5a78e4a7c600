"""The drive as its user believes it to be, in the form a diagnosis needs.

What is linear (motor, inertia, viscous friction) goes into a filter; the rest of the friction law
is integrated along the measured motion and enters the filter as a known force.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import numpy.typing as npt
import sympy as sp

from ..identification.fitted_law import BRISTLES, LAWS
from ..identification.law_along_record import (
    LawValues,
    force_behind_gap,
    force_behind_spring,
    mean_friction_along,
)
from ..plant.law import claims
from ..solver.component import symbol

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

MOTOR = ("kt", "ke", "R", "L", "m", "Jm")
DIRECT = ("m", "gain", "offset")
BEND = ("dF_low", "V_mismatch")  # of friction at low speed, N and m/s; see stribeck_mismatch
_SLOWEST = 1e-5  # at which a curve is taken instead of at rest [m/s]
_FREED = 0.3  # relative spread of a value that may be anything
_MORE_MASS = 2.0  # spread of an unknown mass, relative to all that moves
_FINEST = 2.5e-4  # step of the law between two samples [s]


@dataclass(frozen=True)
class DriveModel:
    """A drive with a friction law and the prior values of it.

    Attributes
    ----------
    kind : {"ball_screw", "drive"}
        With a DC motor and a voltage `u`, or a body on which ``gain*u`` acts as a force.
    law : str
        One of ``LAWS`` of the estimator.
    values : mapping of str to float
        All parameters, SI.
    tolerance : mapping of str to float
        Relative tolerance of each value that may be adjusted: its uniform spread, plus or minus.
    """

    kind: str
    law: str
    values: Mapping[str, float]
    tolerance: Mapping[str, float] = field(default_factory=dict)

    @property
    def has_motor(self) -> bool:
        return self.kind == "ball_screw"

    @property
    def adjustable(self) -> tuple[str, ...]:
        """Parameters that a record may speak of."""
        names = (*(MOTOR if self.has_motor else DIRECT), *self.law_parameters)
        return tuple(n for n in names if self.values.get(n) and self.tolerance.get(n, 0.0) > 0)

    @property
    def law_parameters(self) -> tuple[str, ...]:
        law = LAWS[self.law]
        if law.directional:
            return tuple(f"{n}_{side}" for side in ("pos", "neg") for n in law.parameters)
        return law.parameters

    @property
    def turn(self) -> float:
        """Angle of the screw per way [rad/m]."""
        return 2 * math.pi * self.values["p"]

    @property
    def inertia(self) -> float:
        """Of all that moves [kg]."""
        v = self.values
        return v["m"] + (v["Jm"] * self.turn**2 if self.has_motor else 0.0)

    @property
    def block(self) -> float:
        """Of what friction acts on; half of a drive whose parts nobody told [kg]."""
        return self.values["m"] * (1.0 if self.has_motor else 0.5)

    @property
    def per_ampere(self) -> float:
        """Force of the motor [N/A]."""
        return self.values["kt"] * self.turn

    @property
    def back_emf(self) -> float:
        """[V*s/m]"""
        return self.values["ke"] * self.turn

    @property
    def per_command(self) -> float:
        """Force that a lasting command holds at rest, per its unit [N/V]."""
        if self.has_motor:
            return self.per_ampere / self.values["R"]
        return self.values["gain"]

    @property
    def braking(self) -> float:
        """What of the drive's force goes with velocity, beside friction [N*s/m]."""
        return self.per_command * self.back_emf if self.has_motor else 0.0

    @property
    def can_bend(self) -> bool:
        """Whether the law's curve can be given one more bend, see `BEND`."""
        return self.law in BRISTLES

    @property
    def linear_friction(self) -> float:
        """Viscous coefficient that the filter takes care of [N*s/m]."""
        return self.values["sigma2"] if "sigma2" in self.law_parameters else 0.0

    @property
    def damping(self) -> float:
        """What slows a motion in proportion to its velocity [N*s/m]."""
        return self.linear_friction + self.braking

    @property
    def friction_scale(self) -> float:
        """Size of the friction while sliding slowly [N]."""
        v = self.values
        for names in (("Fc",), ("Fc_pos",)):
            if all(n in v for n in names):
                return abs(v[names[0]])
        if self.law == "bliman_sorine":
            return abs(v["f1"] - v["f2"])
        return float(abs(self.curve(np.zeros(1))[0]))

    def free_spread(self, name: str) -> float:
        """Relative spread of a value that may be anything, a mass most of all."""
        return _MORE_MASS * self.inertia / self.values["m"] if name == "m" else _FREED

    def changed(self, values: Mapping[str, float]) -> DriveModel:
        return replace(self, values={**self.values, **values})

    def curve(self, v: Vector) -> Vector:
        """Friction of steady sliding at these speeds, without its viscous part, shape (n,) [N]."""
        speed = np.abs(v) + _SLOWEST
        names, curve = _compiled_curve(self.law)
        numbers = {**self.values, "v": speed}
        return np.broadcast_to(curve(*(numbers[n] for n in names)), speed.shape)

    def friction(self, x: Vector, v: Vector, step: float) -> Vector:
        """The law along a motion, without what is linear in velocity, shape (n,) [N].

        On average over the interval after each sample, as are all forces here.
        """
        parts = max(1, math.ceil(step / _FINEST))
        motion = np.ascontiguousarray(x), np.ascontiguousarray(v)
        out = mean_friction_along(self._law_values(), *motion, step, parts)
        out -= self.linear_friction * midway(v)
        if not self.has_motor:
            out += self.values["offset"]
        return out

    def force_behind_gap(self, x: Vector, v: Vector, step: float, gap: float) -> Vector:
        """Force on what pushes the block across a gap [m], shape (n,) [N]."""
        return force_behind_gap(self._law_values(), x, v, step, gap, self.block)

    def force_behind_spring(self, x: Vector, v: Vector, step: float, stiffness: float) -> Vector:
        """Force of a spring [N/m] that drags the block, shape (n,) [N]."""
        return force_behind_spring(self._law_values(), x, v, step, stiffness, self.block)

    def _law_values(self) -> LawValues:
        half = len(LAWS[self.law].parameters)
        q = np.array([self.values[n] for n in self.law_parameters])
        bend = [self.values[n] for n in BEND] if self.can_bend and BEND[0] in self.values else []
        forwards, backwards = np.append(q[:half], bend), np.append(q[-half:], bend)
        return LawValues(self.law, forwards, backwards, self.values.get("Kv", 0.0))


@cache
def curve_of(law: str) -> sp.Expr:
    """Friction of steady sliding in +x as a function of ``v``, without its viscous part."""
    steady, v = sp.sympify(claims(law).steady_state), symbol("v")
    viscous = symbol("sigma2") * v if symbol("sigma2") in steady.free_symbols else sp.Integer(0)
    return steady - viscous


@cache
def _compiled_curve(law: str) -> tuple[tuple[str, ...], Callable[..., Vector]]:
    """Names of the symbols of `curve_of`, and a function of them."""
    names = tuple(sorted(s.name for s in curve_of(law).free_symbols))
    return names, sp.lambdify([symbol(n) for n in names], curve_of(law), "numpy")


def midway(values: Vector) -> Vector:
    """Mean over the interval after each sample, shape (n,)."""
    return np.append(0.5 * (values[1:] + values[:-1]), values[-1])
