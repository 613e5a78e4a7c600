"""Friction laws, compiled: each is solved exactly for a constant velocity over a substep.

Set-valued Coulomb friction has no state: it is solved together with the velocity (`kick`). The
others have deflections. At constant velocity these are exponential (LuGre, with or without the
smooth sign; Dahl's law is LuGre without damping and peak), piecewise exponential (elasto-plastic),
or linear with a limit (Maxwell's elements). All changes of the dry friction change its level.
"""

from __future__ import annotations

import math

import numpy as np

from worlds import axis as at
from worlds.axis import ELEMENTS, compiled

SHARES = np.array([0.4, 0.3, 0.2, 0.1])  # shares of the level
STIFFNESSES = np.array([0.1, 0.2, 0.3, 0.4])  # shares of sigma0
BREAKAWAY = 0.7  # elasto-plastic: elastic below this share of the level
REVERSAL = 2e-6  # motion back that counts as a reversal, m
AT_REST = 1e-6  # m/s


@compiled
def fall(form, speed, scale):
    """Remaining share of the break-away peak at a speed, 1 at rest."""
    r = speed / scale
    if form == at.GAUSSIAN:
        return math.exp(-r * r) if r < 7.0 else 0.0
    if form == at.EXPONENTIAL:
        return math.exp(-r) if r < 40.0 else 0.0
    if form == at.LORENTZ:
        return 1.0 / (1.0 + r * r)
    return (1.0 - r / 2.0) ** 2 if r < 2.0 else 0.0


@compiled
def level(par, v):
    """Dry friction while sliding."""
    if par.Fs == par.Fc:
        return par.Fc
    return par.Fc + (par.Fs - par.Fc) * fall(par.fall, abs(v), par.Vs)


@compiled
def progress(form, t, time, duration):
    """A drift's course: linear over the record, exponential, or a step."""
    if form == 0:
        return t / duration
    if form == 1:
        return 1.0 - math.exp(-t / time)
    return 1.0 if t > time else 0.0


@compiled
def along_travel(form, x, half):
    """A trend's course along the travel: linear, quadratic, or one end worn."""
    s = x / half
    if form == 0:
        return s
    if form == 1:
        return s * s
    return 1.0 / (1.0 + math.exp(-8.0 * (s - 0.5)))


@compiled
def update_factors(par, state, x, v, t):
    """Factors on the dry level and on the viscous force, at a place, a speed and a time."""
    dry, viscous = 1.0, 1.0
    sign = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else state.direction)
    dry += par.asymmetry * sign
    viscous += par.asymmetry_viscous * sign
    if par.periodic != 0.0:
        angle = 2.0 * math.pi * x / par.period + par.period_phase
        wave = math.cos(angle) + par.period_second * math.cos(2.0 * angle)
        dry += par.periodic * wave
        viscous += par.periodic_viscous * wave
    if par.ripple_friction != 0.0:
        angle = 2.0 * math.pi * x / par.ripple_period + par.ripple_phase
        dry += par.ripple_friction * math.cos(angle)
    if par.trend != 0.0 or par.trend_viscous != 0.0:
        place = along_travel(par.trend_form, x, par.travel)
        dry += par.trend * place
        viscous += par.trend_viscous * place
    if par.drift != 0.0 or par.drift_viscous != 0.0:
        course = progress(par.drift_form, t, par.drift_time, par.duration)
        dry += par.drift * course
        viscous += par.drift_viscous * course
    if par.memory != 0.0:
        dry += par.memory * math.exp(-abs(x - state.reversed_at) / par.memory_way)
    if par.ageing != 0.0:
        grown = par.ageing * math.log1p(state.rested / 0.1)
        dry += grown * math.exp(-state.slid / par.ageing_way)
    state.dry, state.viscous = max(dry, 0.05), max(viscous, 0.05)


@compiled
def viscous_force(par, v):
    """The part that grows with the speed."""
    speed = abs(v)
    force = par.sigma2 * v / (1.0 + par.thinning * speed)
    force += (par.quadratic * speed + par.cubic * speed * speed) * v
    if par.root != 0.0 and speed > 0.0:
        force += par.root * v / math.sqrt(speed)
    return force


