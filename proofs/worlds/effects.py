"""What can be hidden in a record, in all its forms: causes of the catalogue, others, columns."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from worlds import axis as at
from worlds.axis import BALL_SCREW, TOLERANCE, mass_of, scaled, simulated
from worlds.machines import Rng, by_name, log_uniform
from worlds.scenes import Columns, Scene

MOST_SHIFT = 20  # samples
# factors by usual mistakes
OF_ANY = {
    "twice": 2.0, "half": 0.5, "binary_thousand": 1000 / 1024, "tenth_more": 1.1, "tenth_less": 0.9,
}  # fmt: skip
RMS = {"peak_for_rms": math.sqrt(2), "rms_for_peak": 1 / math.sqrt(2)}
FACTORS = {
    "u": OF_ANY | RMS | {"line_voltage": math.sqrt(3), "phase_voltage": 1 / math.sqrt(3)},
    "i": OF_ANY | RMS | {"mean_of_sine": math.pi / 2},
    "x": OF_ANY | {
        "four_edges": 4.0, "one_edge": 0.25, "turn_for_radian": 1 / (2 * math.pi),
        "radian_for_turn": 2 * math.pi, "radius_for_diameter": math.pi,
    },
}  # fmt: skip


@dataclass(frozen=True)
class Effect:
    """One effect that is not in the parameter file."""

    form: str
    changes: dict[str, float] = field(default_factory=dict)  # values of the axis
    period: float = 0.0  # of a periodic effect, m
    factors: dict[str, float] = field(default_factory=dict)  # on columns of the record
    shift: int = 0  # samples by which the record's command is late; negative: early
    name: str = ""


Draw = Callable[[Rng, Scene], Effect]


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _between(rng: Rng, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


def _one_of(rng: Rng, *forms: str) -> str:
    return str(rng.choice(forms))


def _part(rng: Rng, size: float, name: str) -> tuple[str, dict[str, float]]:
    """A share of all friction, or of the dry friction only."""
    if rng.uniform() < 0.4:
        return "all", {name: size, f"{name}_viscous": size}
    return "dry", {name: size}


def direction_asymmetry(rng: Rng, s: Scene) -> Effect:
    """Friction is larger in one direction."""
    return Effect(*_part(rng, _sign(rng) * s.size(rng, 0.005, 0.6), "asymmetry"))


def position_periodic_friction(rng: Rng, s: Scene) -> Effect:
    """Friction oscillates with the screw's turn, or with the return of the balls."""
    form, changes = _part(rng, s.size(rng, 0.01, 0.6), "periodic")
    period = s.conditions.axis.lead * float(rng.choice([1.0, 1.0, 2.0, 0.5, 0.41]))
    changes |= {"period": period, "period_phase": _between(rng, 0, 2 * math.pi)}
    if rng.uniform() < 0.4:
        form, changes["period_second"] = form + "_two_harmonics", _between(rng, 0.2, 0.5)
    return Effect(form, changes, period)


def position_trend_friction(rng: Rng, s: Scene) -> Effect:
    """Friction changes along the used part of the travel: a slope, a bow, one end worn."""
    form = int(rng.integers(0, 3))
    part, changes = _part(rng, _sign(rng) * s.size(rng, 0.01, 0.7), "trend")
    changes |= {"trend_form": form, "travel": s.reach}
    return Effect(("slope", "bow", "worn_end")[form] + "_" + part, changes)


def torque_ripple(rng: Rng, s: Scene) -> Effect:
    """The motor's force oscillates with its angle: cogging, or ripple of the torque constant."""
    form = _one_of(rng, "cogging", "two_harmonics", "of_current", "with_friction")
    period = s.conditions.axis.lead / float(rng.choice([1, 1, 2, 4, 6]))
    changes = {"ripple_period": period, "ripple_phase": _between(rng, 0, 2 * math.pi)}
    if form == "of_current":
        return Effect(form, changes | {"ripple_of_current": s.size(rng, 0.005, 0.3)}, period)
    changes["ripple"] = s.size(rng, 0.01, 0.7) * s.double.Fc
    if form == "two_harmonics":
        changes["ripple_second"] = _between(rng, 0.2, 0.6)
    if form == "with_friction":
        changes["ripple_friction"] = 0.25 * changes["ripple"] / s.double.Fc
    return Effect(form, changes, period)


