"""The model of a drive: values of a plant, their tolerances, and the command it takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from ...fmus.interface import START
from ...orchestration.loop.parameter_file import BALL_SCREW, DRIVE, ParameterFile, Value
from ...plant import DEFAULT_LAW
from ...plant.ball_screw import bare_ball_screw
from ...plant.direct_drive import bare_direct_drive
from ...plant.instruments import UNITS
from ...plant.instruments.amplifier import PARAMETERS as AMPLIFIER
from ...plant.law import claims
from ...plant.law import law as friction_law
from ...plant.two_masses import block_of
from ...solver.arrays import Vector
from ...solver.component import Component, symbol
from ...solver.errors import BadParameters, BadRecord
from ..identification.fitted_law import fitted_law
from ..identification.law_along_record import LawValues, mean_friction_along
from ..records.record import CURRENT, FORCE, TORQUE, VOLTAGE, Record

TOLERANCE = 0.03  # relative tolerance of a value without a given tolerance
BEND = ("dF_low", "V_mismatch")  # bend of friction at low speed, N and m/s; see stribeck_mismatch
_PLANTS = {BALL_SCREW: bare_ball_screw, DRIVE: bare_direct_drive}
_NEVER_ADJUSTED = ("L", "p", "Kv", "offset")
WIDEST = 0.9  # largest relative change of a value, also if its interval is wider than the value
SLOWEST = sp.Float("1e-5")  # speed at which a curve is evaluated instead of at rest [m/s]
_TURN = symbol("turn")  # screw angle per travel; pi is then in the equations only once [rad/m]
SPREAD = 0.3  # relative; of a value that is freed, and of a size on a grid
_FINEST = 2.5e-4  # largest step of the law between two samples [s]


class Linear(NamedTuple):
    """Linear part of a plant's equations; zero for what belongs to a motor and there is none."""

    inertia: float  # total moving mass [kg]
    block: float  # mass of the body on which friction acts [kg]
    per_ampere: float  # force of the motor per ampere [N/A]
    back_emf: float  # per velocity [V*s/m]
    per_command: float  # static force per unit of a constant command [N/V]


@dataclass(frozen=True)
class Drive:
    """A drive with a friction law, its prior values and their tolerances."""

    kind: str  # a ball screw with its motor, or a body on which ``gain*u`` acts as a force
    law: str  # one of ``LAWS`` of the plants
    values: Mapping[str, float]  # all parameters of its `plant`, SI
    tolerance: Mapping[str, float] = field(default_factory=dict)  # relative; of what is adjusted
    command: str = ""  # kind of `u`; empty: as in the records
    turns: bool = False  # the body rotates; its values are stored as those of a sliding one

    @property
    def plant(self) -> Component:
        """The component without a sticking mode; its parameters have their own defaults."""
        return _plant(self.kind, self.law, self.command)

    @property
    def units(self) -> dict[str, str]:
        return {p.name: p.unit for p in self.plant.all_parameters}

    @property
    def has_motor(self) -> bool:
        return self.kind == BALL_SCREW

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameters of motor or body, and those of the law except shape parameters."""
        return (*(p.name for p in self.plant.parameters), *self.law_parameters)

    @cached_property
    def adjustable(self) -> tuple[str, ...]:
        """Parameters that can be estimated from a record."""
        tolerance = self.tolerance
        return tuple(n for n in self.parameters if self.values.get(n) and tolerance.get(n, 0.0) > 0)

    @property
    def law_parameters(self) -> tuple[str, ...]:
        return fitted_law(self.law).names

    @cached_property
    def linear(self) -> Linear:
        """The linear part of the plant's equations, without friction."""
        names, numbers = _linear_of(self.kind)
        known = {**self.values, _TURN.name: 2 * math.pi * self.values.get("p", 0.0)}
        return Linear(*map(float, numbers(*(known[n] for n in names))))

    @property
    def linear_friction(self) -> float:
        """Viscous coefficient in the linear filter [N*s/m]."""
        return self.values["sigma2"] if "sigma2" in self.law_parameters else 0.0

    @property
    def damping(self) -> float:
        """Total damping: viscous friction and the motor's back-EMF [N*s/m]."""
        return self.linear_friction + self.linear.per_command * self.linear.back_emf

    @property
    def friction_scale(self) -> float:
        """Friction in slow sliding [N]."""
        sliding = next((self.values[n] for n in ("Fc", "Fc_pos") if n in self.values), None)
        return abs(float(self.curve(np.zeros(1))[0]) if sliding is None else sliding)

    def free_spread(self, name: str) -> float:
        """Relative spread of a freed value; of a mass, the total moving mass."""
        return self.linear.inertia / self.values["m"] if name == "m" else SPREAD

    def changed(self, values: Mapping[str, float]) -> Drive:
        return replace(self, values={**self.values, **values})

    def curve(self, v: Vector) -> Vector:
        """Friction in steady sliding at these speeds, without its viscous part, shape (n,) [N]."""
        names, curve = compiled(curve_of(self.law))
        numbers = {**self.values, "v": v}
        return np.broadcast_to(curve(*(numbers[n] for n in names)), v.shape)

    def friction(self, x: Vector, v: Vector, step: float) -> Vector:
        """Friction along a motion, without its viscous part, shape (n,) [N].

        Each value is the mean over the interval after the sample, like all forces here.
        """
        parts = max(1, math.ceil(step / _FINEST))
        motion = np.ascontiguousarray(x), np.ascontiguousarray(v)
        out = mean_friction_along(self.law_values, *motion, step, parts)
        out -= self.linear_friction * midway(v)
        return out + self.values.get("offset", 0.0)

    @property
    def law_values(self) -> LawValues:
        """The law's values, as used along a motion."""
        law = fitted_law(self.law)
        half = len(law.parameters)
        q = np.array([self.values[n] for n in self.law_parameters])
        bend = [self.values[n] for n in BEND if n in self.values and law.form == "bristles"]
        forwards, backwards = np.append(q[:half], bend), np.append(q[-half:], bend)
        return LawValues(self.law, forwards, backwards, self.values.get("Kv", 0.0))


