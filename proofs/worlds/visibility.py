"""Visibility of an effect in a record, and causes with the same shape, computed from the truth.

1. *Trace.* In a run with the effect, but without friction noise and instruments, the force of the
   command (or of the recorded current) beyond that which the faultless axis needs for the motion,
   and with a current also the voltage, are averaged over sampling periods. At a speed that the
   encoder cannot show, motion counts as rest, and a set-valued law gives no force.
2. *Noise.* In a run without the effect, but with friction noise, the same differences are the noise
   of force, and the columns have the errors of the instruments. Errors of the position become
   forces by mass, damping and back-EMF, and at rest by the bristles. Welch's spectra are added.
3. *Ratio.* Trace and shapes are weighted by that spectrum. Values that a user would fit are
   projected out: each believed value, with a cost by its tolerance (an error of 3 % costs 1), and
   an offset without cost (except for `load_bias`, which is an offset). The length of the remaining
   trace is the ratio: the signal-to-noise ratio of the best test for an effect of known shape.
4. *Same shape.* Another cause of the catalogue has the effect's shape if one of its forms along the
   same motion, together with the fitted values, gives a remaining ratio below 3.

A shape is the effect of a small unknown on the balances of a record, shape (balances, rows): one of
force if no current is recorded, otherwise one of force and one of voltage. A rounding encoder is
treated as one with additive noise, so the ratio is conservative.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import welch
from scipy.signal.windows import tukey

from worlds import axis as at
from worlds.axis import BALL_SCREW, TOLERANCE, changed, compiled, mass_of
from worlds.effects import SIGNALS, Effect
from worlds.friction import REVERSAL, advance, dry_force, level
from worlds.scenes import Scene, make_record, read_position, sampled

SAME = 3.0  # ratio below which two shapes count as equal
HIGHEST = 1000.0  # highest used frequency, Hz
LEAST_NOISE = 1e-4  # numerical noise, share of the Coulomb force (or its voltage), rms
REST = 1e-5  # m/s
RESTING = 1e-9  # m/s
FALLS = (0.5, 1.0, 2.0, 5.0, 20.0)  # of the speed of the believed law
WAYS = (1e-6, 4e-6, 15e-6, 60e-6, 250e-6, 1e-3)  # m since a reversal


@dataclass(frozen=True)
class Sight:
    """Visibility of one effect in one record, from the truth."""

    ratio: float
    shared: tuple[str, ...]  # other causes of the same shape, if the ratio is above `SAME`
    remaining: dict[str, float]  # ratio after fitting each other cause


@compiled
def _dry_along(par, state, v, period):
    """Dry friction of a law along a motion given by its mean velocities."""
    force = np.zeros(v.size)
    state.dry = 1.0
    for k in range(v.size):
        if par.law == at.SET_VALUED:
            force[k] = np.sign(v[k]) * level(par, v[k])
            continue
        advance(par, state, 0.0, v[k], 0.5 * period)
        force[k] = dry_force(par, state, v[k])
        advance(par, state, 0.0, v[k], 0.5 * period)
    return force


def dry_along(par: np.record, v: np.ndarray, period: float) -> np.ndarray:
    """The same from rest."""
    return _dry_along(par, np.zeros(1, at.STATE)[0], v, period)


@compiled
def way_since_reversal(x):
    """Distance moved since the last reversal."""
    way, turned, extreme, direction = np.zeros(x.size), x[0], x[0], 0.0
    for k in range(x.size):
        if direction == 0.0:
            direction = np.sign(x[k] - x[0])
        if (x[k] - extreme) * direction >= 0.0:
            extreme = x[k]
        elif abs(x[k] - extreme) > REVERSAL:
            direction, turned, extreme = -direction, extreme, x[k]
        way[k] = abs(x[k] - turned)
    return way


@dataclass(frozen=True)
class Along:
    """A motion's log, and the conversion of shapes to balances."""

    scene: Scene
    log: np.ndarray
    moving: np.ndarray | float = 1.0  # 0 where the balance of force gives no information

    @property
    def period(self) -> float:
        """Period of the log, s."""
        return self.scene.conditions.period / self.scene.logged

    def force(self, shape: np.ndarray) -> np.ndarray:
        """The effect of a force on the balances."""
        shape = shape * self.moving
        return np.stack([shape, np.zeros_like(shape)]) if self.scene.with_current else shape[None]

    def voltage(self, shape: np.ndarray) -> np.ndarray:
        """The effect of a voltage on the balances."""
        if self.scene.with_current:
            return np.stack([np.zeros_like(shape), shape])
        return (volt_force(self.scene.double) * (shape * self.moving))[None]

    @property
    def needed(self) -> np.ndarray:
        """Force that the faultless axis needs for this motion, N."""
        par, log = self.scene.double, self.log
        return mass_of(par) * log["a"] + log["friction"] + par.load

    @property
    def current(self) -> np.ndarray:
        """The current used in the balances, A."""
        if self.scene.with_current:
            return self.log["current_mean"]
        return self.needed / self.scene.double.kt


