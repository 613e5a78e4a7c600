"""Interface of a cause: its effect on a record, and its effect on the plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import sympy as sp

from ...plant.ball_screw import bare_ball_screw
from ...solver.component import Component, ForceTerm, Parameter, symbol
from ..drive import Drive, compiled
from ..modelled_record import ModelledRecord

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

FRICTION = symbol("friction")
"""The whole friction force of the prior law, opposing motion [N]."""

DRY = symbol("dry_friction")
"""The same without what is proportional to velocity [N]."""

ENGAGED = symbol("engaged")
"""Share of the sliding friction that has come up since a reversal, with its sign, -1 to 1."""

RELAXATION = symbol("relaxation_time")
"""By which the bristles' damping leads their deflection, sigma1/sigma0; 0 without bristles [s]."""

ACTING = symbol("acting")
"""Force of the motor or of the drive on what moves [N]."""


@dataclass(frozen=True)
class Shape:
    """One way in which a cause may show.

    Attributes
    ----------
    amplitudes : tuple of str
        Names of the numbers in which it is linear; where each record has its own, with the
        record's number behind a dot.
    force, command : list of ndarray, shape (n, amplitudes), one per record; None: nothing
        Force against motion in +x [N] and change of the command [its unit] for each amplitude at
        one.
    values : mapping of str to float
        What the cause depends on otherwise, as it is taken here, SI.
    sure : float, optional
        The amplitude is one, give or take this: it is `values` that has the size.
    freed : tuple of str
        Instead of a force: parameters of the model that may be anything.
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

CONSTANT_SPEEDS = "2.3.1"
"""The rig's trial of constant speeds."""
_SOME = 1e-3  # of the largest command, from which on a share of it means anything
_LEAST = 1e-3  # of a command, that a shape leaves


def of_command(courses: Courses, shape: Shape, amplitudes: Vector) -> float:
    """By how much a shape makes a command smaller, as a geometric mean; at most one."""
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
        What it is told by; the defaults are those of no effect.
    at : function of (courses, model, values) to a Shape
    grid : function of (courses, model) to a list of mappings
        Values to try of what it depends on other than linearly; one empty mapping where there is
        nothing of the kind.
    extend : function of (plant, curve, cause) to a plant
        The plant, not yet able to stick, with it; `curve` is the friction of steady sliding without
        its viscous part, as a function of ``v``. The same plant where only its values are others.
    refined : str
        Which of its values is found between the grid's points, if any.
    """

    parameters: tuple[Parameter, ...]
    at: Callable[[Courses, Drive, Values], Shape]
    grid: Grid = lambda courses, model: [{}]
    extend: Callable[[Component, sp.Expr, Cause], Component] = lambda plant, curve, cause: plant
    refined: str = ""


@dataclass(frozen=True)
class Cause:
    """One thing that may be missing in a model, or wrong with it.

    Attributes
    ----------
    name : str
    says : str
        Description for an engineer, in a clause.
    mechanisms : tuple of Mechanism
    confirm : str
        What would confirm it.
    mistaken_for : tuple of str
    beyond : function of (courses, model) to str or None
        Why these records cannot show it.
    on_screw : bool
        Its force acts on the screw's side, where a load cell before the block does not feel it.
    smaller : function of (courses, shape, amplitudes) to a number, optional
        By how much it makes the whole residual smaller, were that noise, such as `of_command`.
    trial : str
        The trial of `ballscrew rig` that shows it there.
    """

    name: str
    says: str
    mechanisms: tuple[Mechanism, ...]
    confirm: str
    mistaken_for: tuple[str, ...] = ()
    beyond: Callable[[Courses, Drive], str | None] = lambda courses, model: None
    on_screw: bool = False
    smaller: Smaller | None = None
    trial: str = CONSTANT_SPEEDS

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(dict.fromkeys(p for m in self.mechanisms for p in m.parameters))

    def grid(self, courses: Courses, model: Drive) -> list[Values]:
        """Values to try, of all mechanisms."""
        return [values for m in self.mechanisms for values in m.grid(courses, model)]

    def at(self, courses: Courses, model: Drive, values: Values) -> Shape:
        """What it would do to these records."""
        return self._told_by(values).at(courses, model, values)

    def extend(self, plant: Component, curve: sp.Expr, values: Values) -> Component:
        """The plant with it, see `Mechanism`."""
        return self._told_by(values).extend(plant, curve, self)

    def refined_of(self, values: Values) -> str | None:
        """Which of these values is found between the grid's points, if any."""
        return self._told_by(values).refined or None

    def _told_by(self, values: Values) -> Mechanism:
        own = (m for m in self.mechanisms if set(values) <= {p.name for p in m.parameters})
        return next(own, self.mechanisms[0])


def parameter(name: str, unit: str, meaning: str, default: float = 0.0) -> Parameter:
    """A parameter that a diagnosis finds."""
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
    """One more force, linear in its amplitudes.

    Parameters
    ----------
    amplitudes : mapping of Parameter to expression
        Force against motion in +x for the amplitude at one, in the symbols ``x``, ``v``, ``t``,
        `FRICTION`, `DRY`, `RELAXATION`, `ACTING`, the plant's parameters and the `constants`.
    constants : tuple of Parameter, optional
        What it depends on other than linearly.
    grid, refined
        As of a `Mechanism`.
    per_record : bool
        Each record has amplitudes of its own, as where a phase is another after each homing.
    signals : function of (courses, model, values) to a mapping for each record, optional
        Of symbols to what they are along it, in place of a constant value.
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
    """A change of what lies between the command and the motor's current.

    Parameters
    ----------
    changed : mapping of Symbol to expression
        Expressions that replace ``u`` or ``R`` in the winding's balance.
    parameters : tuple of Parameter
        The first is its amplitude. A plant that has them all has such an equation already.
    sure : float, optional
        As of a `Shape`; else the change is proportional to the amplitude.
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
    """What expressions are along a record, shape (n, expressions)."""
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