def drive_of(file: ParameterFile, law: str | None = None) -> Drive:
    """The drive that a parameter file describes, as the prior model, perhaps with another law.

    A file without ``[plant]`` is the nominal axis. The tolerance of a value is that in
    ``[tolerance]``, else half of its interval, else `TOLERANCE`. Values that only a closed loop
    needs (amplifier, initial states, controllers), those of the file's own law if it is another,
    and the table ``[found]`` are ignored. Raises BadParameters.
    """
    if file.kind not in _PLANTS:
        raise BadParameters(
            f"{file.path}: kind is {file.kind!r}, expected one of {', '.join(_PLANTS)}: the "
            "equations are needed"
        )
    own = file.law or law or DEFAULT_LAW
    laws = (own, law or own)
    plants = [_plant(file.kind, name, file.command) for name in laws]
    known = {p.name: p for plant in plants for p in plant.all_parameters}
    elsewhere = [p.name for p in AMPLIFIER]
    elsewhere += [s.name + START for plant in plants for s in plant.all_states]
    numbers = file.plant_values(known, elsewhere)
    file.check_complete({p.name: p for p in plants[-1].all_parameters}, numbers)
    values = {p.name: numbers.get(p.name, p.default) for p in plants[-1].all_parameters}
    ways = [Drive(file.kind, name, {}).parameters for name in laws]
    adjusted = {n for names in ways for n in names} - set(_NEVER_ADJUSTED)
    for name, share in file.tolerance.items():
        if name not in adjusted or not 0 <= share < 1:
            raise BadParameters(
                f"{file.path}: [tolerance] {name} = {share:g}, expected a share of its value, 0 to "
                f"1, for one of {', '.join(sorted(adjusted))}"
            )
    tolerance = {
        n: file.tolerance[n] if n in file.tolerance else _tolerance_of(file.plant.get(n))
        for n in ways[-1]
        if n in adjusted
    }
    return Drive(file.kind, laws[-1], values, tolerance, file.command, file.turns)


def _tolerance_of(value: Value | None) -> float:
    """Half of a value's interval, as a share of the value."""
    if value is None or value.interval is None or value.value == 0:
        return TOLERANCE
    low, high = value.interval
    half = max(high - value.value, value.value - low) / abs(value.value)
    return half if math.isfinite(half) and half < WIDEST else WIDEST


def commanded(records: Sequence[Record], model: Drive) -> tuple[list[Record], Drive, list[str]]:
    """Return records with a command that the model accepts, the model, and notes on changes.

    If only the current of a ball screw is known, it becomes a drive, see `driven_by_current`. The
    current of a drive is left out, because a drive has no equation for it. Raises BadRecord.
    """
    if not records:
        raise BadRecord("there is no record: expected one file of measured data at least")
    if model.has_motor and all(r.current_alone or r.command == CURRENT for r in records):
        model = driven_by_current(model)
        known = [_with_command(r, CURRENT) for r in records]
        said = (
            f"there is no voltage: the current is the command of a drive with gain = kt*2*pi*p = "
            f"{model.values['gain']:.4g} N/A and m = {model.values['m']:.4g} kg, the rotor in it"
        )
        return known, model, [f"{r.name}: {said}" for r in known]
    wanted = VOLTAGE if model.has_motor else model.command or records[0].command
    known = []
    for record in records:
        alone = record.current_alone and model.command != CURRENT
        made = record if alone else _with_command(record, wanted)
        if alone or made.command != wanted:
            has, say = f"u is a {record.command}", "its unit as unit u=UNIT"
            if alone:
                has, say = "has the current i and no command u", "map i=u unit u=A"
            raise BadRecord(
                f"{record.name}: {has}, and the {model.kind} is driven by a {wanted}; say {say}, "
                f'or command = "{CURRENT if alone else record.command}" in the parameter file, of '
                'kind = "drive", with its gain'
            )
        known.append(made)
    return known, model if model.has_motor else replace(model, command=wanted), []


