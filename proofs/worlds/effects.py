"""The causes of the catalogue, each in the forms that occur in machines."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from worlds import layout as at
from worlds.axes import BALL_SCREW, TOLERANCE, Axis, scaled, vector_of
from worlds.layout import Vector


@dataclass(frozen=True)
class Setting:
    """Quantities that determine an effect's size.

    Attributes
    ----------
    axis : Axis
    double : Vector
        The faultless axis.
    sampling : float
        Period of the record, s.
    duration : float
        Duration, s.
    peak : float
        Largest command of the faultless run, V.
    fastest : float
        Largest speed of the faultless run, m/s.
    reach : float
        Largest distance from the middle in the faultless run, m.
    shrink : float
        Factor on the upper ends of sizes, initially 1.
    finest : float
        Factor on the lower ends: less than 1 with little noise.
    """

    axis: Axis
    double: Vector
    sampling: float
    duration: float
    peak: float
    fastest: float
    reach: float
    shrink: float = 1.0
    finest: float = 1.0

    def size(self, rng: np.random.Generator, low: float, high: float) -> float:
        """A random size, log-uniform."""
        low *= self.finest
        high = max(high * self.shrink, 2 * low)
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    @property
    def lead(self) -> float:
        """Travel per turn of the screw, or per pole pair of the drive, m."""
        return 1 / self.axis.values["p"] if self.axis.plant == BALL_SCREW else 0.024

    @property
    def mass(self) -> float:
        """Total mass, kg."""
        return float(self.double[at.MOTOR_MASS] + self.double[at.BLOCK_MASS])


@dataclass(frozen=True)
class Effect:
    """One effect that is not in the parameter file.

    Attributes
    ----------
    name, form : str
    changes : dict
        Indices in the axis' vector and their values.
    truth : dict
        Values that have a counterpart in an answer.
    period : float
        Period of a periodic effect, m.
    bursts : float
        Force of bursts, N.
    factors : dict
        Factors on columns of the record.
    shift : int
        Samples by which the record's command is late; negative: early.
    """

    name: str
    form: str
    changes: dict[int, float] = field(default_factory=dict)
    truth: dict[str, float] = field(default_factory=dict)
    period: float = 0.0
    bursts: float = 0.0
    factors: dict[str, float] = field(default_factory=dict)
    shift: int = 0


Draw = Callable[[np.random.Generator, Setting], Effect]


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _part(rng: np.random.Generator, size: float, dry: int, viscous: int) -> dict[int, float]:
    """A share of the dry friction only, or of all friction."""
    return {dry: size, viscous: size} if rng.uniform() < 0.4 else {dry: size}


def _part_name(changes: dict[int, float], viscous: int) -> str:
    return "all" if viscous in changes else "dry"


def direction_asymmetry(rng: np.random.Generator, s: Setting) -> Effect:
    """Friction is larger in one direction."""
    size = _sign(rng) * s.size(rng, 0.005, 0.6)
    changes = _part(rng, size, at.ASYMMETRY, at.ASYMMETRY_VISCOUS)
    form = _part_name(changes, at.ASYMMETRY_VISCOUS)
    truth = {"asymmetry": size, "dry_asymmetry": size}
    if form == "dry":
        truth["dF_asymmetry"] = 0.0
    return Effect("direction_asymmetry", form, changes, truth)


def position_periodic_friction(rng: np.random.Generator, s: Setting) -> Effect:
    """Friction oscillates with the screw's turn, or with the return of the balls."""
    changes = _part(rng, s.size(rng, 0.01, 0.6), at.PERIODIC, at.PERIODIC_VISCOUS)
    form = _part_name(changes, at.PERIODIC_VISCOUS)
    period = s.lead * float(rng.choice([1.0, 1.0, 2.0, 0.5, 0.41]))
    changes |= {at.PERIOD: period, at.PERIOD_PHASE: float(rng.uniform(0, 2 * math.pi))}
    if rng.uniform() < 0.4:
        form, changes[at.PERIOD_SECOND] = form + "_two_harmonics", float(rng.uniform(0.2, 0.5))
    return Effect("position_periodic_friction", form, changes, period=period)