def volt_force(par: np.record) -> float:
    """Force of a voltage without back-EMF, N/V."""
    return par.gain if par.is_drive else par.kt / par.R


def needs(scene: Scene, log: np.ndarray) -> np.ndarray:
    """The differences of point 1, shape (balances, rows)."""
    names = ["need_force", "need_voltage"] if scene.with_current else ["need"]
    return np.stack([log[name] for name in names])


def refits(along: Along) -> dict[str, np.ndarray]:
    """Effect of each believed value if it is wrong by its tolerance.

    Gains act on the needed force, not on the supplied force: the supplied force contains the
    effect, and all values together could explain everything by a machine without any force.
    """
    axis, log, par = along.scene.conditions.axis, along.log, along.scene.double
    shapes = {
        "m": along.force(axis.values["m"] * log["a"]),
        "sigma2": along.force(par.sigma2 * log["v"]),
        "Fc": along.force(log["dry"]),
    }
    if axis.plant == BALL_SCREW:
        shapes["R"] = along.voltage(par.R * along.current)
        shapes["kt"] = along.force(along.needed) - along.voltage(par.ke * log["v"])
    else:
        shapes["gain"] = along.force(along.needed)
    if par.Fs > par.Fc:
        bristles = ("sigma0", "sigma1") if par.law != at.SET_VALUED else ()
        for name in ("Vs", *bristles, "Fs"):
            shapes[name] = along.force(_derivative(along, name))
    return {name: TOLERANCE * shape for name, shape in shapes.items()}


def _derivative(along: Along, name: str) -> np.ndarray:
    """Change of the dry friction for twice the value, from a small difference."""
    par, v = along.scene.double, along.log["v"]
    more = changed(par, {name: par[name] * 1.02})
    return (dry_along(more, v, along.period) - dry_along(par, v, along.period)) / 0.02


def families(along: Along, periods: tuple[float, ...]) -> dict[str, list[list[np.ndarray]]]:
    """The catalogue's shapes: several forms of each cause, with the columns of each form.

    `periods` are those of periodic causes, m.
    """
    par, log, force = along.scene.double, along.log, along.force
    dry, v, x, u, mass = log["dry"], log["v"], log["x"], log["command"], mass_of(par)
    sign, place, one = np.sign(v), x / max(along.scene.reach, 1e-9), np.ones(len(log))
    t = np.arange(len(log)) * along.period / along.scene.conditions.duration
    courses = [t, 1 - np.exp(-t / 0.15), 1 - np.exp(-t / 0.35)]
    courses += [(t > c).astype(float) for c in (0.25, 0.5, 0.75)]
    parts = [dry, dry + (log["friction"] - dry)]
    way = way_since_reversal(x)
    pulses = [force(sign * np.exp(-way / w)) for w in WAYS]
    load = along.needed
    slope = np.gradient(load, along.period)
    bent = force(mass * np.gradient(slope, along.period) + par.sigma2 * slope)
    angles = [2 * np.pi * x / p for p in periods]
    of_friction, of_motor = (
        [[force(shape * f(angle)) for f in (np.cos, np.sin)] for shape in some for angle in angles]
        for some in (parts, [one])
    )
    limits = np.abs(u).max() * np.array([0.97, 0.9, 0.8, 0.65, 0.5, 0.35])
    moving, back = mass * log["a"] + par.sigma2 * v, along.voltage(par.ke * v)
    scale_of_u = [[along.voltage(u)]]
    found = {
        "direction_asymmetry": [[force(np.abs(p))] for p in parts],
        "position_periodic_friction": of_friction,
        "position_trend_friction": [[force(p * place**k)] for p in parts for k in (1, 2)],
        "torque_ripple": of_motor,
        "load_bias": [[force(one)]],
        "nonlinear_viscous": [[force(sign * np.abs(v) ** k)] for k in (2.0, 3.0, 0.5)],
        "stribeck_mismatch": [[force(sign * np.exp(-np.abs(v) / (par.Vs * f)))] for f in FALLS],
        "presliding_hysteresis": [[p] for p in pulses],
        "unmodelled_inertia": [[force(log["a"])]],
        "input_delay": _late(along, (0.1, 0.3, 1.0, 3.0)),
        "friction_drift": [[force(p * c)] for p in parts for c in courses],
        "backlash": [[force(load * (way < w))] for w in WAYS],
        "compliance": [[bent], *[[bent, p] for p in pulses]],
        "voltage_saturation": [[along.voltage(np.clip(u, -most, most) - u)] for most in limits],
        "parameter_error": [[shape] for name, shape in refits(along).items() if name != "m"],
        "scale_of_u": scale_of_u,
        "sign_of_u": scale_of_u,
        "scale_of_x": [[force(moving) + back]],
        "sign_of_x": [[force(moving + dry) + back]],
        "time_shift": _late(along, (-20.0, -10.0, -5.0, -2.0, 2.0, 5.0, 10.0, 20.0)),
    }
    if along.scene.conditions.axis.plant == BALL_SCREW:
        found["resistance_drift"] = [[along.voltage(par.R * along.current * c)] for c in courses]
    if along.scene.with_current:
        i = log["current_mean"]
        found["scale_of_i"] = [[force(par.kt * i) - along.voltage(par.R * i)]]
    return found