def driven_by_current(model: Drive) -> Drive:
    """A ball screw as a drive whose command is the motor's current.

    The gain is the motor's force per ampere, with the tolerance of `kt`. The mass is that of all
    moving bodies; its tolerance is the mean of those of block and rotor, weighted by their masses.
    """
    known = {p.name for p in _plant(DRIVE, model.law).all_parameters}
    values = {n: v for n, v in model.values.items() if n in known}
    whole, given = model.linear.inertia, model.tolerance
    values |= {"m": whole, "gain": model.linear.per_ampere, "offset": 0.0}
    block, tolerance = model.values["m"], {n: t for n, t in given.items() if n in values}
    tolerance["gain"] = given.get("kt", 0.0)
    of_rotor = (whole - block) * given.get("Jm", 0.0)
    tolerance["m"] = (block * given.get("m", 0.0) + of_rotor) / whole
    return Drive(DRIVE, model.law, values, tolerance, CURRENT)


def _with_command(record: Record, wanted: str) -> Record:
    """The record with this command, where it can be had; `i` stays beside a voltage only.

    A recorded torque may have become a force by the lead of a screw.
    """
    u = None
    if wanted == CURRENT and (record.current_alone or record.command != CURRENT):
        u = record.signals.get("i")
    elif wanted == TORQUE and record.command == FORCE and record.lead is not None:
        u = record.u * record.lead / (2 * np.pi)
    if u is not None and np.isfinite(u).all():
        record = replace(record, signals={**record.signals, "u": u}, command=wanted)
    if "u" not in record.signals:
        raise BadRecord(f"{record.name}: there is no command u, and the current i has gaps")
    if wanted == VOLTAGE:
        return record
    return replace(record, signals={n: s for n, s in record.signals.items() if n != "i"})


@cache
def _plant(kind: str, law: str, command: str = "") -> Component:
    return _PLANTS[kind](friction_law(law)).in_units(UNITS.get(command, {}))


@cache
def curve_of(law: str) -> sp.Expr:
    """Friction in steady sliding at the speed of ``v``, in +x, without its viscous part."""
    steady, v = sp.sympify(claims(law).steady_state), symbol("v")
    viscous = symbol("sigma2") * v if symbol("sigma2") in steady.free_symbols else sp.Integer(0)
    return (steady - viscous).xreplace({v: sp.Abs(v) + SLOWEST})


@cache
def _linear_of(kind: str) -> tuple[tuple[str, ...], Callable[..., Any]]:
    """Names of the symbols of `Linear`, and a function of them, from the plant's equations."""
    plant = _plant(kind, DEFAULT_LAW)
    (balance,), (u, v, i) = plant.balances, map(symbol, ("u", "v", "i"))
    force = next(t.force for t in balance.terms if t.name in ("motor", "drive"))
    emf = held = sp.Integer(0)
    if kind == BALL_SCREW:
        rate = plant.derivative("i")
        emf = -sp.diff(rate, v) / sp.diff(rate, u)
        held = -rate.xreplace({v: sp.Integer(0), i: sp.Integer(0)}) / sp.diff(rate, i)
    per_ampere, per_command = sp.diff(force, i), sp.diff(force.xreplace({i: held}), u)
    numbers = (balance.inertia, block_of(plant), per_ampere, emf, per_command)
    return compiled(sp.Tuple(*numbers).xreplace({symbol("p"): _TURN / (2 * sp.pi)}))


@cache
def compiled(expression: sp.Basic) -> tuple[tuple[str, ...], Callable[..., Any]]:
    """Names of an expression's symbols, and a function of them."""
    free = tuple(sorted(s.name for s in sp.sympify(expression).free_symbols))
    return free, sp.lambdify([symbol(n) for n in free], expression, "numpy", cse=True)


def midway(values: Vector) -> Vector:
    """Mean over the interval after each sample, shape (n,)."""
    return np.append(0.5 * (values[1:] + values[:-1]), values[-1])
