"""A machine, its equations linearized, and the motions and gains that fit it.

The matrices are the partial derivatives of the part's own equations, as in its native FMU.

Motions and gains follow from sliding at a constant speed. The ranges of gains are in the laws'
files, for the nominal axis; a gain in volts per metre is multiplied by the ratio of the commands
for one metre at the same frequency.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...controllers import CONTROLLERS, tunable
from ...controllers.margins import Linear
from ...fmus.interface import SOLVER_TOLERANCE
from ...fmus.native.partials import entry_of
from ...fmus.units import base_exponents
from ...plant.instruments import LIMIT, NOMINAL_VOLTAGE, OWN_LIMIT, UNLIMITED, PartName, limit_of
from ...solver.arrays import Vector
from ...solver.errors import BadParameter
from ...solver.kernel import Model
from .parts import Part, resolve

Values = Mapping[str, float]
Ranges = dict[str, tuple[float, float]]

FASTEST, HALVINGS = 0.2, 12  # m/s, of the reference motions; until the limit allows it
FOR_SPEED, FOR_ACCELERATION = 0.5, 0.3  # shares of the limit
RISE, JERK_TIME, CRUISE = 0.05, 0.02, 0.4  # s
STEP_SHARE = 0.05  # of the way of a move
SLOW, FAST = 0.2, 200.0  # rad/s, of the nominal axis at the ends of the ranges of `pid.TUNABLE`
START = 20.0  # rad/s, of gains to start from
WEIGHTS = {1: 2.0, -1: 0.25}  # of their derivative and integral parts: well damped
LEAST = 1e-3  # of the high end of a range that begins at zero
MODEL_AT = 100.0  # rad/s, at which inertia and damping are found
SLOWEST_LAG = 10.0  # s, of a machine without damping
STICTION = 100.0  # times the inverse of its sharpness: there a smooth sign is 1


def linearized(
    part: Part, inputs: Sequence[str], outputs: Sequence[str], values: Values, at: Values
) -> Linear:
    """The equations of a part about a state, sliding forward; `at` has what is not at its start."""
    kernel = part.partials
    model = Model(kernel, values)
    states, given = ([v.name for v in of] for of in (kernel.states, kernel.inputs))
    model.x[:] = [at.get(n, x) for n, x in zip(states, model.x, strict=True)]
    model.u[: len(given)] = [at.get(n, u) for n, u in zip(given, model.u, strict=False)]
    if kernel.modes:
        model.u[-1] = kernel.modes.index("forward")
    seen, count = [o.name for o in part.kernel.outputs], len(states)
    table = np.zeros((count + len(seen), count + len(given)))
    for name, value in model.outputs(0.0, model.x).items():
        table[entry_of(name)] = value
    u, y = [count + given.index(n) for n in inputs], [count + seen.index(n) for n in outputs]
    x = [*range(count)]
    a, b, c, d = (table[np.ix_(to, by)] for to, by in ((x, x), (x, u), (y, x), (y, u)))
    return Linear(a, b, c, d, len(part.kernel.discrete))


@dataclass(frozen=True)
class Machine:
    """A plant with values, and its largest command."""

    plant: Part
    values: Values
    limit: float  # largest magnitude of the command [its unit]

    @classmethod
    def of(cls, plant: Part, values: Values, asked: float | None) -> Machine:
        """A plant with values and its limit, see `limit_of`; `BadParameter` if it has none."""
        limit = limit_of(plant.parameters, values, asked)
        if not limit > 0:
            raise BadParameter(f"limit is {limit:g}, expected more than 0")
        if limit >= UNLIMITED:
            wanted = f"give one, in the command's unit, or {LIMIT} in the parameter file"
            raise BadParameter(f"{plant.label} has no limit of its command; {wanted}")
        return cls(plant, {**values, LIMIT: limit}, limit)

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Signals that a controller may measure."""
        law = next((i.law for i in self.plant.kernel.inputs if i.name == "u"), ())
        return tuple(n for n in law if n in self.plant.outputs)

    def linear(self, outputs: Sequence[str], at: Values) -> Linear:
        """Equations from the command to outputs about a state: sliding forward, or stuck."""
        return linearized(self.plant, ("u",), outputs, self.values, at)

    def sliding(self, speed: float) -> dict[str, float]:
        """States and command of steady sliding at a speed [m/s], at the position zero."""
        from scipy.integrate import solve_ivp

        model = Model(self.plant.kernel, self.values)
        names = [s.name for s in model.kernel.states]
        if model.kernel.modes:
            model.u[-1] = model.kernel.modes.index("forward")
        v, u = names.index("v"), [i.name for i in model.kernel.inputs].index("u")
        model.x[v] = speed
        inner = [k for k, n in enumerate(names) if n not in ("x", "v")]

        def rates(_: float, state: Vector) -> Vector:
            model.x[inner] = state
            return model.derivatives(0.0, model.x)[inner]

        if inner:  # friction states reach their steady values within a metre
            end = 1.0 / speed
            last = solve_ivp(rates, (0.0, end), model.x[inner], "BDF", rtol=1e-8, atol=1e-12)
            model.x[inner] = last.y[:, -1]
        for _ in range(5):  # Newton's method, for the command and the other states
            near = self.linear((), {**dict(zip(names, model.x, strict=True)), "u": model.u[u]})
            left = model.derivatives(0.0, model.x)[[*inner, v]]
            slopes = np.column_stack([near.a[:, inner], near.b])[[*inner, v]]
            change = np.linalg.lstsq(slopes, left, rcond=None)[0]
            model.x[inner] -= change[:-1]
            model.u[u] -= change[-1]
        return {**dict(zip(names, model.x.tolist(), strict=True)), "u": float(model.u[u])}

    def stuck(self) -> dict[str, float]:
        """States of sticking: bristles are not bent; a smooth sign needs a small speed to be 1."""
        sharpness = self.values.get("Kv", getattr(self.plant.parameters.get("Kv"), "default", 0.0))
        return {"v": STICTION / sharpness} if sharpness else {}

    @cached_property
    def speed(self) -> float:
        """Speed of the reference motions [m/s]: half of the limit drives it."""
        for k in range(HALVINGS):
            speed = FASTEST / 2**k
            needed = abs(self.sliding(speed)["u"])
            if needed <= FOR_SPEED * self.limit:
                return float(speed)
        alone = f"friction alone needs {needed:.3g} at {speed:.2g} m/s; expected twice this or more"
        raise BadParameter(f"the limit of the command is {self.limit:g}, but {alone}")

    def command_per_metre(self, frequency: float) -> complex:
        """One over the response from command to position in sliding, at a frequency [rad/s]."""
        g, s = self._sliding, 1j * frequency
        (found,) = (g.c @ np.linalg.solve(s * np.eye(len(g.a)) - g.a, g.b) + g.d).ravel()
        return complex(1 / found)

    @cached_property
    def _sliding(self) -> Linear:
        return self.linear(("x",), self.sliding(self.speed))

    @cached_property
    def acceleration(self) -> float:
        """Acceleration of the reference motions [m/s^2]: from at most three tenths of the limit."""
        wanted = self.speed / RISE
        for _ in range(HALVINGS):
            if wanted * self.command_per_acceleration <= FOR_ACCELERATION * self.limit:
                break
            wanted /= 2
        return wanted

    @property
    def command_per_speed(self) -> float:
        """Damping in sliding [unit of the command, s/m]; without damping, that of a long lag."""
        damping = self.command_per_metre(MODEL_AT).imag / MODEL_AT
        return max(damping, self.command_per_acceleration / SLOWEST_LAG)

    @property
    def command_per_acceleration(self) -> float:
        """Inertia [unit of the command, s^2/m]."""
        return -self.command_per_metre(MODEL_AT).real / MODEL_AT**2

    def motions(self) -> tuple[str, str, str]:
        """A step, a reversing move, and another move for judging, as text for `as_reference`."""
        v, a = self.speed, self.acceleration
        way, jerk = CRUISE * v, a / JERK_TIME
        step = f"step:size={STEP_SHARE * way:g},at=0.05"
        there, judge = (
            f"move:distance={share * way:g},speed={slower * v:g},acceleration={slower * a:g},"
            f"jerk={jerk:g},dwell=0.2"
            for share, slower in ((1.0, 1.0), (-0.6, 0.5))
        )
        return step, there, judge


