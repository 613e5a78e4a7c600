"""Simulation of the axis: a compiled loop of small fixed substeps, symmetric and of second order.

A substep is half a step of position, current and deflections at constant velocity (each exact), a
full step of the velocities with the mean forces (solved together with set-valued friction), and the
other halves in reverse order. A faultless double of the axis, with the law and the values without
any effect, is computed along the motor's motion. The log contains the force of the command beyond
that needed by the double; without hidden effects, it is zero to the last digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worlds.amplifier import amplify, late_command
from worlds.compiled import compiled
from worlds.controllers import KIND, MEMORY, OPEN, control
from worlds.friction import (
    STATES,
    advance,
    dry_force,
    factors,
    kick,
    level,
    progress,
    viscous_force,
)
from worlds.layout import (
    BLOCK_MASS,
    COMMAND,
    CURRENT,
    CURRENT_BELIEVED,
    CURRENT_MEAN,
    DELAY,
    DETENT,
    DETENT_PLACE,
    DETENT_WIDTH,
    DRY,
    DURATION,
    FLOORS,
    FRICTION,
    FRICTION_AT_MOTOR,
    FS,
    GAIN,
    GAP,
    INTERPOLATION,
    IS_DRIVE,
    KE,
    KT,
    LAW,
    LEAST_SPEED,
    LOAD,
    LOAD_SLOPE,
    LOGGED,
    MOTOR_MASS,
    NEED,
    NEED_FORCE,
    NEED_VOLTAGE,
    NOISE_GROWTH,
    R_CURRENT,
    R_DRIFT,
    R_FORM,
    R_TIME,
    RAMPED,
    RESOLUTION,
    RESONATOR,
    RESONATOR_DAMPING,
    RESONATOR_SPRING,
    RIPPLE,
    RIPPLE_OF_CURRENT,
    RIPPLE_PERIOD,
    RIPPLE_PHASE,
    RIPPLE_SECOND,
    SCALE_ERROR,
    SCALE_FORM,
    SET_VALUED,
    SIGNAL_PERIOD,
    SPRING,
    SPRING_DAMPING,
    TRAVEL,
    WINDOW,
    A,
    L,
    R,
    V,
    Vector,
    X,
)

# the moving state; NOW is the current
X1, V1, X2, V2, NOW, NOW_BELIEVED, XA, VA, WARMTH = range(9)
# columns of the friction noise, one row per control period
RELATIVE, TEXTURE_PHASE, BURST = range(3)
GUESSES = 3


@dataclass(frozen=True)
class Texture:
    """Friction fixed to the position: two tables, mixed with a phase that changes in time."""

    first: float
    spacing: float
    tables: NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """All inputs of one simulation.

    Attributes
    ----------
    axis, double : Vector
        The axis, and the axis without any effect.
    controller : Vector
    wanted : ndarray, shape (periods,)
        Commands [V], or references [m] with a controller.
    noise : ndarray, shape (periods, 3)
        Relative friction noise, phase of the texture [rad], bursts of force [N].
    texture : Texture
    substeps, periods_logged : int
        Numbers of substeps and of logging periods in a control period.
    period : float
        Control period, s.
    """

    axis: Vector
    double: Vector
    controller: Vector
    wanted: NDArray[np.float64]
    noise: NDArray[np.float64]
    texture: Texture
    substeps: int
    periods_logged: int
    period: float


@dataclass(frozen=True)
class Motion:
    """Result of a run: `log` (rows, LOGGED) and the `commands` of the control periods [V]."""

    log: NDArray[np.float64]
    commands: NDArray[np.float64]


def simulate(run: Run) -> Motion:
    """Run a simulation."""
    texture = run.texture
    log, commands = _simulate(
        run.axis,
        run.double,
        run.controller,
        run.wanted,
        run.noise,
        np.array([texture.first, texture.spacing]),
        texture.tables,
        run.substeps,
        run.periods_logged,
        run.period,
    )
    return Motion(log, commands)


@compiled
def read_encoder(par, x):  # type: ignore[no-untyped-def]
    """Position measured by the controller's encoder."""
    s = x / par[TRAVEL]
    if par[SCALE_ERROR] != 0.0:
        course = s * abs(s) if par[SCALE_FORM] == 0.0 else math.sin(2.0 * math.pi * s)
        x += par[SCALE_ERROR] * course
    if par[INTERPOLATION] != 0.0:
        angle = 2.0 * math.pi * x / par[SIGNAL_PERIOD]
        x += par[INTERPOLATION] * (math.cos(angle) + 0.4 * math.sin(2.0 * angle))
    if par[RESOLUTION] == 0.0:
        return x
    counts = x / par[RESOLUTION]
    whole = math.floor(counts) if par[FLOORS] != 0.0 else math.floor(counts + 0.5)
    return whole * par[RESOLUTION]


