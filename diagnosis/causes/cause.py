"""What a cause is to a diagnosis: what it would do to a record, and what it does to the plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import sympy as sp

from ...solver.component import Component, ForceTerm, Parameter, symbol
from ..drive import Drive, compiled

if TYPE_CHECKING:
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


Courses = Sequence["ModelledRecord"]
Values = Mapping[str, float]
Smaller = Callable[[Courses, Shape, Vector], float]

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
class Cause:
    """One thing that may be missing in a model, or wrong with it.

    Attributes
    ----------
    name : str
    says : str
        What it is, for an engineer, in a clause.
    grid : function of (courses, model) to a list of mappings
        Values to try of what the cause depends on other than linearly; one empty mapping where
        there is nothing of the kind.
    at : function of (courses, model, values) to a Shape
    parameters : tuple of Parameter
        What it is told by; the defaults are those of no effect.
    extend : function of (plant, curve, values) to a plant
        The plant, not yet able to stick, with the cause in it; `curve` is the friction of steady
        sliding without its viscous part, as a function of ``v``; `values` are those found.
    confirm : str
        What would confirm it.
    mistaken_for : tuple of str
    refined : tuple of str
        Those of `values` that are found between the grid's points; of each form one at most.
    beyond : function of (courses, model) to str or None
        Why these records cannot show it at all.
    on_screw : bool
        Its force acts on the screw's side, where a load cell before the block does not feel it.
    smaller : function of (courses, shape, amplitudes) to a number, optional
        By how much it makes all that is left smaller, were that noise, such as `of_command`.
    """

    name: str
    says: str
    grid: Callable[[Courses, Drive], list[Values]]
    at: Callable[[Courses, Drive, Values], Shape]
    parameters: tuple[Parameter, ...]
    extend: Callable[..., Component]
    confirm: str
    mistaken_for: tuple[str, ...] = ()
    refined: tuple[str, ...] = ()
    beyond: Callable[[Courses, Drive], str | None] = lambda courses, model: None
    on_screw: bool = False
    smaller: Smaller | None = None

    def refined_of(self, values: Values) -> str | None:
        """Which of these values is found between the grid's points, if any."""
        return next((n for n in self.refined if n in values), None)


def of_forms(first: Cause, *others: Cause) -> Cause:
    """One cause that machines have in several forms, told by the names of their values.

    Name and wording are those of the first.
    """
    forms = (first, *others)

    def form_of(values: Values) -> Cause:
        return next(f for f in forms if set(values) <= {p.name for p in f.parameters})

    def grid(courses: Courses, model: Drive) -> list[Values]:
        return [values for f in forms for values in f.grid(courses, model)]

    def at(courses: Courses, model: Drive, values: Values) -> Shape:
        return form_of(values).at(courses, model, values)

    def extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
        return form_of(values).extend(plant, curve, values)

    return replace(
        first,
        grid=grid,
        at=at,
        extend=extend,
        parameters=tuple(dict.fromkeys(p for f in forms for p in f.parameters)),
        refined=tuple(dict.fromkeys(n for f in forms for n in f.refined)),
    )


def parameter(name: str, unit: str, meaning: str, default: float = 0.0) -> Parameter:
    """A parameter that a diagnosis finds."""
    return Parameter(name, default, unit, meaning, "found in measured data")


@dataclass(frozen=True)
class Constants:
    """What a force depends on other than linearly.

    Attributes
    ----------
    parameters : tuple of Parameter
    grid : function of (courses, model) to a list of mappings
        Values of them to try.
    refined : tuple of str
        As of a `Cause`.
    """

    parameters: tuple[Parameter, ...]
    grid: Callable[[Courses, Drive], list[Values]]
    refined: tuple[str, ...] = ()


NO_CONSTANTS = Constants((), lambda courses, model: [{}])