@compiled
def smooth_sign(par, v):
    """The sign of the modified LuGre law; a plain sign for the others."""
    if par.law == at.MODIFIED_LUGRE:
        steep = par.Kv * v
        if abs(steep) > 1e4:  # series of the arc tangent, to the last digit
            return (1.0 if v > 0.0 else -1.0) - 2.0 / math.pi / steep
        return 2.0 / math.pi * math.atan(steep)
    return 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)


@compiled
def plastic_share(z, v, full):
    """The elasto-plastic law's share of sliding in a deflection."""
    if z * v <= 0.0 or abs(z) < BREAKAWAY * full:
        return 0.0
    if abs(z) >= full:
        return 1.0
    middle = 0.5 * (1.0 + BREAKAWAY) * full
    return 0.5 * (1.0 + math.sin(math.pi * (abs(z) - middle) / (full * (1.0 - BREAKAWAY))))


@compiled
def rate(par, z, v, dry):
    """Growth of a bristle's deflection."""
    g = dry * level(par, v)
    if par.law == at.ELASTO_PLASTIC:
        full = g / par.sigma0
        return v * (1.0 - plastic_share(z, v, full) * abs(z) / full)
    s = smooth_sign(par, v)
    return s * s * v - par.sigma0 * s * v * z / g


@compiled
def dry_force(par, state, v):
    """Force of the deflections (not of the set-valued law)."""
    if par.law == at.MAXWELL:
        force = 0.0
        for k in range(ELEMENTS):
            force += STIFFNESSES[k] * par.sigma0 * state.z[k]
        return force
    return par.sigma0 * state.z[0] + par.sigma1 * rate(par, state.z[0], v, state.dry)


@compiled
def decay(a):
    """exp(-a), by an equally exact fraction for small a."""
    if a < 0.02:
        even, odd = 1.0 + a * a / 12.0, 0.5 * a
        return (even - odd) / (even + odd)
    return math.exp(-a)


@compiled
def advance(par, state, x, v, h):
    """Deflections, direction, rest and distance after a time at constant velocity."""
    law = par.law
    if law == at.MAXWELL:
        g = state.dry * level(par, v)
        for k in range(ELEMENTS):
            most = SHARES[k] * g / (STIFFNESSES[k] * par.sigma0)
            state.z[k] = min(max(state.z[k] + v * h, -most), most)
    elif law == at.ELASTO_PLASTIC and v != 0.0:
        full = state.dry * level(par, v) / par.sigma0
        a = plastic_share(state.z[0], v, full) * abs(v) / full * h
        grown = 1.0 if a < 1e-9 else -math.expm1(-a) / a
        state.z[0] = state.z[0] * decay(a) + v * h * grown
    elif law in (at.LUGRE, at.MODIFIED_LUGRE) and v != 0.0:
        s = smooth_sign(par, v)
        g = state.dry * level(par, v)
        end = s * g / par.sigma0
        state.z[0] = end + (state.z[0] - end) * decay(par.sigma0 * s * v / g * h)
    if state.direction == 0.0:
        if v != 0.0:
            state.direction = 1.0 if v > 0.0 else -1.0
            state.extreme, state.reversed_at = x, x - 1.0  # far back
    elif (x - state.extreme) * state.direction > 0.0:
        state.extreme = x
    elif (state.extreme - x) * state.direction > REVERSAL:
        state.direction = -state.direction
        state.reversed_at, state.extreme = state.extreme, x
    if abs(v) < AT_REST:
        if state.slid > 5.0 * par.ageing_way:
            state.rested = 0.0
        state.rested += h
        state.slid = 0.0
    else:
        state.slid += abs(v) * h


@compiled
def kick(par, state, mass, v, v_mid, force, h):
    """Velocity after a step, by the force without friction and an estimate of the mean velocity."""
    rest = force - state.viscous * viscous_force(par, v_mid)
    if par.law != at.SET_VALUED:
        return v + h / mass * (rest - dry_force(par, state, v_mid))
    free = v + h / mass * rest
    g = state.dry * (level(par, v_mid) if v != 0.0 else par.Fs)
    if abs(free) <= h / mass * g:
        return 0.0
    return free - h / mass * (g if free > 0.0 else -g)
