"""Simulation of the axis: a compiled loop of small fixed substeps, symmetric and of second order.

A substep is half a step of position, current and deflections at constant velocity (each exact), a
full step of the velocities with the mean forces (solved together with set-valued friction), and the
other halves in reverse order. A faultless double of the axis, with the law and the values without
any effect, is computed along the motor's motion. The log contains the force of the command beyond
that needed by the double; without hidden effects, it is zero to the last digits.
"""

from __future__ import annotations

import math

import numpy as np

from worlds import axis as at
from worlds.axis import compiled
from worlds.friction import advance, dry_force, kick, level, progress, update_factors, viscous_force

# columns of the friction noise, one row per control period
RELATIVE, TEXTURE_PHASE, BURST = range(3)
SPACING = 10e-6  # of the tables of friction fixed to the position, m
FLAT = np.zeros((2, 1))  # tables without it
GUESSES = 3


def simulate(axis, double, wanted, noise, tables, substeps, logged, period):
    """The log of a run, and the commands of its control periods [V].

    Each control period, of length `period` [s] with so many substeps and logging periods, has one
    command [V], or reference [m] for a controller, in `wanted`, and a row in `noise`: of relative
    friction, of the texture's phase [rad], and bursts of force [N]. Friction fixed to the position
    is mixed by that phase from the two rows of `tables`.
    """
    states = np.zeros(2, at.STATE)  # of the axis and of its double
    log, commands = _simulate(axis, double, states, wanted, noise, tables, substeps, logged, period)
    for name in at.LOG.names[2:]:
        log[name] /= substeps // logged
    return log, commands


@compiled
def control(par, y, reference, measured, period):
    """The command of one period: cascade (P on position, PI on velocity), or PID."""
    if y.started == 0.0:
        y.last_x, y.last_reference, y.started = measured, reference, 1.0
    moved = (measured - y.last_x) / period
    y.last_v += -math.expm1(-period / par.filter) * (moved - y.last_v)
    wanted = (reference - y.last_reference) / period
    y.last_x, y.last_reference = measured, reference
    error = reference - measured
    if par.loop == at.CASCADE:
        integrand = par.position_gain * error + wanted - y.last_v
        now = par.gain_p * integrand
    else:
        integrand = error
        now = par.gain_p * error + par.gain_d * (wanted - y.last_v)
    command = now + y.integral + par.gain_i * period * integrand
    limited = min(max(command, -par.most), par.most)
    if command == limited or command * integrand < 0.0:  # anti-windup
        y.integral += par.gain_i * period * integrand
    return limited


@compiled
def command_at(par, commands, t, period):
    """The command at a time: held, or linear to the next value."""
    if t <= 0.0:
        return commands[0]
    place = t / period
    k = min(int(place), commands.size - 1)
    if par.ramped == 0.0 or k + 1 >= commands.size:
        return commands[k]
    return commands[k] + (place - k) * (commands[k + 1] - commands[k])


@compiled
def integral_at(par, commands, integrals, t, period):
    """The command's integral from zero to a time (before zero, the first value is used)."""
    if t <= 0.0:
        return commands[0] * t
    k = min(int(t / period), commands.size - 1)
    since = t - k * period
    now = command_at(par, commands, t, period)
    return integrals[k] + 0.5 * (commands[k] + now) * since


@compiled
def late_command(par, commands, integrals, t, period):
    """The command after a pure delay and a moving mean."""
    t -= par.delay
    if par.window == 0.0:
        return command_at(par, commands, t, period)
    whole = integral_at(par, commands, integrals, t, period)
    return (whole - integral_at(par, commands, integrals, t - par.window, period)) / par.window


@compiled
def amplify(par, y, command, t, h):
    u = command
    if par.lag > 0.0:
        share = -math.expm1(-h / par.lag)
        y.lag += share * (u - y.lag)
        u = y.lag
        if par.lag_twice != 0.0:
            y.second_lag += share * (u - y.second_lag)
            u = y.second_lag
    if par.limit > 0.0:
        if par.limit_form == 1.0:
            u = par.limit * math.tanh(u / par.limit)
        else:
            most = par.limit
            if par.limit_form == 2.0:
                most = max(most - par.sag * abs(y.current), 0.2 * most)
            u = min(max(u, -most), most)
    if par.mains != 0.0:
        u += par.mains * math.cos(2.0 * math.pi * par.mains_frequency * t)
    return u