def _late(along: Along, samples: tuple[float, ...]) -> list[list[np.ndarray]]:
    u = along.log["command"]
    time = np.arange(u.size) * along.period
    steps = along.scene.conditions.sampling * np.array(samples)
    return [[along.voltage(np.interp(time - late, time, u) - u)] for late in steps]


def see_effect(scene: Scene, effect: Effect) -> Along | None:
    """The motion with an effect; none if it leaves all bounds."""
    log = scene.run(effect.changes, clean=True)[0]
    if not finite(log):
        return None
    if effect.name == "scale_error":
        log = _bent(log, scene, effect)
    along = Along(scene, log)
    return _misread(along, effect) if effect.name in SIGNALS else along


def finite(log: np.ndarray) -> bool:
    return bool(np.isfinite(log.view(float)).all())


def _bent(log: np.ndarray, scene: Scene, effect: Effect) -> np.ndarray:
    """A log whose needs are those of the motion measured by a bent scale."""
    period, par = scene.conditions.period / scene.logged, scene.double
    axis = changed(scene.faultless, {"resolution": 0.0, "interpolation": 0.0} | effect.changes)
    exact = replace(scene.instruments, encoder="exact")
    speed = np.gradient(read_position(exact, axis, log["x"]) - log["x"], period)
    force = mass_of(par) * np.gradient(speed, period) + par.sigma2 * speed
    volts = 0.0 if par.is_drive else par.kt / par.R * par.ke
    log = log.copy()
    log["need_force"] -= force
    log["need_voltage"] -= par.ke * speed
    log["need"] -= force + volts * speed
    return log


def _misread(along: Along, effect: Effect) -> Along:
    """A motion as in the wrong columns, with the force that it does not need.

    A set-valued law at rest holds any force: there, the balance of force gives no information.
    """
    par, log, period = along.scene.double, along.log, along.period
    factors, read = effect.factors, along.log.copy()
    for name in ("x", "v", "a"):
        read[name] *= factors.get("x", 1.0)
    for name in ("current", "current_mean"):
        read[name] *= factors.get("i", 1.0)
    if "x" in factors:
        read["dry"] = dry_along(par, read["v"], period)
        read["friction"] = read["dry"] + par.sigma2 * read["v"]
    read["command"] *= factors.get("u", 1.0)
    if effect.shift:
        time = np.arange(len(log)) * period
        late = effect.shift * along.scene.conditions.sampling
        read["command"] = np.interp(time - late, time, read["command"])
    more = {name: read[name] - log[name] for name in log.dtype.names}
    force = mass_of(par) * more["a"] + more["friction"]
    volts = more["command"] - par.ke * more["v"]
    drop = par.R * more["current_mean"] + par.L * np.gradient(more["current_mean"], period)
    read["need_force"] += par.kt * more["current_mean"] - force
    read["need_voltage"] += volts - drop
    read["need"] += volt_force(par) * volts - force
    least = max(par.least_speed, RESTING) if par.law == at.SET_VALUED else -1.0
    moving = (np.abs(log["v"]) > least).astype(float)
    for name in ("need", "need_force"):
        read[name] *= moving
    return replace(along, log=read, moving=moving)


