"""Sampled position controllers, compiled: cascade (P on position, PI on velocity) and PID."""

from __future__ import annotations

import math

from worlds.compiled import compiled

# parameters of a controller
KIND, POSITION_GAIN, GAIN_P, GAIN_I, GAIN_D, FILTER, MOST, FEEDFORWARD = range(8)
NUMBERS = 8
OPEN, CASCADE, PID = range(3)
# its states
INTEGRAL, LAST_X, LAST_V, LAST_REFERENCE, STARTED = range(5)
MEMORY = 5


@compiled
def control(numbers, memory, reference, measured, period):  # type: ignore[no-untyped-def]
    """The command of one period from reference and measured position."""
    if memory[STARTED] == 0.0:
        memory[LAST_X], memory[LAST_REFERENCE], memory[STARTED] = measured, reference, 1.0
    share = -math.expm1(-period / numbers[FILTER])
    moved = (measured - memory[LAST_X]) / period
    memory[LAST_V] += share * (moved - memory[LAST_V])
    wanted = (reference - memory[LAST_REFERENCE]) / period
    memory[LAST_X], memory[LAST_REFERENCE] = measured, reference
    error = reference - measured
    if numbers[KIND] == CASCADE:
        slip = numbers[POSITION_GAIN] * error + numbers[FEEDFORWARD] * wanted - memory[LAST_V]
        integrand, now = slip, numbers[GAIN_P] * slip
    else:
        integrand = error
        now = numbers[GAIN_P] * error + numbers[GAIN_D] * (wanted - memory[LAST_V])
    command = now + memory[INTEGRAL] + numbers[GAIN_I] * period * integrand
    limited = min(max(command, -numbers[MOST]), numbers[MOST])
    if command == limited or command * integrand < 0.0:  # anti-windup
        memory[INTEGRAL] += numbers[GAIN_I] * period * integrand
    return limited
