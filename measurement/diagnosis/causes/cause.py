"""Interface of a cause: its effect on a record, and its effect on the plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import sympy as sp

from ....plant.ball_screw import bare_ball_screw
from ....solver.arrays import Matrix, Vector
from ....solver.component import Component, ForceTerm, Parameter, symbol
from ..model import Drive, compiled
from ..motion import Course

FRICTION = symbol("friction")  # the total friction force of the prior law, opposing motion [N]

DRY = symbol("dry_friction")  # the same without the part proportional to velocity [N]

ENGAGED = symbol("engaged")
"""Friction since a reversal as a share of sliding friction, with its sign, -1 to 1."""

RELAXATION = symbol("relaxation_time")
"""Time by which bristle damping leads deflection, sigma1/sigma0; 0 without bristles [s]."""

ACTING = symbol("acting")  # force of the motor or drive on the moving bodies [N]


@dataclass(frozen=True)
class Form:
    """One possible effect of a cause on records, and its columns in a catalogue.

    Force against motion in +x [N] and change of the command [its unit] are those of amplitudes of
    one, shape (n, amplitudes) for each record. If each record has its own amplitudes, their names
    have a dot and the record's number. If `sure`, the amplitude is one, plus or minus this, and the
    size of the effect is in `values`.
    """

    amplitudes: tuple[str, ...]
    force: list[Matrix] | None = None
    command: list[Matrix] | None = None
    values: Mapping[str, float] = field(default_factory=dict)  # of other parameters, SI
    sure: float | None = None
    freed: tuple[str, ...] = ()  # instead of a force: values of the model without a tolerance
    lives: str = ""  # with what a free curve varies
    name: str = ""  # of the cause; given by the catalogue, like the columns
    columns: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def added_to(self, courses: Courses, amplitudes: Vector) -> list[Course]:
        """The courses with a cause of these amplitudes in addition."""
        out = list(courses)
        for k, c in enumerate(courses):
            if self.force is not None:
                out[k] = c = replace(c, added_force=c.added_force + self.force[k] @ amplitudes)
            if self.command is not None:
                out[k] = replace(c, added_u=c.added_u + self.command[k] @ amplitudes)
        return out


Courses = Sequence[Course]
Values = Mapping[str, float]
Smaller = Callable[[Courses, Form, Vector], float]
Grid = Callable[[Courses, Drive], list[Values]]
Signals = Callable[[Courses, Drive, Values], Sequence[Mapping[str, Vector]]]
CutsNoise = Callable[[Courses, Values], bool]


def once(courses: Courses, model: Drive) -> list[Values]:
    """The grid of a form without nonlinear parameters."""
    return [{}]


CERTAIN = 0.01
"""Spread of an amplitude around one: no half sign; half a shift would average command noise."""
_LEAST = 1e-3  # smallest command that counts, as a share of the largest, and what remains of one


def of_command(courses: Courses, form: Form, amplitudes: Vector) -> float:
    """Factor by which a form makes a command smaller, as a geometric mean; at most one."""
    logs = []
    for c, change in zip(courses, form.command or [], strict=True):
        given, asked = np.abs(c.u + change @ amplitudes), np.abs(c.u)
        some = asked > _LEAST * float(np.max(asked))
        logs.append(np.log(np.maximum(given[some] / asked[some], _LEAST)))
    return min(float(np.exp(np.mean(np.concatenate(logs)))), 1.0)


@dataclass(frozen=True)
class Mechanism:
    """One form of a cause, distinguished from other forms by the names of its values.

    With the defaults of its parameters it has no effect. `grid` gives the values of nonlinear
    parameters to try, one empty mapping without such; `refined` is refined between grid points.
    `extend` gives the plant with the cause, before sticking is added; `curve` is the friction in
    steady sliding without its viscous part, as a function of ``v``. Where it `cuts_noise` of a
    recorded command more than it does anything else, it is not tried.
    """

    parameters: tuple[Parameter, ...]
    at: Callable[[Courses, Drive, Values], Form]
    grid: Grid = once
    extend: Callable[[Component, sp.Expr, Cause], Component] = lambda plant, curve, cause: plant
    refined: str = ""
    cuts_noise: CutsNoise = lambda courses, values: False


@dataclass(frozen=True)
class Cause:
    """One possible error or omission of a model, or of a recorded signal.

    Causes of the same entry are one answer unless the data split them. `beyond` gives a reason why
    records cannot show it; `smaller`, the factor by which it makes a residual of pure noise
    smaller, such as `of_command`.
    """

    name: str
    says: str  # for an engineer, in a clause
    mechanisms: tuple[Mechanism, ...]
    confirm: str  # experiment that would confirm it
    beyond: Callable[[Courses, Drive], str | None] = lambda courses, model: None
    smaller: Smaller | None = None
    entry: str = ""  # default: its name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(dict.fromkeys(p for m in self.mechanisms for p in m.parameters))

    def mechanism(self, values: Values) -> Mechanism:
        """The form that has these values."""
        own = (m for m in self.mechanisms if set(values) <= {p.name for p in m.parameters})
        return next(own, self.mechanisms[0])

    def at(self, courses: Courses, model: Drive, values: Values) -> Form:
        """Its effect on these records."""
        return self.mechanism(values).at(courses, model, values)

    def extend(self, plant: Component, curve: sp.Expr, values: Values) -> Component:
        """The plant with the cause, see `Mechanism`."""
        return self.mechanism(values).extend(plant, curve, self)


def parameter(name: str, unit: str, meaning: str, default: float = 0.0) -> Parameter:
    """A parameter estimated by a diagnosis."""
    return Parameter(name, default, unit, meaning, "found in measured data")


def no_signals(courses: Courses, model: Drive, values: Values) -> Sequence[Mapping[str, Vector]]:
    return [{}] * len(courses)


def force(
    amplitudes: Mapping[Parameter, sp.Expr],
    constants: tuple[Parameter, ...] = (),
    grid: Grid = once,
    refined: str = "",
    per_record: bool = False,
    signals: Signals = no_signals,
) -> Mechanism:
    """An additional force, linear in its amplitudes.

    The force against motion in +x for an amplitude of one is an expression in ``x``, ``v``, ``t``,
    `FRICTION`, `DRY`, `RELAXATION`, `ACTING`, the plant's parameters and the `constants`, its
    nonlinear parameters. With `per_record`, each record has its own amplitudes, for example if a
    phase changes with each homing. `signals` along a record replace constant values, by symbol.
    """
    parameters = (*amplitudes, *constants)

    def at(courses: Courses, model: Drive, values: Values) -> Form:
        forces = _along(tuple(amplitudes.values()), courses, model, values, signals)
        names = tuple(p.name for p in amplitudes)
        if per_record and len(courses) > 1:
            names = tuple(f"{n}.{k + 1}" for k in range(len(courses)) for n in names)
            each = np.eye(len(courses))
            forces = [np.kron(k, f).astype(float) for k, f in zip(each, forces, strict=True)]
        return Form(names, force=forces, values=values)

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
        along = -opposing.xreplace(table)
        return plant.with_force(ForceTerm(cause.name, along, cause.says, parameters=new))

    return Mechanism(parameters, at, grid, extend, refined)


def of_friction(
    share: str,
    changes: Mapping[Parameter, sp.Expr],
    constants: tuple[Parameter, ...] = (),
    grid: Grid = once,
    refined: str = "",
    per_record: bool = False,
    one_way: bool = False,
) -> Mechanism:
    """A change of friction along courses, see `force`; if `one_way`, in +x with its magnitude.

    The dry part changes, and the share `share` of the rest: none or all is tried, because the
    lubricant may be the same everywhere while the surfaces differ. In a law with bristles, the
    level of friction changes, and the bristles relax with it.
    """

    def changed(course: sp.Expr) -> sp.Expr:
        relaxing = RELAXATION * symbol("v") * sp.diff(course, symbol("x"))
        found = DRY * (course + relaxing) + symbol(share) * (FRICTION - DRY) * course
        return sp.Abs(found) if one_way else found

    def either_way(courses: Courses, model: Drive) -> list[Values]:
        return [{**values, share: s} for values in grid(courses, model) for s in (0.0, 1.0)]

    says = "share of the viscous friction that changes as well"
    forces = {p: changed(course) for p, course in changes.items()}
    known = (*constants, parameter(share, "1", says))
    return force(forces, known, either_way, refined, per_record)


def voltage(
    changed: Mapping[sp.Symbol, sp.Expr],
    parameters: tuple[Parameter, ...],
    grid: Grid,
    refined: str = "",
    sure: float | None = None,
    signals: Signals = no_signals,
    cuts_noise: CutsNoise = lambda courses, values: False,
) -> Mechanism:
    """A change between the command and the motor's current, by expressions for ``u`` or ``R``.

    The first parameter is the amplitude, to which the change is proportional; or with `sure` it is
    the size, and refined. A plant that has all of them already has such an equation.
    """
    first = parameters[0].name
    before = symbol("L") * bare_ball_screw().derivative("i")
    after = sp.expand(before).xreplace(dict(changed))
    change = after - sp.expand(before) if sure else sp.diff(after, symbol(first))

    def at(courses: Courses, model: Drive, values: Values) -> Form:
        command = _along((change,), courses, model, values, signals)
        return Form((first,), command=command, values=values, sure=sure)

    def extend(plant: Component, curve: sp.Expr, cause: Cause) -> Component:
        known = {p.name for p in plant.all_parameters}
        new = [p for p in parameters if p.name not in known]
        if not new:
            return plant
        return plant.substituted(changed, parameters=(*plant.parameters, *new))

    return Mechanism(parameters, at, grid, extend, first if sure else refined, cuts_noise)


def engaged(course: Course, model: Drive) -> Vector:
    """`ENGAGED` along a record, shape (n,)."""
    return np.asarray(course.bristle / model.curve(course.middle_v))


def _along(
    expressions: tuple[sp.Expr, ...],
    courses: Courses,
    model: Drive,
    values: Values,
    signals: Signals,
) -> list[Matrix]:
    """Values of expressions along each record, shape (n, expressions)."""
    stiffness = model.values.get("sigma0", 0.0)
    relaxation = model.values.get("sigma1", 0.0) / stiffness if stiffness else 0.0
    numbers = {**model.values, RELAXATION.name: relaxation, **values}
    functions = [compiled(e) for e in expressions]
    found = []
    for course, own in zip(courses, signals(courses, model, values), strict=True):
        current = np.append(course.i[1:], course.i[-1])  # at the interval's end: it has settled
        acting = model.linear.per_ampere * current
        known: dict[str, Vector] = {
            "x": course.middle_x,
            "v": course.middle_v,
            "t": course.time + 0.5 * course.step,
            "u": course.u,
            "i": current,
            FRICTION.name: course.bristle + model.linear_friction * course.middle_v,
            DRY.name: course.bristle,
            ENGAGED.name: engaged(course, model),
            ACTING.name: acting if model.has_motor else model.values["gain"] * course.u,
        }
        given = {**numbers, **known, **own}
        columns = [function(*(given[n] for n in free)) for free, function in functions]
        found.append(np.column_stack([np.broadcast_to(c, course.x.shape) for c in columns]))
    return found
