"""Friction laws, compiled: each is solved exactly for a constant velocity over a substep.

Set-valued Coulomb friction has no state: it is solved together with the velocity (`kick`). The
others have deflections. At constant velocity these are exponential (LuGre, with or without the
smooth sign; Dahl's law is LuGre without damping and peak), piecewise exponential (elasto-plastic),
or linear with a limit (Maxwell's elements). All changes of the dry friction change its level.
"""

from __future__ import annotations

import math

import numpy as np

from worlds.compiled import compiled
from worlds.layout import (
    AGEING,
    AGEING_WAY,
    ASYMMETRY,
    ASYMMETRY_VISCOUS,
    CUBIC,
    DRIFT,
    DRIFT_FORM,
    DRIFT_TIME,
    DRIFT_VISCOUS,
    DURATION,
    ELASTO_PLASTIC,
    EXPONENTIAL,
    FALL,
    FC,
    FS,
    GAUSSIAN,
    KV,
    LAW,
    LORENTZ,
    LUGRE,
    MAXWELL,
    MEMORY,
    MEMORY_WAY,
    MODIFIED_LUGRE,
    PERIOD,
    PERIOD_PHASE,
    PERIOD_SECOND,
    PERIODIC,
    PERIODIC_VISCOUS,
    QUADRATIC,
    RIPPLE_FRICTION,
    RIPPLE_PERIOD,
    RIPPLE_PHASE,
    ROOT,
    SET_VALUED,
    SIGMA0,
    SIGMA1,
    SIGMA2,
    THINNING,
    TRAVEL,
    TREND,
    TREND_FORM,
    TREND_VISCOUS,
    VS,
)

ELEMENTS = 4  # number of Maxwell's elements
SHARES = np.array([0.4, 0.3, 0.2, 0.1])  # shares of the level
STIFFNESSES = np.array([0.1, 0.2, 0.3, 0.4])  # shares of sigma0
BREAKAWAY = 0.7  # elasto-plastic: elastic below this share of the level
# state: deflections, direction, farthest position in it, last reversal, rest, distance since then
DIRECTION, EXTREME, REVERSED_AT, RESTED, SLID = range(ELEMENTS, ELEMENTS + 5)
STATES = ELEMENTS + 5
REVERSAL = 2e-6  # motion back that counts as a reversal, m
AT_REST = 1e-6  # m/s


@compiled
def fall(form: float, speed: float, scale: float) -> float:
    """Remaining share of the break-away peak at a speed, 1 at rest."""
    r = speed / scale
    if form == GAUSSIAN:
        return math.exp(-r * r) if r < 7.0 else 0.0
    if form == EXPONENTIAL:
        return math.exp(-r) if r < 40.0 else 0.0
    if form == LORENTZ:
        return 1.0 / (1.0 + r * r)
    return (1.0 - r / 2.0) ** 2 if r < 2.0 else 0.0


@compiled
def level(par, v):  # type: ignore[no-untyped-def]
    """Dry friction while sliding."""
    if par[FS] == par[FC]:
        return par[FC]
    return par[FC] + (par[FS] - par[FC]) * fall(par[FALL], abs(v), par[VS])


@compiled
def progress(form: float, t: float, time: float, duration: float) -> float:
    """A drift's course: linear over the record, exponential, or a step."""
    if form == 0:
        return t / duration
    if form == 1:
        return 1.0 - math.exp(-t / time)
    return 1.0 if t > time else 0.0


@compiled
def along_travel(form: float, x: float, half: float) -> float:
    """A trend's course along the travel: linear, quadratic, or one end worn."""
    s = x / half
    if form == 0:
        return s
    if form == 1:
        return s * s
    return 1.0 / (1.0 + math.exp(-8.0 * (s - 0.5)))


@compiled
def factors(par, state, x, v, t):  # type: ignore[no-untyped-def]
    """Present factors on the dry level and on the viscous force."""
    dry, viscous = 1.0, 1.0
    sign = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else state[DIRECTION])
    dry += par[ASYMMETRY] * sign
    viscous += par[ASYMMETRY_VISCOUS] * sign
    if par[PERIODIC] != 0.0:
        angle = 2.0 * math.pi * x / par[PERIOD] + par[PERIOD_PHASE]
        wave = math.cos(angle) + par[PERIOD_SECOND] * math.cos(2.0 * angle)
        dry += par[PERIODIC] * wave
        viscous += par[PERIODIC_VISCOUS] * wave
    if par[RIPPLE_FRICTION] != 0.0:
        angle = 2.0 * math.pi * x / par[RIPPLE_PERIOD] + par[RIPPLE_PHASE]
        dry += par[RIPPLE_FRICTION] * math.cos(angle)
    if par[TREND] != 0.0 or par[TREND_VISCOUS] != 0.0:
        place = along_travel(par[TREND_FORM], x, par[TRAVEL])
        dry += par[TREND] * place
        viscous += par[TREND_VISCOUS] * place
    if par[DRIFT] != 0.0 or par[DRIFT_VISCOUS] != 0.0:
        course = progress(par[DRIFT_FORM], t, par[DRIFT_TIME], par[DURATION])
        dry += par[DRIFT] * course
        viscous += par[DRIFT_VISCOUS] * course
    if par[MEMORY] != 0.0:
        dry += par[MEMORY] * math.exp(-abs(x - state[REVERSED_AT]) / par[MEMORY_WAY])
    if par[AGEING] != 0.0:
        dry += (
            par[AGEING] * math.log1p(state[RESTED] / 0.1) * math.exp(-state[SLID] / par[AGEING_WAY])
        )
    return max(dry, 0.05), max(viscous, 0.05)