@compiled
def read_encoder(par, x):
    s = x / par.travel
    if par.scale_error != 0.0:
        course = s * abs(s) if par.scale_form == 0.0 else math.sin(2.0 * math.pi * s)
        x += par.scale_error * course
    if par.interpolation != 0.0:
        angle = 2.0 * math.pi * x / par.signal_period
        x += par.interpolation * (math.cos(angle) + 0.4 * math.sin(2.0 * angle))
    if par.resolution == 0.0:
        return x
    counts = x / par.resolution
    whole = math.floor(counts) if par.floors != 0.0 else math.floor(counts + 0.5)
    return whole * par.resolution


@compiled
def read_all(par, x):
    """Positions measured by the encoder, shape (samples,)."""
    read = np.empty_like(x)
    for k in range(x.size):
        read[k] = read_encoder(par, x[k])
    return read


@compiled
def texture_at(par, tables, phase, x):
    """Relative friction at a position."""
    if tables.shape[1] < 2:
        return 0.0
    place = (x - par.texture_start) / SPACING
    k = min(max(int(place), 0), tables.shape[1] - 2)
    s = min(max(place - k, 0.0), 1.0)
    a = tables[0, k] + s * (tables[0, k + 1] - tables[0, k])
    b = tables[1, k] + s * (tables[1, k + 1] - tables[1, k])
    return a * math.cos(phase) + b * math.sin(phase)


@compiled
def motor_force(par, x, y):
    """Force of the motor on its side, with ripple."""
    force = par.gain * y.voltage if par.is_drive != 0.0 else par.kt * y.current
    if par.ripple != 0.0 or par.ripple_of_current != 0.0:
        angle = 2.0 * math.pi * x / par.ripple_period + par.ripple_phase
        wave = math.cos(angle) + par.ripple_second * math.cos(2.0 * angle)
        force += par.ripple_of_current * wave * force - par.ripple * wave
    return force


@compiled
def outer_force(par, y):
    """External force on the block, against +x."""
    force = par.load + par.load_slope * y.x2 + y.burst
    if par.detent != 0.0:
        s = (y.x2 - par.detent_place) / par.detent_width
        force += par.detent * s * math.exp(0.5 - 0.5 * s * s)
    if par.resonator != 0.0:
        force += par.resonator_spring * (y.x2 - y.xa) + par.resonator_damping * (y.v2 - y.va)
    return force


@compiled
def spring_force(par, way, speed):
    """Force of the motor's side on the block, through spring and gap; a contact never pulls."""
    half = 0.5 * par.gap
    if half > 0.0 and abs(way) <= half:
        return 0.0
    sign = 1.0 if way > 0.0 else -1.0
    force = par.spring * (way - sign * half) + par.spring_damping * speed
    return force if half == 0.0 or force * sign > 0.0 else 0.0


@compiled
def update_current(par, y, v):
    """Armature current after half a substep at constant voltage and velocity."""
    if par.is_drive == 0.0:
        end = (y.voltage - par.ke * v) / y.resistance
        y.current = end + (y.current - end) * y.kept


@compiled
def resistance_now(par, y, t, period):
    """Resistance of the winding; updates its temperature."""
    if par.r_drift == 0.0:
        return par.R
    if par.r_form == 3.0:
        heat = (y.current / par.r_current) ** 2
        y.warmth += period / par.r_time * (heat - y.warmth)
        return par.R * (1.0 + par.r_drift * y.warmth)
    return par.R * (1.0 + par.r_drift * progress(par.r_form, t, par.r_time, par.duration))


@compiled
def move(par, y, h):
    v1, v2 = y.v1, y.v2
    m1, m2 = v1, v2
    n1, n2 = v1, v2
    outer = outer_force(par, y)
    for _ in range(GUESSES):
        if par.spring == 0.0:
            mass = par.motor_mass + par.block_mass
            n1 = n2 = kick(par, y, mass, v1, m1, y.motor - outer, h)
        else:
            link = spring_force(par, y.x1 - y.x2, m1 - m2)
            if par.friction_at_motor != 0.0:
                n1 = kick(par, y, par.motor_mass, v1, m1, y.motor - link, h)
                n2 = v2 + h / par.block_mass * (link - outer)
            else:
                n1 = v1 + h / par.motor_mass * (y.motor - link)
                n2 = kick(par, y, par.block_mass, v2, m2, link - outer, h)
        m1, m2 = 0.5 * (v1 + n1), 0.5 * (v2 + n2)
    y.v1, y.v2 = n1, n2
    if par.resonator != 0.0:
        pull = par.resonator_spring * (y.x2 - y.xa) + par.resonator_damping * (m2 - y.va)
        y.va += h / par.resonator * pull