def load_bias(rng: Rng, s: Scene) -> Effect:
    """A force that is constant, or nearly constant along the travel (a cable chain)."""
    force = _sign(rng) * s.size(rng, 0.01, 1.0) * s.double.Fc
    changes = {"load": s.double.load + force}
    if rng.uniform() < 0.3:
        changes["load_slope"] = _between(rng, -0.2, 0.2) * abs(force) / s.reach
        return Effect("cable", changes)
    return Effect("constant", changes)


def nonlinear_viscous(rng: Rng, s: Scene) -> Effect:
    """Friction at high speed is not proportional to it."""
    form, v = _one_of(rng, "quadratic", "cubic", "root", "thinning"), s.fastest
    force = s.size(rng, 0.02, 2.0) * (s.double.Fc + s.double.sigma2 * v)
    if form == "thinning":
        return Effect(form, {form: s.size(rng, 0.02, 3.0) / v})
    powers = {"quadratic": v**2, "cubic": v**3, "root": math.sqrt(v)}
    return Effect(form, {form: force / powers[form]})


def stribeck_mismatch(rng: Rng, s: Scene) -> Effect:
    """Friction at low speed rises or falls differently from the believed law."""
    coulomb, believed = s.double.Fc, s.double.Fs - s.double.Fc
    falls = {"exponential": at.EXPONENTIAL, "lorentz": at.LORENTZ, "polynomial": at.POLYNOMIAL}
    form = _one_of(rng, "peak", *falls, *(["speed"] if believed > 0 else []))
    if form == "speed":
        return Effect(form, {"Vs": s.double.Vs * (1 + s.size(rng, 0.2, 7.0)) ** _sign(rng)})
    grown, changes = s.size(rng, 0.02, 1.0) * coulomb, {}
    if form != "peak":
        changes["fall"] = falls[form]
        grown *= float(rng.choice([0.0, 1.0])) if believed > 0.2 * coulomb else 1.0
    changes |= {"Fs": s.double.Fs + grown, "Vs": max(s.double.Vs, 0.01 * s.fastest)}
    return Effect(form, changes)


def presliding_hysteresis(rng: Rng, s: Scene) -> Effect:
    """Bristles, with a believed law without bristles."""
    form = _one_of(rng, "lugre", "dahl", "elasto_plastic", "maxwell")
    stiffness = s.double.Fs / s.size(rng, 0.5e-6, 300e-6)
    laws = {"elasto_plastic": at.ELASTO_PLASTIC, "maxwell": at.MAXWELL}
    changes = {"law": laws.get(form, at.LUGRE), "sigma0": stiffness}
    if form in ("lugre", "elasto_plastic"):
        damping = _between(rng, 0.1, 1.0)
        changes["sigma1"] = damping * 2 * math.sqrt(stiffness * mass_of(s.double))
    return Effect(form, changes)


def unmodelled_inertia(rng: Rng, s: Scene) -> Effect:
    """More mass than believed: a load on the block, or a rotor."""
    more = s.size(rng, 0.05, 5.0) * mass_of(s.double)
    form, name = ("rotor", "motor_mass") if rng.uniform() < 0.5 else ("block", "block_mass")
    return Effect(form, {name: s.double[name] + more})


def input_delay(rng: Rng, s: Scene) -> Effect:
    """The command is late: by a delay, or by a filter or a moving mean."""
    form, sampling = _one_of(rng, "pure", "lag", "lag_twice", "mean"), s.conditions.sampling
    late = s.size(rng, max(0.05 * sampling, 2e-5), max(3 * sampling, 2e-3))
    changes = {"pure": {"delay": late}, "lag": {"lag": late}, "mean": {"window": 2 * late}}
    changes["lag_twice"] = {"lag": late / 2, "lag_twice": 1.0}
    return Effect(form, changes[form])


def friction_drift(rng: Rng, s: Scene) -> Effect:
    """Friction changes in time: linearly, exponentially, or in a step."""
    form = int(rng.integers(0, 3))
    size = s.size(rng, 0.01, 1.0)
    part, changes = _part(rng, -size / (1 + size) if rng.uniform() < 0.6 else size, "drift")
    time = _between(rng, 0.15, 0.5 if form == 1 else 0.85) * s.conditions.duration
    changes |= {"drift_form": form, "drift_time": time}
    return Effect(("line", "exponential", "step")[form] + "_" + part, changes)