def own_ranges(controller: str) -> Ranges:
    """Ranges of a controller's gains: those of its law, else of its parameters with two limits."""
    if PartName.of(controller).bare in CONTROLLERS:
        return tunable(controller)
    return {
        n: (p.minimum, p.maximum)
        for n, p in resolve("controller", controller).parameters.items()
        if n not in ("sample_time", SOLVER_TOLERANCE, OWN_LIMIT)
        and -math.inf < p.minimum < p.maximum < math.inf
    }


def gain_ranges(controller: Part, machine: Machine) -> tuple[Ranges, dict[str, float]]:
    """Ranges of a controller's gains for a machine, and gains for a modest bandwidth."""
    if controller.bare not in CONTROLLERS:  # of the user, in the user's units
        ranges, given = own_ranges(controller.name), controller.parameters
        middle = {n: sum(r) / 2 for n, r in ranges.items()}
        start = {n: np.nan_to_num(given[n].default, nan=middle[n]) for n in ranges}
        return ranges, {n: float(np.clip(start[n], *r)) for n, r in ranges.items()}
    # in the units of the ranges
    nominal = Machine(Part("plant"), {}, NOMINAL_VOLTAGE)
    known = Part(controller.named.plain).parameters
    ranges, start = {}, {}
    for name, (low, high) in tunable(controller.bare).items():
        powers = base_exponents(known[name].unit)
        volts, amperes = powers.get("kg", 0), powers.get("A", 0)
        metres = powers.get("m", 0) - 2 * volts
        if volts and amperes == -volts and metres == -volts:
            both = ((m.command_per_metre(w) for m in (machine, nominal)) for w in (SLOW, FAST))
            slow, fast = (abs(own / usual) ** volts for own, usual in both)
            seconds = powers.get("s", 0) + 3 * volts
            modest = abs(machine.command_per_metre(START)) ** volts * START**-seconds
            start[name] = modest * WEIGHTS.get(seconds, 1.0)
        elif volts and amperes == -volts and not metres:
            slow = fast = (machine.limit / nominal.limit) ** volts
        elif volts:
            slow = fast = 1.0
        else:  # lengths and speeds are scaled like those of the motions
            slow = fast = (machine.speed / nominal.speed) ** metres
        p, low = known[name], low or LEAST * high  # positive, for a logarithmic search
        ranges[name] = max(low * slow, p.minimum), min(high * fast, p.maximum)
        start[name] = float(np.clip(start.get(name, p.default * slow), *ranges[name]))
    return ranges, start


