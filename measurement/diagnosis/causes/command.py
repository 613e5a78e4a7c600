"""A command that arrives late or not in full, wrong values, and wrongly recorded signals.

The plant has a delay or a filter as an instrument at its input. A recorded command is held from
sample to sample, so its mean over each interval is known exactly; an expression in time has no such
steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import sympy as sp

from ....plant.instruments.amplifier import clip
from ....plant.instruments.late_command import with_command_behind, with_late_command
from ....solver.arrays import Vector
from ....solver.component import Component, Parameter, symbol
from ...records.record import fast_noise
from ..model import SPREAD, Drive
from ..motion import LONGEST, Course
from ..windows import lagged
from .cause import CERTAIN, Cause, Courses, Form, Mechanism, Values, of_command, parameter, voltage

_SHARES = 2.0 ** np.arange(-5.0, 12.0)  # delays over a sampling interval


def late(u: Vector, delay: float, step: float) -> Vector:
    """Mean over each sampling interval of a held command that comes `delay` [s] late."""
    whole, share = divmod(delay / step, 1.0)
    before = np.concatenate([np.full(int(whole) + 1, u[0]), u])[: len(u) + 1]
    return np.asarray((1.0 - share) * before[1:] + share * before[:-1])


def smeared(u: Vector, window: float, step: float) -> Vector:
    """Mean over each sampling interval of a held command averaged over a moving window [s]."""
    whole, share = divmod(window / step, 1.0)
    n = int(whole)
    before = np.concatenate([np.full(n + 2, u[0]), u])
    now, last = before[1:], before[:-1]  # all intervals except the first, and their predecessors
    means = np.cumsum(np.append(0.0, 0.5 * (now + last)))
    count = len(u)
    ended = len(now) - count - n
    old, older = now[ended : ended + count], last[ended : ended + count]
    rest = share * old + 0.5 * share**2 * (older - old)
    return np.asarray((means[-count:] - means[-count - n :][:count] + rest) / (n + share))


def _late_by(
    name: str,
    meaning: str,
    arrives: Callable[[Vector, float, float], Vector],
    built: Callable[[Component, Parameter], Component],
) -> Mechanism:
    """A command delayed by one time parameter."""
    time = parameter(name, "s", meaning, 1e-4)

    def cuts_noise(courses: Courses, values: Values) -> bool:
        """Whether more noise is lost than the command without its noise changes, in squares."""
        lost = changed = 0.0
        for c in courses:
            pulse = np.zeros(len(c.u))
            pulse[1] = 1.0
            answer, noise = arrives(pulse, values[name], c.step), fast_noise(c.u) ** 2
            lost += len(c.u) * noise * (1.0 - float(answer @ answer))
            changed += float(np.sum((arrives(c.u, values[name], c.step) - c.u) ** 2))
            changed -= len(c.u) * noise * float(np.sum((answer - pulse) ** 2))
        return lost > changed

    def grid(courses: Courses, model: Drive) -> list[Values]:
        longest = max(_SHIFTS[-1] * courses[0].step, LONGEST)
        return [{name: float(t)} for t in _SHARES * courses[0].step if t <= longest]

    def at(courses: Courses, model: Drive, values: Values) -> Form:
        command = [(arrives(c.u, values[name], c.step) - c.u)[:, None] for c in courses]
        return Form((name,), command=command, values=values, sure=SPREAD)

    def extend(plant: Component, curve: sp.Expr, cause: Cause) -> Component:
        return built(plant, replace(time, minimum=1e-7))

    return Mechanism((time,), at, grid, extend, name, cuts_noise)


def _behind(*coefficients: sp.Expr) -> Callable[[Component, Parameter], Component]:
    """Function that adds a filter to a plant's command, see `with_command_behind`."""
    return lambda plant, time: with_command_behind(plant, time, list(coefficients))


_LAG = symbol("command_lag")
_WINDOW = symbol("command_window")
INPUT_DELAY = Cause(
    "input_delay",
    "the command reaches the drive late",
    (
        _late_by("delay", "by which the command arrives late", late, with_late_command),
        _late_by(_LAG.name, "time constant of the command's filter", lagged, _behind(_LAG)),
        _late_by(
            _WINDOW.name,
            "time over which the command is averaged",
            smeared,
            # Pade's approximation of a mean over a window, with a numerator of degree zero
            _behind(_WINDOW / 2, _WINDOW**2 / 12),
        ),
    ),
    confirm="record the current during a step of the command: the current starts late",
    entry="late command",
)


# limits over the largest command; the last one cuts nothing and is the end of the search
_LEVELS = np.r_[np.geomspace(0.02, 0.36, 12), 1.0 - np.geomspace(0.6, 0.001, 24), 1.0]
_SAGS = 2.0 ** -np.arange(4.0)  # resistance of a supply over that of the motor
_SCALES = np.geomspace(0.02, 12.0, 17)  # scales over the largest command; a bend, not a limit
_OFTEN, _DEEP = 0.2, 1.25  # a limit cuts noise: least share of cut samples, most excess
_U, _LIMIT, _SCALE = map(symbol, ("u", "voltage_limit", "voltage_scale"))


def _largest(courses: Courses) -> float:
    return max(float(np.abs(c.u).max()) for c in courses)


def _limits(courses: Courses, model: Drive) -> list[Values]:
    return [{"voltage_limit": float(level)} for level in _LEVELS * _largest(courses)]