def resistance_drift(rng: Rng, s: Scene) -> Effect:
    """The winding warms up: linearly, exponentially, in a step, or by its own current."""
    form = int(rng.integers(0, 4))
    force = s.double.Fc + 0.5 * s.double.sigma2 * s.fastest
    changes = {"r_drift": s.size(rng, 0.01, 0.8), "r_form": form, "r_current": force / s.double.kt}
    changes["r_time"] = _between(rng, 0.2, 0.6) * s.conditions.duration
    return Effect(("line", "exponential", "step", "own_current")[form], changes)


def _coupled(rng: Rng, s: Scene) -> tuple[dict[str, float], float]:
    """Divide the mass into two bodies; return the changes and the reduced mass."""
    motor, mass = float(s.double.motor_mass), mass_of(s.double)
    if motor < 0.05 * mass:  # share of the screw or the frame
        motor = _between(rng, 0.05, 0.4) * mass
    rest = mass - motor
    return {"motor_mass": motor, "block_mass": rest}, motor * rest / mass


def backlash(rng: Rng, s: Scene) -> Effect:
    """A gap crossed at reversals, with and without a rebound at its ends."""
    changes, mass = _coupled(rng, s)
    changes |= {"gap": s.size(rng, 2e-6, 1e-3), "spring": mass * 8e3**2}
    form, share = ("rebound", 0.03) if rng.uniform() < 0.5 else ("no_rebound", 0.8)
    changes["spring_damping"] = share * 2 * math.sqrt(changes["spring"] * mass)
    return Effect(form, changes)


def compliance(rng: Rng, s: Scene) -> Effect:
    """A spring between motor and block, with little or much damping."""
    changes, mass = _coupled(rng, s)
    spring = min(s.double.Fs / s.size(rng, 0.1e-6, 100e-6), mass * 1.5e4**2)
    little = rng.uniform() < 0.6
    damping = _between(rng, 0.005, 0.05) if little else _between(rng, 0.2, 0.7)
    changes |= {"spring": spring, "spring_damping": damping * 2 * math.sqrt(spring * mass)}
    form = "little_damping" if little else "much_damping"
    if rng.uniform() < 0.3:
        return Effect(form + "_friction_at_motor", changes | {"friction_at_motor": 1.0})
    return Effect(form, changes)


def voltage_saturation(rng: Rng, s: Scene) -> Effect:
    """The amplifier cannot supply the command: it clips, bends, or sags with the current."""
    form = int(rng.integers(0, 3 if s.conditions.axis.plant == BALL_SCREW else 2))
    cut = s.size(rng, 0.01, 0.7)
    # the current's peak is of the order of a third of the short-circuit current
    limits = s.peak * (1 - cut), s.peak / math.sqrt(3 * cut), s.peak * (1 - 0.5 * cut)
    changes = {"limit": limits[form], "limit_form": form}
    if form == 2:
        changes["sag"] = 0.3 * s.double.R
    return Effect(("clip", "bend", "sag")[form], changes)


def parameter_error(rng: Rng, s: Scene) -> Effect:
    """One value is wrong beyond its tolerance; mass and offset are other causes."""
    axis = s.conditions.axis
    ball = axis.plant == BALL_SCREW
    name = _one_of(rng, *(("R", "kt", "sigma2", "Fc") if ball else ("gain", "sigma2", "Fc")))
    off = max(s.size(rng, 0.08, 1.0), 2 * TOLERANCE)
    values = scaled(axis.values, name, 1 + off if rng.uniform() < 0.5 else 1 / (1 + off))
    wrong, right = simulated(axis.plant, axis.values), simulated(axis.plant, values)
    return Effect(name, {n: right[n] for n in at.AXIS.names if wrong[n] != right[n]})


def burst_disturbance(rng: Rng, s: Scene) -> Effect:
    """Short pushes from outside at random times."""
    return Effect("half_sines", {"bursts": s.size(rng, 0.1, 3.0) * s.double.Fc})


def detent_notch(rng: Rng, s: Scene) -> Effect:
    """A position that holds the block."""
    changes = {"detent": s.size(rng, 0.1, 2.0) * s.double.Fc}
    changes["detent_place"] = _between(rng, -0.5, 0.5) * s.reach
    changes["detent_width"] = _between(rng, 0.01, 0.05) * s.reach
    return Effect("gaussian_well", changes)


def reversal_memory(rng: Rng, s: Scene) -> Effect:
    """Dry friction is larger for some distance after each reversal."""
    size, way = s.size(rng, 0.05, 1.0), _between(rng, 0.02, 0.1) * s.reach
    return Effect("exponential_in_way", {"memory": size, "memory_way": way})