@compiled
def texture_at(where, tables, phase, x):  # type: ignore[no-untyped-def]
    """Relative friction at a position."""
    if tables.shape[1] < 2:
        return 0.0
    place = (x - where[0]) / where[1]
    k = min(max(int(place), 0), tables.shape[1] - 2)
    s = min(max(place - k, 0.0), 1.0)
    a = tables[0, k] + s * (tables[0, k + 1] - tables[0, k])
    b = tables[1, k] + s * (tables[1, k + 1] - tables[1, k])
    return a * math.cos(phase) + b * math.sin(phase)


@compiled
def motor_force(par, x, current, voltage):  # type: ignore[no-untyped-def]
    """Force of the motor on its side, with ripple."""
    force = par[GAIN] * voltage if par[IS_DRIVE] != 0.0 else par[KT] * current
    if par[RIPPLE] != 0.0 or par[RIPPLE_OF_CURRENT] != 0.0:
        angle = 2.0 * math.pi * x / par[RIPPLE_PERIOD] + par[RIPPLE_PHASE]
        wave = math.cos(angle) + par[RIPPLE_SECOND] * math.cos(2.0 * angle)
        force += par[RIPPLE_OF_CURRENT] * wave * force - par[RIPPLE] * wave
    return force


@compiled
def outer_force(par, y, burst):  # type: ignore[no-untyped-def]
    """External force on the block, against +x."""
    x = y[X2]
    force = par[LOAD] + par[LOAD_SLOPE] * x + burst
    if par[DETENT] != 0.0:
        s = (x - par[DETENT_PLACE]) / par[DETENT_WIDTH]
        force += par[DETENT] * s * math.exp(0.5 - 0.5 * s * s)
    if par[RESONATOR] != 0.0:
        force += par[RESONATOR_SPRING] * (x - y[XA]) + par[RESONATOR_DAMPING] * (y[V2] - y[VA])
    return force


@compiled
def spring_force(par, way, speed):  # type: ignore[no-untyped-def]
    """Force of the motor's side on the block, through spring and gap; a contact never pulls."""
    half = 0.5 * par[GAP]
    if half > 0.0 and abs(way) <= half:
        return 0.0
    sign = 1.0 if way > 0.0 else -1.0
    force = par[SPRING] * (way - sign * half) + par[SPRING_DAMPING] * speed
    return force if half == 0.0 or force * sign > 0.0 else 0.0


@compiled
def current_after(par, resistance, current, voltage, v, kept):  # type: ignore[no-untyped-def]
    """Armature current after a time at constant voltage and velocity; `kept`: decay factor."""
    end = (voltage - par[KE] * v) / resistance
    return end + (current - end) * kept


@compiled
def resistance_now(par, y, t, period):  # type: ignore[no-untyped-def]
    """Resistance of the winding; updates its temperature."""
    if par[R_DRIFT] == 0.0:
        return par[R]
    if par[R_FORM] == 3.0:
        heat = (y[NOW] / par[R_CURRENT]) ** 2
        y[WARMTH] += period / par[R_TIME] * (heat - y[WARMTH])
        return par[R] * (1.0 + par[R_DRIFT] * y[WARMTH])
    return par[R] * (1.0 + par[R_DRIFT] * progress(par[R_FORM], t, par[R_TIME], par[DURATION]))