def _scales(courses: Courses, model: Drive) -> list[Values]:
    return [{"voltage_scale": float(scale)} for scale in _SCALES * _largest(courses)]


def _cuts_noise(courses: Courses, values: Values) -> bool:
    """Whether a limit cuts many samples by little, so that it only removes noise of a command."""
    asked = np.abs(np.concatenate([c.u for c in courses])) / values["voltage_limit"]
    cut = asked > 1.0
    return bool(cut.mean() > _OFTEN and np.median(asked[cut]) < _DEEP)


def _sags(courses: Courses, model: Drive) -> list[Values]:
    if not model.has_motor:
        return []
    return [
        {"voltage_limit": float(level), "supply_resistance": float(share) * model.values["R"]}
        for share in _SAGS
        for level in _largest(courses) * _LEVELS[::3]
    ]


def _drawn(courses: Courses, model: Drive, values: Values) -> Sequence[Mapping[str, Vector]]:
    """Steady-state current of the limited voltage, for records without a measured current [A]."""

    def settled(course: Course) -> Vector:
        generated = np.sign(course.u) * model.linear.back_emf * course.middle_v
        resistance = model.values["R"] + values["supply_resistance"]
        return np.maximum((values["voltage_limit"] - generated) / resistance, 0.0)

    return [{} if c.has_current else {"i": settled(c)} for c in courses]


_MOST = sp.Max(_LIMIT - symbol("supply_resistance") * sp.Abs(symbol("i")), 0)
_CLIPPED, _SAGGING = clip(_U, -_LIMIT, _LIMIT), clip(_U, -_MOST, _MOST)
_HARD = parameter("voltage_limit", "V", "largest voltage, either sign", 1e6)
_SOFT = parameter("voltage_scale", "V", "limiting voltage of a nonlinear amplifier", 1e6)
_SUPPLY = parameter("supply_resistance", "Ohm", "by which the limit falls with the current")
VOLTAGE_SATURATION = Cause(
    "voltage_saturation",
    "the amplifier gives less voltage than the largest commands demand",
    (
        voltage({_U: _CLIPPED}, (_HARD,), _limits, sure=SPREAD, cuts_noise=_cuts_noise),
        voltage({_U: _SCALE * sp.tanh(_U / _SCALE)}, (_SOFT,), _scales, sure=SPREAD),
        voltage({_U: _SAGGING}, (_HARD, _SUPPLY), _sags, "", SPREAD, _drawn, _cuts_noise),
    ),
    confirm="measure the motor's voltage at the largest command",
    smaller=of_command,
)


def _time_shift(courses: Courses, model: Drive, values: Values) -> Form:
    command = []
    for c in courses:
        at = np.clip(np.arange(len(c.u)) - int(values["shift"]), 0, len(c.u) - 1)
        command.append((c.u[at] - c.u)[:, None])
    return Form(("time_shift",), command=command, values=values, sure=CERTAIN)


def _of_command(name: str, times: float, sure: float | None = None) -> Mechanism:
    """A command recorded with another factor."""

    def at(courses: Courses, model: Drive, values: Values) -> Form:
        return Form((name,), command=[times * c.u[:, None] for c in courses], sure=sure)

    return Mechanism((), at)


_SHIFTS = (*range(-20, 0), *range(1, 21))
"""Shifts of the command's stamps, in sampling intervals; `command_shift` covers smaller ones."""

TIME_SHIFT = Cause(
    "time_shift",
    "the time stamps of command and position are shifted against each other",
    (Mechanism((), _time_shift, lambda courses, model: [{"shift": float(k)} for k in _SHIFTS]),),
    confirm="record a step of the command: the current or the position responds at once",
    entry="late command",
)
SCALE_OF_U = Cause(
    "scale_of_u",
    "the recorded command has a wrong scale",
    (_of_command("scale_of_u", 1.0),),
    confirm="measure the voltage at the motor with a meter",
    smaller=of_command,
)
SIGN_OF_U = Cause(
    "sign_of_u",
    "the recorded command has the wrong sign",
    (_of_command("sign_of_u", -2.0, CERTAIN),),
    confirm="command a small positive voltage and check the direction of motion",
    entry="wrong sign",
)


# -- a value of the model, and a recorded motion or current --------------------------------------

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

CURRENT_GAIN = "current_gain"  # the calibration that a wrong scale of the current frees


def _of_motion(name: str, times: float, sure: float | None = None) -> Mechanism:
    """A force that grows with x, and the command equivalent to the motion's back-EMF.

    If `sure`, a change of the sign, which changes the direction of friction, too.
    """

    def at(courses: Courses, model: Drive, values: Values) -> Form:
        emf, forces, command = model.linear.back_emf if model.has_motor else 0.0, [], []
        for c in courses:
            force = model.linear.inertia * c.mean_a + model.linear_friction * c.middle_v
            force = force + c.bristle if sure else force
            forces.append(times * force[:, None])
            command.append(-times * emf * c.middle_v[:, None])
        return Form((name,), force=forces, command=command, sure=sure)

    return Mechanism((), at)


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
    (_of_motion("scale_of_x", 1.0),),
    confirm="move by a known distance and read the position",
    smaller=lambda courses, form, amplitudes: min(abs(1.0 + float(amplitudes[0])), 1.0),
)
SIGN_OF_X = Cause(
    "sign_of_x",
    "the recorded position has the wrong sign",
    (_of_motion("sign_of_x", -2.0, CERTAIN),),
    confirm="move in +x by hand and read the position",
    entry="wrong sign",
)