def scale_error(rng: Rng, s: Scene) -> Effect:
    """The scale's reading is bent along the travel."""
    wave = rng.uniform() < 0.5
    size = s.size(rng, 0.0002, 0.05) * s.reach
    changes = {"scale_error": size, "scale_form": wave, "travel": s.reach}
    return Effect("wave" if wave else "bow", changes)


def mains_ripple(rng: Rng, s: Scene) -> Effect:
    frequency = float(rng.choice([50.0, 100.0]))
    changes = {"mains": s.size(rng, 0.0003, 0.2) * s.peak, "mains_frequency": frequency}
    return Effect(f"{frequency:.0f}_hz", changes)


def dwell_ageing(rng: Rng, s: Scene) -> Effect:
    """Dry friction grows with the time at rest, and decreases again in sliding."""
    size, way = s.size(rng, 0.05, 1.0), _between(rng, 0.005, 0.05) * s.reach
    return Effect("logarithmic", {"ageing": size, "ageing_way": way})


def second_resonance(rng: Rng, s: Scene) -> Effect:
    """A body on the block oscillates on a spring; the static mass is as believed."""
    block = s.double.block_mass
    mass = s.size(rng, 0.02, 0.6) * block
    angular = 2 * math.pi * log_uniform(rng, 4.0, 80.0)
    changes = {"resonator": mass, "resonator_spring": mass * angular**2}
    changes["resonator_damping"] = _between(rng, 0.005, 0.05) * 2 * mass * angular
    return Effect("appended_mass", changes | {"block_mass": block - mass})


def other_bristles(rng: Rng, s: Scene) -> Effect:
    """Bristles of a law that differs from the believed one, which has bristles, too."""
    form = _one_of(rng, "elasto_plastic", "maxwell", "dahl")
    if form == "dahl":
        return Effect(form, {"sigma1": 0.0})
    law = at.ELASTO_PLASTIC if form == "elasto_plastic" else at.MAXWELL
    return Effect(form, {"law": law, "sigma0": s.double.sigma0 * s.size(rng, 0.3, 3.0)})


def _scale(column: str, rng: Rng, s: Scene) -> Effect:
    """A column has another unit, or its counts are wrongly converted."""
    form = _one_of(rng, *FACTORS[column])
    return Effect(form, factors={column: FACTORS[column][form]})


def _turned(column: str, rng: Rng, s: Scene) -> Effect:
    return Effect("turned", factors={column: -1.0})


def time_shift(rng: Rng, s: Scene) -> Effect:
    """The command was recorded with a separate clock: it is some samples late or early."""
    shift = int(rng.integers(2, MOST_SHIFT + 1))
    early = rng.uniform() < 0.5
    return Effect("early" if early else "late", shift=-shift if early else shift)


CATALOGUE: dict[str, Draw] = by_name(
    direction_asymmetry, position_periodic_friction, position_trend_friction, torque_ripple,
    load_bias, nonlinear_viscous, stribeck_mismatch, presliding_hysteresis, unmodelled_inertia,
    input_delay, friction_drift, resistance_drift, backlash, compliance, voltage_saturation,
    parameter_error,
)  # fmt: skip
OUTSIDE: dict[str, Draw] = by_name(
    burst_disturbance, detent_notch, reversal_memory, scale_error, mains_ripple, dwell_ageing,
    second_resonance, other_bristles,
)  # fmt: skip
SIGNALS: dict[str, Draw] = {f"scale_of_{column}": partial(_scale, column) for column in "uix"}
SIGNALS |= {f"sign_of_{column}": partial(_turned, column) for column in "ux"}
SIGNALS["time_shift"] = time_shift
EFFECTS = CATALOGUE | OUTSIDE | SIGNALS


def spoilt(record: Columns, effects: tuple[Effect, ...]) -> Columns:
    """The record with its columns changed by the effects; the axis is not."""
    for effect in effects:
        record = {n: column * effect.factors.get(n, 1.0) for n, column in record.items()}
        late = abs(effect.shift)
        if late:  # cut off samples without a counterpart
            first, last = slice(late, None), slice(None, -late)
            of_u, of_others = (last, first) if effect.shift > 0 else (first, last)
            record = {n: column[of_u if n == "u" else of_others] for n, column in record.items()}
            record["time"] = record["time"] - record["time"][0]
    return record