def position_trend_friction(rng: np.random.Generator, s: Setting) -> Effect:
    """Friction changes along the travel: a slope, a bow, one end worn."""
    form = int(rng.integers(0, 3))
    size = _sign(rng) * s.size(rng, 0.01, 0.7)
    changes = _part(rng, size, at.TREND, at.TREND_VISCOUS)
    name = ("slope", "bow", "worn_end")[form] + "_" + _part_name(changes, at.TREND_VISCOUS)
    # along the used part of the travel
    changes |= {at.TREND_FORM: float(form), at.TRAVEL: s.reach}
    return Effect("position_trend_friction", name, changes)


def torque_ripple(rng: np.random.Generator, s: Setting) -> Effect:
    """The motor's force oscillates with its angle: cogging, or ripple of the torque constant."""
    form = str(rng.choice(["cogging", "two_harmonics", "of_current", "with_friction"]))
    period = s.lead / float(rng.choice([1, 1, 2, 4, 6]))
    changes = {at.RIPPLE_PERIOD: period, at.RIPPLE_PHASE: float(rng.uniform(0, 2 * math.pi))}
    if form == "of_current":
        changes[at.RIPPLE_OF_CURRENT] = s.size(rng, 0.005, 0.3)
    else:
        changes[at.RIPPLE] = s.size(rng, 0.01, 0.7) * s.double[at.FC]
    if form == "two_harmonics":
        changes[at.RIPPLE_SECOND] = float(rng.uniform(0.2, 0.6))
    if form == "with_friction":
        changes[at.RIPPLE_FRICTION] = 0.25 * changes[at.RIPPLE] / s.double[at.FC]
    return Effect("torque_ripple", form, changes, period=period)


def load_bias(rng: np.random.Generator, s: Setting) -> Effect:
    """A force that is constant, or nearly constant along the travel (a cable chain)."""
    force = _sign(rng) * s.size(rng, 0.01, 1.0) * s.double[at.FC]
    changes = {at.LOAD: s.double[at.LOAD] + force}
    if rng.uniform() < 0.3:
        changes[at.LOAD_SLOPE] = float(rng.uniform(-0.2, 0.2)) * abs(force) / s.reach
        return Effect("load_bias", "cable", changes)
    return Effect("load_bias", "constant", changes, {"load": force})


def nonlinear_viscous(rng: np.random.Generator, s: Setting) -> Effect:
    """Friction at high speed is not proportional to it."""
    form = str(rng.choice(["quadratic", "cubic", "root", "thinning"]))
    v = s.fastest
    viscous = s.double[at.SIGMA2] * v
    force = s.size(rng, 0.02, 2.0) * (s.double[at.FC] + viscous)
    if form == "quadratic":
        sigma3 = force / v**2
        return Effect("nonlinear_viscous", form, {at.QUADRATIC: sigma3}, {"sigma3": sigma3})
    if form == "cubic":
        return Effect("nonlinear_viscous", form, {at.CUBIC: force / v**3})
    if form == "root":
        return Effect("nonlinear_viscous", form, {at.ROOT: force / math.sqrt(v)})
    return Effect("nonlinear_viscous", form, {at.THINNING: s.size(rng, 0.02, 3.0) / v})


def stribeck_mismatch(rng: np.random.Generator, s: Setting) -> Effect:
    """Friction at low speed rises or falls differently from the believed law."""
    peak = s.double[at.FS] - s.double[at.FC]
    forms = ["peak", "exponential", "lorentz", "polynomial"] + (["speed"] if peak > 0 else [])
    form = str(rng.choice(forms))
    changes: dict[int, float] = {}
    if form == "speed":
        changes[at.VS] = s.double[at.VS] * (1 + s.size(rng, 0.2, 7.0)) ** _sign(rng)
        return Effect("stribeck_mismatch", form, changes)
    grown = s.size(rng, 0.02, 1.0) * s.double[at.FC]
    if form != "peak":
        changes[at.FALL] = float(
            {"exponential": at.EXPONENTIAL, "lorentz": at.LORENTZ, "polynomial": at.POLYNOMIAL}[
                form
            ]
        )
        grown *= float(rng.choice([0.0, 1.0])) if peak > 0.2 * s.double[at.FC] else 1.0
    changes[at.FS] = s.double[at.FS] + grown
    changes[at.VS] = max(s.double[at.VS], 0.01 * s.fastest)
    return Effect("stribeck_mismatch", form, changes)