@compiled
def move(par, y, rub, at, h):  # type: ignore[no-untyped-def]
    """The velocities of one substep; `at` is motor's force, burst, dry and viscous factors."""
    rigid = par[SPRING] == 0.0
    v1, v2 = y[V1], y[V2]
    m1, m2 = v1, v2
    outer = outer_force(par, y, at[1])
    n1, n2 = v1, v2
    for _ in range(GUESSES):
        if rigid:
            mass = par[MOTOR_MASS] + par[BLOCK_MASS]
            n1, _h = kick(par, rub, mass, v1, m1, at[0] - outer, at[2], at[3], h)
            n2 = n1
        else:
            link = spring_force(par, y[X1] - y[X2], m1 - m2)
            if par[FRICTION_AT_MOTOR] != 0.0:
                n1, _h = kick(par, rub, par[MOTOR_MASS], v1, m1, at[0] - link, at[2], at[3], h)
                n2 = v2 + h / par[BLOCK_MASS] * (link - outer)
            else:
                n1 = v1 + h / par[MOTOR_MASS] * (at[0] - link)
                n2, _h = kick(par, rub, par[BLOCK_MASS], v2, m2, link - outer, at[2], at[3], h)
        m1, m2 = 0.5 * (v1 + n1), 0.5 * (v2 + n2)
    y[V1], y[V2] = n1, n2
    if par[RESONATOR] != 0.0:
        pull = par[RESONATOR_SPRING] * (y[X2] - y[XA]) + par[RESONATOR_DAMPING] * (m2 - y[VA])
        y[VA] += h / par[RESONATOR] * pull


@compiled
def double_friction(double, rub, v_old, v_new, given):  # type: ignore[no-untyped-def]
    """Dry and viscous friction of the faultless double in a substep.

    `given` is the force on friction if the set-valued law held the body.
    """
    v = 0.5 * (v_old + v_new)
    viscous = viscous_force(double, v)
    if double[LAW] == SET_VALUED:
        if v_old * v_new <= 0.0 or abs(v) < double[LEAST_SPEED]:
            most = double[FS] if v == 0.0 else level(double, v)
            return min(max(given - viscous, -most), most), viscous
        return (1.0 if v > 0.0 else -1.0) * level(double, v), viscous
    return dry_force(double, rub, v, 1.0), viscous


@compiled
def half_way(par, y, rub, dry, h):  # type: ignore[no-untyped-def]
    """Positions and deflections over half a substep."""
    y[X1] += h * y[V1]
    y[X2] += h * y[V2]
    y[XA] += h * y[VA]
    if par[FRICTION_AT_MOTOR] != 0.0:
        advance(par, rub, y[X1], y[V1], dry, h)
    else:
        advance(par, rub, y[X2], y[V2], dry, h)


