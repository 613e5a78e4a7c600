"""Motions and gains that fit a machine.

All is computed from the plant's own equations, linearized about sliding at a constant speed. The
ranges of tuned gains are in the laws' files, for the nominal axis. For another machine they are
scaled: a gain in volts per metre is multiplied by the ratio of the commands needed for one metre at
the same frequency.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...controllers import CONTROLLERS, tunable
from ...fmus.interface import TOLERANCE
from ...fmus.units import base_exponents
from ...plant.instruments import NOMINAL_VOLTAGE, UNLIMITED, PartName
from ...solver.errors import BadParameter
from ...solver.kernel import Model
from .catalogue import AMPLIFIER, LIMIT, OWN_LIMIT
from .linear_loop import Linear, Vector, linear_kernel, linearized
from .parts import Part, resolve_controller

FASTEST = 0.2  # m/s, of the reference motions; halved until the limit allows it
HALVINGS = 12
FOR_SPEED, FOR_ACCELERATION = 0.5, 0.3  # shares of the limit
RISE, JERK_TIME, CRUISE = 0.05, 0.02, 0.4  # s
STEP_SHARE = 0.05  # of the way of a move
SLOW, FAST = 0.2, 200.0
"""Bandwidths of the nominal axis at the ends of the ranges of `pid.TUNABLE` [rad/s]."""
START = 20.0  # rad/s, of gains to start from
WEIGHTS = {1: 2.0, -1: 0.25}  # of their derivative and integral parts: well damped
LEAST = 1e-3  # of the high end of a range that begins at zero
MODEL_AT = 100.0  # rad/s, at which inertia and damping are found
SLOWEST_LAG = 10.0  # s, of a machine without damping
STICTION = 100.0  # times the inverse of its sharpness: there a smooth sign is 1


@dataclass(frozen=True)
class Machine:
    """A plant with values, and its largest command."""

    plant: Part
    values: Mapping[str, float]
    limit: float  # largest magnitude of the command [its unit]

    @classmethod
    def of(cls, plant: Part, values: Mapping[str, float], asked: float | None) -> Machine:
        """A plant with values and its limit, see `limit_of`.

        Raises `BadParameter` if nobody gives a limit.
        """
        limit = limit_of(plant.parameters, values, asked)
        if not limit > 0:
            raise BadParameter(f"limit is {limit:g}, expected more than 0")
        if limit >= UNLIMITED:
            raise BadParameter(
                f"{plant.label} has no limit of its command; give --limit, in the command's unit, "
                f"or {LIMIT} in the parameter file"
            )
        return cls(plant, {**values, LIMIT: limit}, limit)

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Signals that a controller may measure."""
        law = next((i.law for i in self.plant.kernel.inputs if i.name == "u"), [])
        return tuple(n for n in law if n in self.plant.outputs)

    def linear(self, outputs: tuple[str, ...], at: Mapping[str, float]) -> Linear:
        """Equations from the command to outputs about a state: sliding forward, or stuck."""
        kernel = linear_kernel(self.plant, ["u"], outputs)
        return linearized(kernel, ["u"], outputs, self.values, at, "forward")

    def sliding(self, speed: float) -> dict[str, float]:
        """States and command of steady sliding at a speed [m/s], at the position zero."""
        from scipy.integrate import solve_ivp

        model = Model(linear_kernel(self.plant, ["u"], ("x",)), self.values)
        names = [s.name for s in model.kernel.states]
        if model.kernel.modes:
            model.u[-1] = model.kernel.modes.index("forward")
        model.x[names.index("v")] = speed
        inner = [k for k, n in enumerate(names) if n not in ("x", "v", "held_u", "summed_of_x")]

        def rates(_: float, state: Vector) -> Vector:
            model.x[inner] = state
            return model.derivatives(0.0, model.x)[inner]

        if inner:  # friction states reach their steady values within a metre
            last = solve_ivp(
                rates, (0.0, 1.0 / speed), model.x[inner], "BDF", rtol=1e-8, atol=1e-12
            )
            model.x[inner] = last.y[:, -1]
        unknown = [*inner, names.index("held_u")]
        zero = [*inner, names.index("v")]
        for _ in range(5):  # Newton's method, for the command and the other states
            left = model.derivatives(0.0, model.x)[zero]
            slopes = model.jacobian(0.0, model.x)[np.ix_(zero, unknown)]
            model.x[unknown] -= np.linalg.lstsq(slopes, left, rcond=None)[0]
        found = dict(zip(names, model.x.tolist(), strict=True))
        return {n: v for n, v in found.items() if not n.startswith(("held_", "summed_"))} | {
            "u": found["held_u"]
        }

    def stuck(self) -> dict[str, float]:
        """States of sticking: bristles are not bent; a smooth sign needs a small speed to be 1."""
        sharpness = self.values.get("Kv", getattr(self.plant.parameters.get("Kv"), "default", 0.0))
        return {"v": STICTION / sharpness} if sharpness else {}

    @cached_property
    def speed(self) -> float:
        """Speed of the reference motions [m/s]: half of the limit drives it.

        Raises `BadParameter` if the limit is not much larger than friction.
        """
        for k in range(HALVINGS):
            speed = FASTEST / 2**k
            if abs(self.sliding(speed)["u"]) <= FOR_SPEED * self.limit:
                return float(speed)
        needed = abs(self.sliding(speed)["u"])
        raise BadParameter(
            f"the limit of the command is {self.limit:g}, but friction alone needs {needed:.3g} at "
            f"{speed:.2g} m/s; expected a limit of at least twice this"
        )

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
        """A step, a reversing move, and another move for judging, in the form for `read_motion`."""
        v, a = self.speed, self.acceleration
        way, jerk = CRUISE * v, a / JERK_TIME

        def move(distance: float, speed: float, acceleration: float) -> str:
            numbers = f"speed={speed:g},acceleration={acceleration:g},jerk={jerk:g},dwell=0.2"
            return f"move:distance={distance:g},{numbers}"

        step = f"step:size={STEP_SHARE * way:g},at=0.05"
        return step, move(way, v, a), move(-0.6 * way, 0.5 * v, 0.5 * a)