@compiled
def double_friction(double, d, v_old, v_new, given):
    """Dry and viscous friction of the double; `given` is the force on it if the law holds."""
    v = 0.5 * (v_old + v_new)
    viscous = viscous_force(double, v)
    if double.law == at.SET_VALUED:
        if v_old * v_new <= 0.0 or abs(v) < double.least_speed:
            most = double.Fs if v == 0.0 else level(double, v)
            return min(max(given - viscous, -most), most), viscous
        return (1.0 if v > 0.0 else -1.0) * level(double, v), viscous
    return dry_force(double, d, v), viscous


@compiled
def half_way(par, y, h):
    """Positions and deflections over half a substep."""
    y.x1 += h * y.v1
    y.x2 += h * y.v2
    y.xa += h * y.va
    if par.friction_at_motor != 0.0:
        advance(par, y, y.x1, y.v1, h)
    else:
        advance(par, y, y.x2, y.v2, h)


@compiled
def _simulate(  # noqa: PLR0913, PLR0915
    par, double, states, wanted, noise, tables, substeps, logged, period
):
    periods = wanted.size
    h = period / substeps
    per_log = substeps // logged
    log = np.zeros(periods * logged, at.LOG)
    closed = par.loop != at.OPEN
    commands = np.zeros(periods) if closed else wanted
    integrals = np.zeros(periods)
    y, d = states[0], states[1]
    d.dry = 1.0
    mass = double.motor_mass + double.block_mass
    late = par.delay > 0.0 or par.window > 0.0
    if double.is_drive == 0.0:
        d.resistance, d.kept = double.R, math.exp(-0.5 * h * double.R / double.L)
    for k in range(periods):
        if closed:
            commands[k] = control(par, y, wanted[k], read_encoder(par, y.x1), period)
        if k > 0:
            before = commands[k] if par.ramped != 0.0 else commands[k - 1]
            integrals[k] = integrals[k - 1] + 0.5 * period * (commands[k - 1] + before)
        if par.is_drive == 0.0:
            y.resistance = resistance_now(par, y, k * period, period)
            y.kept = math.exp(-0.5 * h * y.resistance / par.L)
        known = commands[: k + 1] if closed else commands
        y.burst = noise[k, BURST]
        for n in range(substeps):
            line = log[k * logged + n // per_log]
            if n % per_log == 0:
                line.x, line.current = y.x1, y.current
            t = k * period + (n + 0.5) * h
            d.voltage = asked = late_command(double, known, integrals, t, period)
            given = late_command(par, known, integrals, t, period) if late else asked
            y.voltage = amplify(par, y, given, t, h)
            place = y.x1 if par.friction_at_motor != 0.0 else y.x2
            v = y.v1 if par.friction_at_motor != 0.0 else y.v2
            update_factors(par, y, place, v, t)
            rough = noise[k, RELATIVE] + texture_at(par, tables, noise[k, TEXTURE_PHASE], place)
            y.dry *= max(1.0 + rough * (1.0 + par.noise_growth * abs(v)), 0.05)
            v_old, i_old = y.v1, y.current
            half_way(par, y, 0.5 * h)
            advance(double, d, y.x1, v_old, 0.5 * h)
            update_current(par, y, v_old)
            update_current(double, d, v_old)
            i_mid = y.current
            y.motor = motor_force(par, y.x1, y)
            move(par, y, h)
            moving = mass * (y.v1 - v_old) / h + double.load
            given = motor_force(double, y.x1, d) - moving
            dry, viscous = double_friction(double, d, v_old, y.v1, given)
            update_current(par, y, y.v1)
            update_current(double, d, y.v1)
            advance(double, d, y.x1, y.v1, 0.5 * h)
            half_way(par, y, 0.5 * h)
            measured_force, dry_measured = double.kt * i_mid - moving, dry
            if double.law == at.SET_VALUED and double.is_drive == 0.0:
                dry_measured, _ = double_friction(double, d, v_old, y.v1, measured_force)
            v = 0.5 * (v_old + y.v1)
            line.command += asked
            line.v += v
            line.a += (y.v1 - v_old) / h
            line.current_mean += i_mid
            line.dry += dry
            line.friction += dry + viscous
            line.need += given - dry - viscous
            line.need_force += measured_force - dry_measured - viscous
            drop = double.R * i_mid
            line.need_voltage += asked - drop - double.ke * v - double.L * (y.current - i_old) / h
        if not math.isfinite(y.x1) or abs(y.x1) > 20.0 * par.travel:
            log["x"][(k + 1) * logged :] = np.nan
            break
    return log, commands
