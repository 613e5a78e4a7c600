"""Hunting of a mass with dry friction under PID, against an event-driven simulation of its own."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from ballscrew.plant.classical import classical, with_sticking
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    Component,
    ForceBalance,
    ForceTerm,
    Output,
    State,
    symbol,
)
from ballscrew.solver.kernel import Model
from ballscrew.stability.attractor import Kind
from ballscrew.stability.classify import classify_attractor

KP, KI, KD = 20.0, 40.0, 6.0
FC, VS, SIGMA2 = 1.0, 0.05, 0.4
START = 1.0  # m


def loop(kp: float = KP, ki: float = KI, kd: float = KD) -> Component:
    """A mass of 1 kg at x, its set-point at 0, with its controller inside."""
    x, v, w = symbol("x"), symbol("v"), symbol("w")
    drive = ForceTerm("drive", -kp * x - kd * v - ki * w, "drive")
    return with_sticking(
        Component(
            name="body",
            description="A mass with dry friction under PID.",
            states=(
                State("x", "m", "position", v, START, 0.01),
                State("v", "m/s", "velocity", None, 0.0, 0.01),
                State("w", "m*s", "integral", x, 0.0, 0.01),
            ),
            balances=(ForceBalance("v", sp.Integer(1), (drive, classical(v))),),
            outputs=(Output("y", "m", "position", x),),
        )
    )


def simulated(static: float, stop: float) -> list[tuple[float, float]]:
    """Sticking and sliding in turn: time and position where each sticking begins."""
    t, x, w = 0.0, START, 0.0
    seen = []
    while t < stop:
        if abs(KP * x + KI * w) <= static:  # the integral grows until it breaks away
            seen.append((t, x))
            wait = (static * -np.sign(x) + KP * x + KI * w) / (-KI * x)
            t, w = t + wait, w + wait * x
        direction = -np.sign(KP * x + KI * w)

        def rates(_t: float, q: np.ndarray, direction=direction) -> list[float]:
            fall = direction * (FC + (static - FC) * np.exp(-((q[1] / VS) ** 2)))
            return [q[1], -KP * q[0] - KD * q[1] - KI * q[2] - fall - SIGMA2 * q[1], q[0]]

        def stops(_t: float, q: np.ndarray, direction=direction) -> float:
            return q[1] * direction

        stops.terminal, stops.direction = True, -1.0
        options = {"max_step": 0.1, "rtol": 1e-11, "atol": 1e-13, "events": stops}
        begin = [x, 1e-12 * direction, w]
        run = solve_ivp(rates, (t, t + 100.0), begin, "DOP853", **options)
        t, x, w = float(run.t[-1]), run.y[0, -1], run.y[2, -1]
    return seen


def test_period_and_amplitude_of_hunting_are_those_of_an_event_driven_solver() -> None:
    values = {"Fc": FC, "Fs": 2.0, "Vs": VS, "sigma2": SIGMA2}
    found = classify_attractor(Model(generate(loop()), values, 1e-9), 0.0, 40.0, exponents=False)
    assert found.kind is Kind.CYCLE, found.evidence
    turns = np.array(simulated(2.0, 120.0))[-8:]
    period = float(np.mean(turns[2:, 0] - turns[:-2, 0]))
    assert found.period == pytest.approx(period, rel=1e-6)
    assert found.amplitude["x"] == pytest.approx(float(np.mean(np.abs(turns[:, 1]))), rel=1e-6)