def force_cause(
    name: str,
    says: str,
    amplitudes: Mapping[Parameter, sp.Expr],
    confirm: str,
    mistaken_for: tuple[str, ...] = (),
    constants: Constants = NO_CONSTANTS,
    per_record: bool = False,
    on_screw: bool = False,
) -> Cause:
    """A cause that is one more force, linear in its amplitudes.

    Parameters
    ----------
    amplitudes : mapping of Parameter to expression
        Force against motion in +x for the amplitude at one, in the symbols ``x``, ``v``, ``t``,
        `FRICTION`, `DRY`, `RELAXATION`, `ACTING`, the plant's parameters and the `constants`.
    constants : Constants, optional
    per_record : bool
        Each record has amplitudes of its own, as where a phase is another after each homing.
    """
    names = tuple(p.name for p in amplitudes)
    expressions = list(amplitudes.values())

    def at(courses: Courses, model: Drive, values: Values) -> Shape:
        force = [_along(expressions, c, model, values) for c in courses]
        told = names
        if per_record and len(courses) > 1:
            told = tuple(f"{n}.{r + 1}" for r in range(len(courses)) for n in names)
            force = [
                np.hstack([f if r == k else np.zeros_like(f) for k in range(len(courses))])
                for r, f in enumerate(force)
            ]
        return Shape(told, force=force, values=values)

    def extend(plant: Component, curve: sp.Expr, values: Values) -> Component:
        del values
        friction = -next(t.force for t in plant.terms if t.name == "friction")
        acting = next(t.force for t in plant.terms if t.name in ("motor", "drive"))
        known = {p.name for p in plant.all_parameters}
        bristle = friction - symbol("sigma2") * symbol("v") if "sigma2" in known else friction
        relaxation = symbol("sigma1") / symbol("sigma0") if "sigma0" in known else sp.Integer(0)
        opposing = sp.Add(*[symbol(n) * e for n, e in zip(names, expressions, strict=True)])
        return plant.with_force(
            ForceTerm(
                name=name,
                force=-opposing.xreplace(
                    {
                        FRICTION: friction,
                        DRY: bristle,
                        ENGAGED: bristle / curve,
                        ACTING: acting,
                        RELAXATION: relaxation,
                    }
                ),
                meaning=says,
                parameters=tuple(
                    p for p in (*amplitudes, *constants.parameters) if p.name not in known
                ),
            )
        )

    return Cause(
        name,
        says,
        constants.grid,
        at,
        (*amplitudes, *constants.parameters),
        extend,
        confirm,
        mistaken_for,
        constants.refined,
        on_screw=on_screw,
    )


def engaged(course: ModelledRecord, model: Drive) -> Vector:
    """`ENGAGED` along a record, shape (n,)."""
    return np.asarray(course.bristle / model.curve(course.middle_v))


def _along(
    expressions: Sequence[sp.Expr],
    course: ModelledRecord,
    model: Drive,
    values: Mapping[str, float],
) -> Matrix:
    signals: dict[str, Callable[[], Vector]] = {
        "x": lambda: course.middle_x,
        "v": lambda: course.middle_v,
        "t": lambda: course.time + 0.5 * course.step,
        FRICTION.name: lambda: course.bristle + model.linear_friction * course.middle_v,
        DRY.name: lambda: course.bristle,
        ENGAGED.name: lambda: engaged(course, model),
        ACTING.name: lambda: (
            model.per_ampere * course.mean_i if model.has_motor else model.values["gain"] * course.u
        ),
    }
    stiffness = model.values.get("sigma0", 0.0)
    relaxation = model.values.get("sigma1", 0.0) / stiffness if stiffness else 0.0
    numbers = {**model.values, RELAXATION.name: relaxation, **values}
    columns = []
    for expression in expressions:
        free, function = compiled(expression)
        column = function(*(signals[n]() if n in signals else numbers[n] for n in free))
        columns.append(np.broadcast_to(column, course.x.shape))
    return np.column_stack(columns)
