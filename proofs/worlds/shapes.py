"""Shapes of refitted values and of each cause, along one true motion.

A shape is the effect of a small unknown on the balances of a record, shape (balances, rows). The
balances are one of force if no current is recorded, otherwise one of force and one of voltage.
Nothing is from the estimator: the shapes come from the generator's log of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worlds import layout as at
from worlds.axes import BALL_SCREW, TOLERANCE
from worlds.compiled import compiled
from worlds.effects import Setting
from worlds.friction import REVERSAL, STATES, advance, dry_force, level
from worlds.layout import Vector

Shape = NDArray[np.float64]
WAYS = (1e-6, 4e-6, 15e-6, 60e-6, 250e-6, 1e-3)  # m since a reversal


@compiled
def dry_along(par, v, period):  # type: ignore[no-untyped-def]
    """Dry friction of a law along a motion given by its mean velocities."""
    state, force = np.zeros(STATES), np.zeros(v.size)
    for k in range(v.size):
        if par[at.LAW] == at.SET_VALUED:
            force[k] = np.sign(v[k]) * level(par, v[k])
            continue
        advance(par, state, 0.0, v[k], 1.0, 0.5 * period)
        force[k] = dry_force(par, state, v[k], 1.0)
        advance(par, state, 0.0, v[k], 1.0, 0.5 * period)
    return force


@compiled
def way_since_reversal(x):  # type: ignore[no-untyped-def]
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
    """A motion's log, and the conversion of shapes to balances.

    Attributes
    ----------
    setting : Setting
    log : ndarray, shape (rows, LOGGED)
    period : float
        Period of the log, s.
    with_current : bool
    moving : ndarray, shape (rows,), optional
        0 if the balance of force gives no information, else 1.
    """

    setting: Setting
    log: NDArray[np.float64]
    period: float
    with_current: bool
    moving: Shape | None = None

    def force(self, shape: Shape) -> Shape:
        """The effect of a force on the balances."""
        shape = shape if self.moving is None else shape * self.moving
        return np.stack([shape, np.zeros_like(shape)]) if self.with_current else shape[None]

    def voltage(self, shape: Shape) -> Shape:
        """The effect of a voltage on the balances."""
        par = self.setting.double
        if self.with_current:
            return np.stack([np.zeros_like(shape), shape])
        gain = par[at.GAIN] if par[at.IS_DRIVE] else par[at.KT] / par[at.R]
        shape = shape if self.moving is None else shape * self.moving
        return (gain * shape)[None]

    @property
    def needed(self) -> Shape:
        """Force that the faultless axis needs for this motion, N."""
        par, log = self.setting.double, self.log
        return np.asarray(self.setting.mass * log[:, at.A] + log[:, at.FRICTION] + par[at.LOAD])

    @property
    def current(self) -> Shape:
        """The current used in the balances, A."""
        if self.with_current:
            return self.log[:, at.CURRENT_MEAN]
        return self.needed / self.setting.double[at.KT]


def refits(along: Along) -> dict[str, Shape]:
    """Effect of each believed value if it is wrong by its tolerance.

    Gains act on the needed force, not on the supplied force: the supplied force contains the
    effect, and all values together could explain everything by a machine without any force.
    """
    s, log = along.setting, along.log
    par, v = s.double, log[:, at.V]
    shapes = {
        "m": along.force(s.axis.values["m"] * log[:, at.A]),
        "sigma2": along.force(par[at.SIGMA2] * v),
        "Fc": along.force(log[:, at.DRY]),
    }
    if s.axis.plant == BALL_SCREW:
        i, back = along.current, par[at.KE] * v
        shapes["R"] = along.voltage(par[at.R] * i)
        shapes["kt"] = along.force(along.needed) - along.voltage(back)
    else:
        shapes["gain"] = along.force(along.needed)
    names = {"Vs": at.VS}
    if par[at.LAW] != at.SET_VALUED:
        names |= {"sigma0": at.SIGMA0, "sigma1": at.SIGMA1}
    if par[at.FS] > par[at.FC]:
        names |= {"Fs": at.FS}
        for name, place in names.items():
            shapes[name] = along.force(_derivative(along, place))
    return {name: TOLERANCE * shape for name, shape in shapes.items()}


def _derivative(along: Along, place: int) -> Shape:
    """Change of the dry friction for twice the value, from a small difference."""
    par, v = along.setting.double, along.log[:, at.V]
    more: Vector = par.copy()
    more[place] *= 1.02
    return np.asarray((dry_along(more, v, along.period) - dry_along(par, v, along.period)) / 0.02)


def families(along: Along, periods: tuple[float, ...]) -> dict[str, list[list[Shape]]]:
    """The catalogue's shapes: several forms of each cause, with the columns of each form.

    Parameters
    ----------
    along : Along
    periods : tuple of float
        Of periodic causes, m.
    """
    s, log = along.setting, along.log
    par, dry, v, x = s.double, log[:, at.DRY], log[:, at.V], log[:, at.X]
    viscous = log[:, at.FRICTION] - dry
    sign, place = np.sign(v), x / max(s.reach, 1e-9)
    t = np.arange(len(log)) * along.period / s.duration
    force, one = along.force, np.ones(len(log))
    courses = [t, 1 - np.exp(-t / 0.15), 1 - np.exp(-t / 0.35)]
    courses += [(t > c).astype(float) for c in (0.25, 0.5, 0.75)]
    parts = [dry, dry + viscous]
    way = way_since_reversal(x)
    pulses = [sign * np.exp(-way / w) for w in WAYS]
    falls = [sign * np.exp(-np.abs(v) / (par[at.VS] * f)) for f in (0.5, 1.0, 2.0, 5.0, 20.0)]
    load = along.needed
    crossing = [load * (way < w) for w in WAYS]
    slope = np.gradient(load, along.period)
    bent = s.mass * np.gradient(slope, along.period) + par[at.SIGMA2] * slope
    waves = [
        [shape * np.cos(2 * np.pi * x / p), shape * np.sin(2 * np.pi * x / p)]
        for shape in (*parts, one)
        for p in periods
    ]
    split = 2 * len(periods)
    found: dict[str, list[list[Shape]]] = {
        "direction_asymmetry": [[force(np.abs(p))] for p in parts],
        "position_periodic_friction": [[force(c) for c in w] for w in waves[:split]],
        "position_trend_friction": [[force(p * place**k)] for p in parts for k in (1, 2)],
        "torque_ripple": [[force(c) for c in w] for w in waves[split:]],
        "load_bias": [[force(one)]],
        "nonlinear_viscous": [[force(sign * np.abs(v) ** k)] for k in (2.0, 3.0, 0.5)],
        "stribeck_mismatch": [[force(f)] for f in falls],
        "presliding_hysteresis": [[force(p)] for p in pulses],
        "unmodelled_inertia": [[force(log[:, at.A])]],
        "input_delay": _late(along),
        "friction_drift": [[force(p * c)] for p in parts for c in courses],
        "backlash": [[force(c)] for c in crossing],
        "compliance": [[force(bent)], *[[force(bent), force(p)] for p in pulses]],
        "voltage_saturation": _clipped(along),
        "parameter_error": [[shape] for name, shape in refits(along).items() if name != "m"],
    }
    if s.axis.plant == BALL_SCREW:
        warm = par[at.R] * along.current
        found["resistance_drift"] = [[along.voltage(warm * c)] for c in courses]
    found["scale_of_u"] = found["sign_of_u"] = [[along.voltage(log[:, at.COMMAND])]]
    moving, back = s.mass * log[:, at.A] + par[at.SIGMA2] * v, along.voltage(par[at.KE] * v)
    found["scale_of_x"] = [[force(moving) + back]]
    found["sign_of_x"] = [[force(moving + dry) + back]]
    if along.with_current:
        i = log[:, at.CURRENT_MEAN]
        found["scale_of_i"] = [[force(par[at.KT] * i) - along.voltage(par[at.R] * i)]]
    found["time_shift"] = _late(along, (-20.0, -10.0, -5.0, -2.0, 2.0, 5.0, 10.0, 20.0))
    return found


def _late(along: Along, samples: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0)) -> list[list[Shape]]:
    """Changes of the command by some delays."""
    u = along.log[:, at.COMMAND]
    time = np.arange(u.size) * along.period
    steps = along.setting.sampling * np.array(samples)
    return [[along.voltage(np.interp(time - late, time, u) - u)] for late in steps]


def _clipped(along: Along) -> list[list[Shape]]:
    """Changes of the command by some limits."""
    u = along.log[:, at.COMMAND]
    limits = np.abs(u).max() * np.array([0.97, 0.9, 0.8, 0.65, 0.5, 0.35])
    return [[along.voltage(np.clip(u, -most, most) - u)] for most in limits]
