"""Amplifier between command and motor, compiled: delay, averaging, limits, and mains ripple."""

from __future__ import annotations

import math

from worlds.compiled import compiled
from worlds.layout import (
    DELAY,
    LAG,
    LAG_TWICE,
    LIMIT,
    LIMIT_FORM,
    MAINS,
    MAINS_FREQUENCY,
    RAMPED,
    SAG,
    WINDOW,
)


@compiled
def command_at(par, commands, t, period):  # type: ignore[no-untyped-def]
    """The command at a time: held, or linear to the next value."""
    if t <= 0.0:
        return commands[0]
    place = t / period
    k = min(int(place), commands.size - 1)
    if par[RAMPED] == 0.0 or k + 1 >= commands.size:
        return commands[k]
    return commands[k] + (place - k) * (commands[k + 1] - commands[k])


@compiled
def integral_at(par, commands, integrals, t, period):  # type: ignore[no-untyped-def]
    """The command's integral from zero to a time (before zero, the first value is used)."""
    if t <= 0.0:
        return commands[0] * t
    k = min(int(t / period), commands.size - 1)
    since = t - k * period
    now = command_at(par, commands, t, period)
    return integrals[k] + 0.5 * (commands[k] + now) * since


@compiled
def late_command(par, commands, integrals, t, period):  # type: ignore[no-untyped-def]
    """The command after a pure delay and a moving mean."""
    t -= par[DELAY]
    if par[WINDOW] == 0.0:
        return command_at(par, commands, t, period)
    whole = integral_at(par, commands, integrals, t, period)
    return (whole - integral_at(par, commands, integrals, t - par[WINDOW], period)) / par[WINDOW]


@compiled
def amplify(par, lags, command, current, t, h):  # type: ignore[no-untyped-def]
    """The voltage at the motor; `lags` are the states of the lag."""
    u = command
    if par[LAG] > 0.0:
        share = -math.expm1(-h / par[LAG])
        lags[0] += share * (u - lags[0])
        u = lags[0]
        if par[LAG_TWICE] != 0.0:
            lags[1] += share * (u - lags[1])
            u = lags[1]
    if par[LIMIT] > 0.0:
        if par[LIMIT_FORM] == 1.0:
            u = par[LIMIT] * math.tanh(u / par[LIMIT])
        else:
            most = par[LIMIT]
            if par[LIMIT_FORM] == 2.0:
                most = max(most - par[SAG] * abs(current), 0.2 * most)
            u = min(max(u, -most), most)
    if par[MAINS] != 0.0:
        u += par[MAINS] * math.cos(2.0 * math.pi * par[MAINS_FREQUENCY] * t)
    return u