def whitening(scene: Scene) -> Callable[[np.ndarray], np.ndarray]:
    """What makes balances a vector in noise of unit variance, by the faultless record's noise."""
    log = scene.motion[0]
    noise = sampled(needs(scene, log), scene.per_sample)
    _, errors = make_record(scene, scene.motion, {})
    par, rate, two = scene.double, 1 / scene.conditions.sampling, scene.with_current
    length = min(noise.shape[1], max(256, int(4 * rate)))

    def spectrum(signal: np.ndarray) -> np.ndarray:
        return welch(signal, fs=rate, nperseg=length)[1]

    frequencies = np.fft.rfftfreq(length, 1 / rate)
    s = 2j * np.pi * frequencies
    # at rest, a position error is an error of the bristles' deflection
    stiffness = par.sigma0 * np.sqrt(np.mean(np.abs(log["v"]) < REST))
    damping = par.sigma2
    if not (par.is_drive or two):
        damping += par.kt * par.ke / par.R
    of_x = spectrum(errors["x"])
    floor = 2 * (LEAST_NOISE * par.Fc) ** 2 / rate
    of_force = np.abs(mass_of(par) * s**2 + damping * s + stiffness) ** 2 * of_x
    spectra = [spectrum(noise[0]) + of_force]
    if two:
        of_i = spectrum(errors["i"])
        of_volts = spectrum(noise[1]) + np.abs(par.ke * s) ** 2 * of_x
        of_volts += np.abs(par.R + par.L * s) ** 2 * of_i
        spectra = [spectra[0] + par.kt**2 * of_i, of_volts + (par.R / par.kt) ** 2 * floor]
    spectra[0] = spectra[0] + floor
    if "u" in errors:
        of_u = 1.0 if two else volt_force(par)
        spectra[-1] = spectra[-1] + of_u**2 * spectrum(errors["u"])
    own = np.fft.rfftfreq(noise.shape[1], scene.conditions.sampling)
    own = own[own <= HIGHEST]
    # Welch's lowest line is without its mean: use the next one instead
    at_own = [np.exp(np.interp(own, frequencies[1:], np.log(one[1:]))) for one in spectra]
    samples, window = noise.shape[1], tukey(noise.shape[1], 0.02)
    deviations = np.sqrt(samples * np.array(at_own) / scene.conditions.sampling)

    def whiten(shape: np.ndarray) -> np.ndarray:
        averaged = sampled(shape, scene.per_sample)[:, :samples]
        scaled = np.fft.rfft(averaged * window)[:, : own.size] * 2 / deviations
        scaled[:, 0] /= np.sqrt(2.0)
        flat = scaled.ravel()
        return np.concatenate([flat.real, flat.imag])

    return whiten


def see(name: str, alongs: list[Along], periods: tuple[float, ...] | None = None) -> Sight:
    """Points 3 and 4 for an effect, or for the mismatch of the law (without a name).

    There is one motion for every record of the machine, and one offset for all. Causes of the same
    shape are only searched with the periods of periodic causes, m.
    """
    whiten = [whitening(along.scene) for along in alongs]

    def white(shapes: Iterable[np.ndarray]) -> np.ndarray:
        return np.concatenate([w(shape) for w, shape in zip(whiten, shapes, strict=True)])

    costly = [white(shapes) for shapes in zip(*(refits(a).values() for a in alongs), strict=True)]
    offset = white(a.force(np.ones(len(a.log))) for a in alongs)
    free = [] if name == "load_bias" else [offset]
    count = len(costly)
    costs = np.eye(count, count + len(free))
    basis = np.linalg.qr(np.vstack([np.column_stack(costly + free), costs]))[0]

    def left(vector: np.ndarray) -> np.ndarray:
        whole = np.concatenate([vector, np.zeros(count)])
        return whole - basis @ (basis.T @ whole)

    trace = left(white(needs(a.scene, a.log) for a in alongs))
    ratio = float(np.linalg.norm(trace))
    if periods is None or ratio < SAME:
        return Sight(ratio, (), {})
    remaining = {}
    known = [families(a, periods) for a in alongs]
    for other in known[0]:
        # a wrong sign is a scale of -1, no other scale is a wrong sign
        if other == name or (other.startswith("sign") and not name.startswith("sign")):
            continue
        forms = zip(*(one[other] for one in known), strict=True)  # each form, for all records
        columns = ([left(white(c)) for c in zip(*form, strict=True)] for form in forms)
        remaining[other] = min(_beside(trace, np.column_stack(some)) for some in columns)
    shared = tuple(sorted(n for n, r in remaining.items() if r < SAME))
    return Sight(ratio, shared, remaining)


def _beside(trace: np.ndarray, block: np.ndarray) -> float:
    """Residual of a trace after fitting a block of columns."""
    sizes = np.linalg.norm(block, axis=0)
    if not np.all(sizes > 1e-9):
        return float(np.linalg.norm(trace))
    columns = block / sizes
    best = np.linalg.lstsq(columns, trace, rcond=1e-9)[0]
    return float(np.linalg.norm(trace - columns @ best))
