"""Interface of a cause: its effect on a record, and its effect on the plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import sympy as sp

from ....plant.ball_screw import bare_ball_screw
from ....solver.arrays import Matrix, Vector
from ....solver.component import Component, ForceTerm, Parameter, symbol
from ..drive import Drive, compiled
from ..modelled_record import ModelledRecord

FRICTION = symbol("friction")
"""The total friction force of the prior law, opposing motion [N]."""

DRY = symbol("dry_friction")
"""The same without the part proportional to velocity [N]."""

ENGAGED = symbol("engaged")
"""Friction since a reversal as a share of sliding friction, with its sign, -1 to 1."""

RELAXATION = symbol("relaxation_time")
"""Time by which bristle damping leads deflection, sigma1/sigma0; 0 without bristles [s]."""

ACTING = symbol("acting")
"""Force of the motor or drive on the moving bodies [N]."""


@dataclass(frozen=True)
class Shape:
    """One possible effect of a cause on records.

    Attributes
    ----------
    amplitudes : tuple of str
        Names of its linear parameters; if each record has its own, with a dot and the record's
        number.
    force, command : list of ndarray, shape (n, amplitudes), one per record; None: nothing
        Force against motion in +x [N] and change of the command [its unit] for each amplitude of
        one.
    values : mapping of str to float
        Values of the other parameters, SI.
    sure : float, optional
        The amplitude is one, plus or minus this: the size of the effect is in `values`.
    freed : tuple of str
        Instead of a force: parameters of the model without a tolerance.
    """

    amplitudes: tuple[str, ...]
    force: list[Matrix] | None = None
    command: list[Matrix] | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    sure: float | None = None
    freed: tuple[str, ...] = ()


Courses = Sequence[ModelledRecord]
Values = Mapping[str, float]
Smaller = Callable[[Courses, Shape, Vector], float]
Grid = Callable[[Courses, Drive], list[Values]]
Signals = Callable[[Courses, Drive, Values], Sequence[Mapping[str, Vector]]]

_SOME = 1e-3  # smallest command used, as a share of the largest
_LEAST = 1e-3  # smallest remaining share of a command


def of_command(courses: Courses, shape: Shape, amplitudes: Vector) -> float:
    """Factor by which a shape makes a command smaller, as a geometric mean; at most one."""
    logs = []
    for c, change in zip(courses, shape.command or [], strict=True):
        given, asked = np.abs(c.u + change @ amplitudes), np.abs(c.u)
        some = asked > _SOME * float(np.max(asked))
        logs.append(np.log(np.maximum(given[some] / asked[some], _LEAST)))
    return min(float(np.exp(np.mean(np.concatenate(logs)))), 1.0)


@dataclass(frozen=True)
class Mechanism:
    """One form of a cause, distinguished from other forms by the names of its values.

    Attributes
    ----------
    parameters : tuple of Parameter
        Its parameters; with the defaults it has no effect.
    at : function of (courses, model, values) to a Shape
    grid : function of (courses, model) to a list of mappings
        Values of its nonlinear parameters to try; one empty mapping without such parameters.
    extend : function of (plant, curve, cause) to a plant
        The plant with the cause, before sticking is added; `curve` is the friction in steady
        sliding without its viscous part, as a function of ``v``. The same plant if only its values
        change.
    refined : str
        Name of the value that is refined between grid points, if any.
    """

    parameters: tuple[Parameter, ...]
    at: Callable[[Courses, Drive, Values], Shape]
    grid: Grid = lambda courses, model: [{}]
    extend: Callable[[Component, sp.Expr, Cause], Component] = lambda plant, curve, cause: plant
    refined: str = ""


@dataclass(frozen=True)
class Cause:
    """One possible error or omission of a model.

    Attributes
    ----------
    name : str
    says : str
        Description for an engineer, in a clause.
    mechanisms : tuple of Mechanism
    confirm : str
        Experiment that would confirm it.
    mistaken_for : tuple of str
    beyond : function of (courses, model) to str or None
        Reason why these records cannot show it.
    smaller : function of (courses, shape, amplitudes) to a number, optional
        Factor by which it makes a residual of pure noise smaller, such as `of_command`.
    """

    name: str
    says: str
    mechanisms: tuple[Mechanism, ...]
    confirm: str
    mistaken_for: tuple[str, ...] = ()
    beyond: Callable[[Courses, Drive], str | None] = lambda courses, model: None
    smaller: Smaller | None = None

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(dict.fromkeys(p for m in self.mechanisms for p in m.parameters))

    def grid(self, courses: Courses, model: Drive) -> list[Values]:
        """Values to try, of all mechanisms."""
        return [values for m in self.mechanisms for values in m.grid(courses, model)]

    def at(self, courses: Courses, model: Drive, values: Values) -> Shape:
        """Its effect on these records."""
        return self._told_by(values).at(courses, model, values)

    def extend(self, plant: Component, curve: sp.Expr, values: Values) -> Component:
        """The plant with the cause, see `Mechanism`."""
        return self._told_by(values).extend(plant, curve, self)

    def refined_of(self, values: Values) -> str | None:
        """Name of the value that is refined between grid points, if any."""
        return self._told_by(values).refined or None

    def _told_by(self, values: Values) -> Mechanism:
        own = (m for m in self.mechanisms if set(values) <= {p.name for p in m.parameters})
        return next(own, self.mechanisms[0])


def parameter(name: str, unit: str, meaning: str, default: float = 0.0) -> Parameter:
    """A parameter estimated by a diagnosis."""
    return Parameter(name, default, unit, meaning, "found in measured data")


def no_signals(courses: Courses, model: Drive, values: Values) -> Sequence[Mapping[str, Vector]]:
    return [{}] * len(courses)


def force(
    amplitudes: Mapping[Parameter, sp.Expr],
    constants: tuple[Parameter, ...] = (),
    grid: Grid = lambda courses, model: [{}],
    refined: str = "",
    per_record: bool = False,
    signals: Signals = no_signals,
) -> Mechanism:
    """An additional force, linear in its amplitudes.

    Parameters
    ----------
    amplitudes : mapping of Parameter to expression
        Force against motion in +x for an amplitude of one, in the symbols ``x``, ``v``, ``t``,
        `FRICTION`, `DRY`, `RELAXATION`, `ACTING`, the plant's parameters and the `constants`.
    constants : tuple of Parameter, optional
        Its nonlinear parameters.
    grid, refined
        As in `Mechanism`.
    per_record : bool
        Each record has its own amplitudes, for example if a phase changes with each homing.
    signals : function of (courses, model, values) to a mapping for each record, optional
        Signals along the record that replace constant values, by symbol.
    """
    names = tuple(p.name for p in amplitudes)
    parameters = (*amplitudes, *constants)

    def at(courses: Courses, model: Drive, values: Values) -> Shape:
        more = signals(courses, model, values)
        forces = [
            _along(tuple(amplitudes.values()), c, model, values, own)
            for c, own in zip(courses, more, strict=True)
        ]
        told = names
        if per_record and len(courses) > 1:
            told = tuple(f"{n}.{r + 1}" for r in range(len(courses)) for n in names)
            forces = [
                np.hstack([f if r == k else np.zeros_like(f) for k in range(len(courses))])
                for r, f in enumerate(forces)
            ]
        return Shape(told, force=forces, values=values)

    def extend(plant: Component, curve: sp.Expr, cause: Cause) -> Component:
        friction = -next(t.force for t in plant.terms if t.name == "friction")
        known = {p.name for p in plant.all_parameters}
        bristle = friction - symbol("sigma2") * symbol("v") if "sigma2" in known else friction
        table = {
            FRICTION: friction,
            DRY: bristle,
            ENGAGED: bristle / curve,
            ACTING: next(t.force for t in plant.terms if t.name in ("motor", "drive")),
            RELAXATION: symbol("sigma1") / symbol("sigma0") if "sigma0" in known else sp.Integer(0),
        }
        opposing = sp.Add(*[symbol(p.name) * e for p, e in amplitudes.items()])
        new = tuple(p for p in parameters if p.name not in known)
        return plant.with_force(
            ForceTerm(cause.name, -opposing.xreplace(table), cause.says, parameters=new)
        )

    return Mechanism(parameters, at, grid, extend, refined)


def voltage(
    changed: Mapping[sp.Symbol, sp.Expr],
    parameters: tuple[Parameter, ...],
    grid: Grid,
    refined: str = "",
    sure: float | None = None,
    signals: Signals = no_signals,
) -> Mechanism:
    """A change between the command and the motor's current.

    Parameters
    ----------
    changed : mapping of Symbol to expression
        Expressions that replace ``u`` or ``R`` in the winding's balance.
    parameters : tuple of Parameter
        The first is its amplitude. A plant that has all of them already has such an equation.
    sure : float, optional
        As in `Shape`; otherwise the change is proportional to the amplitude.
    """
    first = parameters[0].name
    before = symbol("L") * bare_ball_screw().derivative("i")
    after = sp.expand(before).xreplace(dict(changed))
    change = after - sp.expand(before) if sure else sp.diff(after, symbol(first))

    def at(courses: Courses, model: Drive, values: Values) -> Shape:
        more = signals(courses, model, values)
        command = [
            _along((change,), c, model, values, own) for c, own in zip(courses, more, strict=True)
        ]
        return Shape((first,), command=command, values=values, sure=sure)

    def extend(plant: Component, curve: sp.Expr, cause: Cause) -> Component:
        known = {p.name for p in plant.all_parameters}
        new = [p for p in parameters if p.name not in known]
        if not new:
            return plant
        return plant.substituted(changed, parameters=(*plant.parameters, *new))

    return Mechanism(parameters, at, grid, extend, refined)


def engaged(course: ModelledRecord, model: Drive) -> Vector:
    """`ENGAGED` along a record, shape (n,)."""
    return np.asarray(course.bristle / model.curve(course.middle_v))


def _along(
    expressions: tuple[sp.Expr, ...],
    course: ModelledRecord,
    model: Drive,
    values: Values,
    own: Mapping[str, Vector],
) -> Matrix:
    """Values of expressions along a record, shape (n, expressions)."""
    signals: dict[str, Callable[[], Vector]] = {
        "x": lambda: course.middle_x,
        "v": lambda: course.middle_v,
        "t": lambda: course.time + 0.5 * course.step,
        "u": lambda: course.u,
        "i": lambda: course.mean_i,
        FRICTION.name: lambda: course.bristle + model.linear_friction * course.middle_v,
        DRY.name: lambda: course.bristle,
        ENGAGED.name: lambda: engaged(course, model),
        ACTING.name: lambda: (
            model.per_ampere * course.mean_i if model.has_motor else model.values["gain"] * course.u
        ),
    }
    stiffness = model.values.get("sigma0", 0.0)
    relaxation = model.values.get("sigma1", 0.0) / stiffness if stiffness else 0.0
    numbers = {**model.values, RELAXATION.name: relaxation, **values, **own}
    columns = []
    for expression in expressions:
        free, function = compiled(expression)
        given = [signals[n]() if n in signals and n not in own else numbers[n] for n in free]
        columns.append(np.broadcast_to(function(*given), course.x.shape))
    return np.column_stack(columns)