@compiled
def viscous_force(par, v):  # type: ignore[no-untyped-def]
    """The part that grows with the speed."""
    speed = abs(v)
    force = par[SIGMA2] * v / (1.0 + par[THINNING] * speed)
    force += (par[QUADRATIC] * speed + par[CUBIC] * speed * speed) * v
    if par[ROOT] != 0.0 and speed > 0.0:
        force += par[ROOT] * v / math.sqrt(speed)
    return force


@compiled
def smooth_sign(par, v):  # type: ignore[no-untyped-def]
    """The sign of the modified LuGre law; a plain sign for the others."""
    if par[LAW] == MODIFIED_LUGRE:
        steep = par[KV] * v
        if abs(steep) > 1e4:  # series of the arc tangent, to the last digit
            return (1.0 if v > 0.0 else -1.0) - 2.0 / math.pi / steep
        return 2.0 / math.pi * math.atan(steep)
    return 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)


@compiled
def plastic_share(z: float, v: float, full: float) -> float:
    """The elasto-plastic law's share of sliding in a deflection."""
    if z * v <= 0.0 or abs(z) < BREAKAWAY * full:
        return 0.0
    if abs(z) >= full:
        return 1.0
    middle = 0.5 * (1.0 + BREAKAWAY) * full
    return 0.5 * (1.0 + math.sin(math.pi * (abs(z) - middle) / (full * (1.0 - BREAKAWAY))))


@compiled
def rate(par, z, v, dry):  # type: ignore[no-untyped-def]
    """Growth of a bristle's deflection."""
    g = dry * level(par, v)
    if par[LAW] == ELASTO_PLASTIC:
        full = g / par[SIGMA0]
        return v * (1.0 - plastic_share(z, v, full) * abs(z) / full)
    s = smooth_sign(par, v)
    if par[LAW] == MODIFIED_LUGRE:
        return s * s * v - par[SIGMA0] * s * v * z / g
    return v - par[SIGMA0] * s * v * z / g


@compiled
def dry_force(par, state, v, dry):  # type: ignore[no-untyped-def]
    """Force of the deflections (not of the set-valued law)."""
    if par[LAW] == MAXWELL:
        force = 0.0
        for k in range(ELEMENTS):
            force += STIFFNESSES[k] * par[SIGMA0] * state[k]
        return force
    return par[SIGMA0] * state[0] + par[SIGMA1] * rate(par, state[0], v, dry)


@compiled
def decay(a):  # type: ignore[no-untyped-def]
    """exp(-a), by an equally exact fraction for small a."""
    if a < 0.02:
        even, odd = 1.0 + a * a / 12.0, 0.5 * a
        return (even - odd) / (even + odd)
    return math.exp(-a)


@compiled
def advance(par, state, x, v, dry, h):  # type: ignore[no-untyped-def]
    """Deflections, direction, rest and distance after a time at constant velocity."""
    law = par[LAW]
    if law == MAXWELL:
        g = dry * level(par, v)
        for k in range(ELEMENTS):
            most = SHARES[k] * g / (STIFFNESSES[k] * par[SIGMA0])
            state[k] = min(max(state[k] + v * h, -most), most)
    elif law == ELASTO_PLASTIC and v != 0.0:
        full = dry * level(par, v) / par[SIGMA0]
        a = plastic_share(state[0], v, full) * abs(v) / full * h
        grown = 1.0 if a < 1e-9 else -math.expm1(-a) / a
        state[0] = state[0] * decay(a) + v * h * grown
    elif (law in (LUGRE, MODIFIED_LUGRE)) and v != 0.0:
        s = smooth_sign(par, v)
        g = dry * level(par, v)
        end = (s if law == MODIFIED_LUGRE else (1.0 if v > 0.0 else -1.0)) * g / par[SIGMA0]
        state[0] = end + (state[0] - end) * decay(par[SIGMA0] * s * v / g * h)
    if state[DIRECTION] == 0.0:
        if v != 0.0:
            state[DIRECTION] = 1.0 if v > 0.0 else -1.0
            state[EXTREME], state[REVERSED_AT] = x, x - 1.0  # far back
    elif (x - state[EXTREME]) * state[DIRECTION] > 0.0:
        state[EXTREME] = x
    elif (state[EXTREME] - x) * state[DIRECTION] > REVERSAL:
        state[DIRECTION] = -state[DIRECTION]
        state[REVERSED_AT], state[EXTREME] = state[EXTREME], x
    if abs(v) < AT_REST:
        if state[SLID] > 5.0 * par[AGEING_WAY]:
            state[RESTED] = 0.0
        state[RESTED] += h
        state[SLID] = 0.0
    else:
        state[SLID] += abs(v) * h


@compiled
def kick(par, state, mass, v, v_mid, force, dry, viscous, h):  # type: ignore[no-untyped-def]  # noqa: PLR0913
    """Velocity after a step, and the dry force.

    `force` is the total force without friction; `v_mid` is the last estimate of the step's mean
    velocity.
    """
    rest = force - viscous * viscous_force(par, v_mid)
    if par[LAW] != SET_VALUED:
        held = dry_force(par, state, v_mid, dry)
        return v + h / mass * (rest - held), held
    free = v + h / mass * rest
    g = dry * (level(par, v_mid) if v != 0.0 else par[FS])
    most = h / mass * g
    if abs(free) <= most:
        return 0.0, free * mass / h
    held = g if free > 0.0 else -g
    return free - h / mass * held, held