def limit_of(known: Container[str], values: Mapping[str, float], asked: float | None) -> float:
    """Largest command of a plant with `known` parameters, in the unit of its command.

    The requested one, else that of its values, else the nominal amplifier's 36 V if it has an
    amplifier. Others have none: a limit in volts has no meaning if the command is a force.
    """
    given = values.get(LIMIT, UNLIMITED) if asked is None else asked
    amplified = asked is None and given >= UNLIMITED and AMPLIFIER in known
    return NOMINAL_VOLTAGE if amplified else given


def own_ranges(controller: str) -> dict[str, tuple[float, float]]:
    """Ranges of a controller's gains: those of its law, else of its parameters with two limits.

    Raises `BadParameter`, `ContractError`, `FmuError`.
    """
    if PartName.of(controller).bare in CONTROLLERS:
        return tunable(controller)
    known = resolve_controller(controller).parameters.values()
    gains = (p for p in known if p.name not in ("sample_time", TOLERANCE, OWN_LIMIT))
    limits = {p.name: (p.minimum, p.maximum) for p in gains}
    return {n: (a, b) for n, (a, b) in limits.items() if -math.inf < a < b < math.inf}


def gains_of(controller: Part) -> dict[str, tuple[float, float]]:
    """As `own_ranges`, without those of a feed-forward."""
    law = controller.bare
    return own_ranges(law if law in CONTROLLERS else controller.name)


def gain_ranges(
    controller: Part, machine: Machine
) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Ranges of a controller's gains for a machine, and gains for a modest bandwidth.

    Raises `BadParameter` if the controller has no ranges for its gains.
    """
    if controller.bare not in CONTROLLERS:  # of the user, in the user's units
        ranges, given = gains_of(controller), controller.parameters
        middle = {n: sum(r) / 2 for n, r in ranges.items()}
        start = {n: np.nan_to_num(given[n].default, nan=middle[n]) for n in ranges}
        return ranges, {n: float(np.clip(start[n], *r)) for n, r in ranges.items()}
    # in the units of the ranges
    nominal = Machine(Part("plant"), {}, NOMINAL_VOLTAGE)
    known = Part(controller.named.plain).parameters
    ranges, start = {}, {}
    for name, (low, high) in tunable(controller.bare).items():
        powers = base_exponents(known[name].unit)
        volts = powers.get("kg", 0)
        metres = powers.get("m", 0) - 2 * volts
        if volts and volts + powers.get("A", 0) == 0 and volts + metres == 0:
            slow, fast = (
                abs(machine.command_per_metre(w) / nominal.command_per_metre(w)) ** volts
                for w in (SLOW, FAST)
            )
            seconds = powers.get("s", 0) + 3 * volts
            modest = abs(machine.command_per_metre(START)) ** volts * START**-seconds
            start[name] = modest * WEIGHTS.get(seconds, 1.0)
        elif volts and powers.get("A", 0) == -volts and not metres:
            slow = fast = (machine.limit / nominal.limit) ** volts
        elif volts:
            slow = fast = 1.0
        else:  # lengths and speeds are scaled like those of the motions
            slow = fast = (machine.speed / nominal.speed) ** metres
        ranges[name] = (low or LEAST * high) * slow, high * fast  # positive: logarithmic search
        p = known[name]
        ranges[name] = max(ranges[name][0], p.minimum), min(ranges[name][1], p.maximum)
        start.setdefault(name, p.default * slow)
        start[name] = float(np.clip(start[name], *ranges[name]))
    return ranges, start


def model_values(controller: Part, machine: Machine) -> dict[str, float]:
    """Parameters of a controller that describe its machine and are not gains.

    Raises `BadParameter` if it is designed for a motor that the machine does not have.
    """
    known, own = controller.parameters, machine.plant.parameters
    if controller.bare not in CONTROLLERS:
        return {OWN_LIMIT: machine.limit} if OWN_LIMIT in known else {}
    from ...plant.ball_screw import PARAMETERS  # here, since it needs SymPy

    motor = [p.name for p in PARAMETERS if p.name in known and p.name not in own]
    if motor:
        raise BadParameter(
            f"{controller.label} is designed for an axis with a motor, but {machine.plant.label} "
            f"has no {', '.join(motor)}"
        )
    of_plant = {n: machine.values.get(n, p.default) for n, p in own.items()}
    gains = tunable(controller.bare)
    found = {"u_max": machine.limit}
    found |= {n: of_plant[n] for n in known if n in own}
    found |= {n: of_plant[n[:-4]] for n in known if n.endswith("_hat") and n[:-4] in own}
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