@compiled
def _simulate(  # type: ignore[no-untyped-def]  # noqa: PLR0913, PLR0915
    par, double, controller, wanted, noise, where, tables, substeps, logged, period
):
    periods = wanted.size
    h = period / substeps
    per_log = substeps // logged
    log = np.zeros((periods * logged, LOGGED))
    closed = controller[KIND] != OPEN
    commands = np.zeros(periods) if closed else wanted
    integrals = np.zeros(periods)
    memory, lags, at = np.zeros(MEMORY), np.zeros(2), np.zeros(4)
    y, rub, rub_double = np.zeros(9), np.zeros(STATES), np.zeros(STATES)
    mass = double[MOTOR_MASS] + double[BLOCK_MASS]
    late = par[DELAY] > 0.0 or par[WINDOW] > 0.0
    kept, believed_kept = 0.0, 0.0
    if double[IS_DRIVE] == 0.0:
        believed_kept = math.exp(-0.5 * h * double[R] / double[L])
    for k in range(periods):
        if closed:
            read = read_encoder(par, y[X1])
            commands[k] = control(controller, memory, wanted[k], read, period)
        if k > 0:
            before = commands[k] if par[RAMPED] != 0.0 else commands[k - 1]
            integrals[k] = integrals[k - 1] + 0.5 * period * (commands[k - 1] + before)
        resistance = resistance_now(par, y, k * period, period)
        if par[IS_DRIVE] == 0.0:
            kept = math.exp(-0.5 * h * resistance / par[L])
        known = commands[: k + 1] if closed else commands
        for n in range(substeps):
            row = k * logged + n // per_log
            if n % per_log == 0:
                log[row, X], log[row, CURRENT] = y[X1], y[NOW]
            t = k * period + (n + 0.5) * h
            asked = late_command(double, known, integrals, t, period)
            given = late_command(par, known, integrals, t, period) if late else asked
            voltage = amplify(par, lags, given, y[NOW], t, h)
            place = y[X1] if par[FRICTION_AT_MOTOR] != 0.0 else y[X2]
            v = y[V1] if par[FRICTION_AT_MOTOR] != 0.0 else y[V2]
            at[2], at[3] = factors(par, rub, place, v, t)
            rough = noise[k, RELATIVE] + texture_at(where, tables, noise[k, TEXTURE_PHASE], place)
            at[2] *= max(1.0 + rough * (1.0 + par[NOISE_GROWTH] * abs(v)), 0.05)
            at[1] = noise[k, BURST]
            v_old, i_old = y[V1], y[NOW]
            half_way(par, y, rub, at[2], 0.5 * h)
            advance(double, rub_double, y[X1], v_old, 1.0, 0.5 * h)
            if par[IS_DRIVE] == 0.0:
                y[NOW] = current_after(par, resistance, i_old, voltage, v_old, kept)
                y[NOW_BELIEVED] = current_after(
                    double, double[R], y[NOW_BELIEVED], asked, v_old, believed_kept
                )
            i_mid, believed_mid = y[NOW], y[NOW_BELIEVED]
            at[0] = motor_force(par, y[X1], i_mid, voltage)
            move(par, y, rub, at, h)
            moving = mass * (y[V1] - v_old) / h + double[LOAD]
            given = motor_force(double, y[X1], believed_mid, asked) - moving
            dry, viscous = double_friction(double, rub_double, v_old, y[V1], given)
            if par[IS_DRIVE] == 0.0:
                y[NOW] = current_after(par, resistance, i_mid, voltage, y[V1], kept)
                y[NOW_BELIEVED] = current_after(
                    double, double[R], believed_mid, asked, y[V1], believed_kept
                )
            advance(double, rub_double, y[X1], y[V1], 1.0, 0.5 * h)
            half_way(par, y, rub, at[2], 0.5 * h)
            measured_force = double[KT] * i_mid - moving
            if double[LAW] == SET_VALUED and double[IS_DRIVE] == 0.0:
                dry_measured, _v = double_friction(double, rub_double, v_old, y[V1], measured_force)
            else:
                dry_measured = dry
            v = 0.5 * (v_old + y[V1])
            line = log[row]
            line[COMMAND] += asked
            line[V] += v
            line[A] += (y[V1] - v_old) / h
            line[CURRENT_MEAN] += i_mid
            line[CURRENT_BELIEVED] += believed_mid
            line[DRY] += dry
            line[FRICTION] += dry + viscous
            line[NEED] += given - dry - viscous
            line[NEED_FORCE] += measured_force - dry_measured - viscous
            given = asked - double[R] * i_mid - double[KE] * v
            line[NEED_VOLTAGE] += given - double[L] * (y[NOW] - i_old) / h
        if not math.isfinite(y[X1]) or abs(y[X1]) > 20.0 * par[TRAVEL]:
            log[row + 1 :, X] = np.nan
            break
    log[:, COMMAND:] /= per_log
    return log, commands