def presliding_hysteresis(rng: np.random.Generator, s: Setting) -> Effect:
    """Bristles, with a believed law without bristles."""
    form = str(rng.choice(["lugre", "dahl", "elasto_plastic", "maxwell"]))
    way = s.size(rng, 0.5e-6, 300e-6)
    stiffness = float(s.double[at.FS] / way)
    law = {"lugre": at.LUGRE, "dahl": at.LUGRE, "elasto_plastic": at.ELASTO_PLASTIC}
    changes: dict[int, float] = {at.LAW: float(law.get(form, at.MAXWELL)), at.SIGMA0: stiffness}
    if form in ("lugre", "elasto_plastic"):
        damping = float(rng.uniform(0.1, 1.0))
        changes[at.SIGMA1] = damping * 2 * math.sqrt(stiffness * s.mass)
    truth = {"sigma0": stiffness} if form in law else {}
    return Effect("presliding_hysteresis", form, changes, truth)


def unmodelled_inertia(rng: np.random.Generator, s: Setting) -> Effect:
    """More mass than believed: a load on the block, or a rotor."""
    more = s.size(rng, 0.05, 5.0) * s.mass
    truth = {"m": s.axis.values["m"] + more}  # as if the total were the block's
    if rng.uniform() < 0.5:
        mass = float(s.double[at.MOTOR_MASS] + more)
        return Effect("unmodelled_inertia", "rotor", {at.MOTOR_MASS: mass}, truth)
    mass = float(s.double[at.BLOCK_MASS] + more)
    return Effect("unmodelled_inertia", "block", {at.BLOCK_MASS: mass}, truth)


def input_delay(rng: np.random.Generator, s: Setting) -> Effect:
    """The command is late: by a delay, or by a filter or a moving mean."""
    form = str(rng.choice(["pure", "lag", "lag_twice", "mean"]))
    late = s.size(rng, max(0.05 * s.sampling, 2e-5), max(3 * s.sampling, 2e-3))
    if form == "pure":
        return Effect("input_delay", form, {at.DELAY: late}, {"delay": late})
    if form == "lag":
        return Effect("input_delay", form, {at.LAG: late}, {"command_lag": late})
    if form == "lag_twice":
        changes = {at.LAG: late / 2, at.LAG_TWICE: 1.0}
        return Effect("input_delay", form, changes, {"command_lag_twice": late / 2})
    return Effect("input_delay", form, {at.WINDOW: 2 * late}, {"command_window": 2 * late})


def _course(name: str, form: int, size: float, time: float) -> dict[str, float]:
    """Names in an answer for the size and the time of a change, with their values."""
    if form == 0:
        return {f"{name}_drift": size}
    course = "settling" if form == 1 else "step"
    return {f"{name}_{course}": size, f"{name}_{course}_time": time}


def friction_drift(rng: np.random.Generator, s: Setting) -> Effect:
    """Friction changes in time: linearly, exponentially, or in a step."""
    form = int(rng.integers(0, 3))
    size = s.size(rng, 0.01, 1.0)
    size = -size / (1 + size) if rng.uniform() < 0.6 else size
    changes = _part(rng, size, at.DRIFT, at.DRIFT_VISCOUS)
    name = ("line", "exponential", "step")[form] + "_" + _part_name(changes, at.DRIFT_VISCOUS)
    time = float(rng.uniform(0.15, 0.5 if form == 1 else 0.85)) * s.duration
    changes |= {at.DRIFT_FORM: float(form), at.DRIFT_TIME: time}
    return Effect("friction_drift", name, changes, _course("friction", form, size, time))


def resistance_drift(rng: np.random.Generator, s: Setting) -> Effect:
    """The winding warms up: linearly, exponentially, in a step, or by its own current."""
    form = int(rng.integers(0, 4))
    name = ("line", "exponential", "step", "own_current")[form]
    force = s.double[at.FC] + 0.5 * s.double[at.SIGMA2] * s.fastest
    size, time = s.size(rng, 0.01, 0.8), float(rng.uniform(0.2, 0.6)) * s.duration
    changes = {
        at.R_DRIFT: size,
        at.R_FORM: float(form),
        at.R_TIME: time,
        at.R_CURRENT: float(force / s.double[at.KT]),
    }
    truth = {} if name == "own_current" else _course("R", form, size, time)
    return Effect("resistance_drift", name, changes, truth)