def model_values(controller: Part, machine: Machine) -> dict[str, float]:
    """Parameters of a controller that describe its machine and are not gains."""
    known, own = controller.parameters, machine.plant.parameters
    if controller.bare not in CONTROLLERS:
        return {OWN_LIMIT: machine.limit} if OWN_LIMIT in known else {}
    from ...plant.ball_screw import PARAMETERS  # here, since it needs SymPy

    motor = [p.name for p in PARAMETERS if p.name in known and p.name not in own]
    if motor:
        lacks = f"{machine.plant.label} has no {', '.join(motor)}"
        raise BadParameter(f"{controller.label} is designed for an axis with a motor, but {lacks}")
    of_plant = {n: machine.values.get(n, p.default) for n, p in own.items()}
    gains = tunable(controller.bare)
    found = {"u_max": machine.limit} | of_plant | {f"{n}_hat": v for n, v in of_plant.items()}
    damping, inertia = machine.command_per_speed, machine.command_per_acceleration
    found |= {"Fv": damping, "Fa": inertia, "b": 1 / damping, "lag": inertia / damping}
    if "Kfff" in known:
        dry = machine.sliding(machine.speed)["u"] - damping * machine.speed
        found |= {"Kvff": damping, "Kaff": inertia, "Kfff": max(dry, 0.0)}
    if "force_per_volt" in known:
        from ...controllers.rigid_axis import rigid_axis

        axis = {n: v for n, v in of_plant.items() if math.isfinite(v)}
        found["force_per_volt"] = axis.get("gain") or rigid_axis(axis).force_per_volt
    return {n: v for n, v in found.items() if n in known and n not in gains and "_start" not in n}
