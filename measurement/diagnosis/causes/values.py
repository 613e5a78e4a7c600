"""A value of the model that is wrong, or a wrong scale or sign of a recorded motion or current."""

from __future__ import annotations

from dataclasses import replace

from ....solver.arrays import Vector
from ..model import Drive
from ..motion import Course
from .cause import CERTAIN, Cause, Courses, Form, Mechanism, Values, parameter

_OTHERS = ("m", "Jm", "offset", "Fs", "Vs")
"""Values whose error is another cause: more mass, a load, a bend of the friction curve."""


def _sets(courses: Courses, model: Drive) -> list[Values]:
    names = [n for n in model.adjustable if n.partition("_")[0] not in _OTHERS]
    # values that are usually wrong together; any two forces together act like the mass
    levels = [(n, n.replace("Fc", "Fs")) for n in names if n.startswith("Fc")]
    pairs = [("kt", "ke"), ("Fc_pos", "Fc_neg"), *levels]
    together = [pair for pair in pairs if set(pair) <= set(model.adjustable)]
    return [{n: model.values[n] for n in those} for those in [*((n,) for n in names), *together]]


def _freed(courses: Courses, model: Drive, values: Values) -> Form:
    return Form(tuple(values), freed=tuple(values))


PARAMETER_ERROR = Cause(
    "parameter_error",
    "a value of the model is wrong",
    (Mechanism((), _freed, _sets),),
    confirm="measure that value separately",
)

UNMODELLED_INERTIA = Cause(
    "unmodelled_inertia",
    "more mass is moved than the model has",
    (
        Mechanism(
            (parameter("m", "kg", "mass of the block", 1.0),),
            lambda courses, model, values: Form(("m",), values=values, freed=("m",)),
        ),
    ),
    confirm="accelerate strongly in both directions at the same speeds: plot force over "
    "acceleration",
)

CURRENT_GAIN = "current_gain"
"""The calibration that a wrong scale of the current frees."""


def _inertial(course: Course, model: Drive) -> Vector:
    """Force that grows with the scale of x, shape (n,) [N]."""
    return model.inertia * course.mean_a + model.linear_friction * course.middle_v


def _of_motion(
    name: str, forces: list[Vector], times: float, courses: Courses, model: Drive
) -> Form:
    """A force, and the command equivalent to the motion's back-EMF."""
    emf = model.back_emf if model.has_motor else 0.0
    return Form(
        (name,),
        force=[times * f[:, None] for f in forces],
        command=[-times * emf * c.middle_v[:, None] for c in courses],
    )


def _scale_of_x(courses: Courses, model: Drive, values: Values) -> Form:
    forces = [_inertial(c, model) for c in courses]
    return _of_motion("scale_of_x", forces, 1.0, courses, model)


def _sign_of_x(courses: Courses, model: Drive, values: Values) -> Form:
    forces = [_inertial(c, model) + c.bristle for c in courses]
    return replace(_of_motion("sign_of_x", forces, -2.0, courses, model), sure=CERTAIN)


SCALE_OF_I = Cause(
    "scale_of_i",
    "the recorded current has a wrong scale",
    (Mechanism((), lambda courses, model, values: Form(("scale_of_i",), freed=(CURRENT_GAIN,))),),
    confirm="measure the current with a clamp",
    beyond=lambda courses, model: (
        None if all(c.has_current for c in courses) else "no current is recorded"
    ),
)
SCALE_OF_X = Cause(
    "scale_of_x",
    "the recorded position has a wrong scale",
    (Mechanism((), _scale_of_x),),
    confirm="move by a known distance and read the position",
    smaller=lambda courses, form, amplitudes: min(abs(1.0 + float(amplitudes[0])), 1.0),
)
SIGN_OF_X = Cause(
    "sign_of_x",
    "the recorded position has the wrong sign",
    (Mechanism((), _sign_of_x),),
    confirm="move in +x by hand and read the position",
)