def _coupled(rng: np.random.Generator, s: Setting) -> tuple[dict[int, float], float]:
    """Divide the mass into two bodies; return the changes and the reduced mass."""
    motor = float(s.double[at.MOTOR_MASS])
    if motor < 0.05 * s.mass:  # share of the screw or the frame
        motor = float(rng.uniform(0.05, 0.4)) * s.mass
    rest = s.mass - motor
    return {at.MOTOR_MASS: motor, at.BLOCK_MASS: rest}, motor * rest / s.mass


def backlash(rng: np.random.Generator, s: Setting) -> Effect:
    """A gap crossed at reversals, with and without a rebound at its ends."""
    changes, mass = _coupled(rng, s)
    gap, spring = s.size(rng, 2e-6, 1e-3), mass * 8e3**2
    rebounds = rng.uniform() < 0.5
    damping = (0.03 if rebounds else 0.8) * 2 * math.sqrt(spring * mass)
    changes |= {at.GAP: gap, at.SPRING: spring, at.SPRING_DAMPING: damping}
    return Effect("backlash", "rebound" if rebounds else "no_rebound", changes, {"gap": gap})


def compliance(rng: np.random.Generator, s: Setting) -> Effect:
    """A spring between motor and block, with little or much damping."""
    changes, mass = _coupled(rng, s)
    spring = min(float(s.double[at.FS]) / s.size(rng, 0.1e-6, 100e-6), mass * 1.5e4**2)
    little = rng.uniform() < 0.6
    damping = float(rng.uniform(0.005, 0.05) if little else rng.uniform(0.2, 0.7))
    changes |= {at.SPRING: spring, at.SPRING_DAMPING: damping * 2 * math.sqrt(spring * mass)}
    form = "little_damping" if little else "much_damping"
    if rng.uniform() < 0.3:
        changes[at.FRICTION_AT_MOTOR] = 1.0
        truth = {"load_stiffness": spring}
        return Effect("compliance", form + "_friction_at_motor", changes, truth)
    return Effect("compliance", form, changes, {"stiffness": spring})


def voltage_saturation(rng: np.random.Generator, s: Setting) -> Effect:
    """The amplifier cannot supply the command: it clips, bends, or sags with the current."""
    form = int(rng.integers(0, 3 if s.axis.plant == BALL_SCREW else 2))
    cut = s.size(rng, 0.01, 0.7)
    limit = s.peak * (1 - cut) if form == 0 else s.peak / math.sqrt(3 * cut)
    if form == 2:  # the current's peak is of the order of a third of the short-circuit current
        limit = s.peak * (1 - 0.5 * cut)
    changes = {at.LIMIT: limit, at.LIMIT_FORM: float(form)}
    if form == 2:
        changes[at.SAG] = 0.3 * float(s.double[at.R])
    truth = {"voltage_scale" if form == 1 else "voltage_limit": limit}
    return Effect("voltage_saturation", ("clip", "bend", "sag")[form], changes, truth)


def parameter_error(rng: np.random.Generator, s: Setting) -> Effect:
    """One value is wrong beyond its tolerance.

    Mass and offset are not included: they are `unmodelled_inertia` and `load_bias`.
    """
    ball = s.axis.plant == BALL_SCREW
    name = str(rng.choice(["R", "kt", "sigma2", "Fc"] if ball else ["gain", "sigma2", "Fc"]))
    off = max(s.size(rng, 0.08, 1.0), 2 * TOLERANCE)
    values = scaled(s.axis.values, name, 1 + off if rng.uniform() < 0.5 else 1 / (1 + off))
    wrong, right = vector_of(s.axis.plant, s.axis.values), vector_of(s.axis.plant, values)
    changes = {int(k): float(right[k]) for k in np.flatnonzero(wrong != right)}
    return Effect("parameter_error", name, changes, {name: values[name]})


CATALOGUE: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (
        direction_asymmetry,
        position_periodic_friction,
        position_trend_friction,
        torque_ripple,
        load_bias,
        nonlinear_viscous,
        stribeck_mismatch,
        presliding_hysteresis,
        unmodelled_inertia,
        input_delay,
        friction_drift,
        resistance_drift,
        backlash,
        compliance,
        voltage_saturation,
        parameter_error,
    )
}
