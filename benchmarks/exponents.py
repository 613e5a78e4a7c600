"""Lyapunov exponents, here and in other programs."""

from __future__ import annotations

import functools
import math
import os
from functools import partial
from pathlib import Path

import exponents_elsewhere as elsewhere
import numpy as np
import sympy as sp
from exponents_elsewhere import Solver, System, TooSlow, Vector
from report import OURS, Cost, Program, Works, missing, timed

import ballscrew
from ballscrew.orchestration.loop.catalogue import loop
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, Output, State, symbol
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import follow_tangents

ERROR = 1e-3
SETPOINT, STOP = 0.08, 20.0  # m, s
LONGEST = float(os.environ.get("BENCH_SECONDS", "60"))  # s, of one run
OURS_AT = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
CONVERGED = 1e-13


def system_of(whole: Component, interval: float) -> System:
    """A component's equations, with defaults and the set-point instead of symbols."""
    table = {symbol(p.name): sp.Float(p.default, 17) for p in whole.all_parameters}
    table |= {symbol(i.name): sp.Float(SETPOINT, 17) for i in whole.inputs}
    # without the amplifier's limits: the last branch of each case, which other programs can read
    rates = [
        sp.sympify(e).replace(lambda q: isinstance(q, sp.Piecewise), lambda q: q.args[-1].expr)
        for e in whole.derivatives
    ]
    states, rates = whole.all_states, [e.xreplace(table) for e in rates]
    start, nominal = np.array([(s.start, s.nominal) for s in states]).T
    return System([symbol(s.name) for s in states], rates, start, nominal, STOP, interval)


def errors_of(found: Vector, converged: Vector) -> Vector:
    """Errors of exponents: relative, or in bits/s if the exponent is below 1 bit/s."""
    bits = np.array([np.sort(found), np.sort(converged)]) / math.log(2.0)
    with np.errstate(invalid="ignore"):
        errors = np.abs(bits[0] - bits[1]) / np.maximum(np.abs(bits[1]), 1.0)
    return np.nan_to_num(errors, nan=np.inf)


def at_its_best(solver: Solver, converged: Vector, prepared: float) -> Program:
    """A run with the first tolerance, from loose to tight, that is right."""
    said = f"not finished in {LONGEST:.0f} s"
    for tolerance in solver.tolerances:
        try:
            errors = errors_of(solver.run(tolerance), converged)
        except TooSlow:
            break
        if (errors <= ERROR).all():
            note = f"error {errors.max():.1e}; prepared in {prepared:.2f} s"
            return lambda: Cost(timed(partial(solver.run, tolerance))[0], note)
        said = f"not right: {np.sum(errors <= ERROR)} of {len(errors)} exponents at {tolerance:g}"
    return said


def programs(whole: Component, interval: float) -> dict[str, Program]:
    """Every program, at its best, on the equations of a component."""
    system, kernel = system_of(whole, interval), functools.cache(partial(generate, whole))

    def ours(
        tolerance: float, count: int | None = None, frame: Vector | None = None, stop: float = STOP
    ) -> Vector:
        kernel().compile()
        model = Model(kernel(), {}, tolerance)
        for i in kernel().inputs:
            model.set_input(i.name, SETPOINT)
        return follow_tangents(model, [0.0, stop], count=count, frame=frame).exponents

    prepared, _ = timed(lambda: ours(1e-6, stop=1e-3 * STOP))
    made: dict[str, Program] = {}
    for name, count in ((OURS, None), (f"{OURS}, slowest two", 2)):
        solver = Solver(partial(ours, count=count), OURS_AT)
        made[name] = at_its_best(solver, ours(CONVERGED, count), prepared)
    for name, (prepare, package) in elsewhere.PROGRAMS.items():
        made[name] = missing(package)
        try:
            if not made[name]:
                took, solver = timed(partial(prepare, system, LONGEST))
                made[name] = at_its_best(solver, ours(CONVERGED, frame=solver.frame), took)
        except Exception as error:  # a failure of another program is a result, too
            made[name] = f"fails: {type(error).__name__}: {error}"[:90]
    return made


def lorenz() -> Component:
    x, y, z = (symbol(n) for n in "xyz")
    rates = {"x": 10.0 * (y - x), "y": x * (28.0 - z) - y, "z": x * y - sp.Float(8 / 3, 17) * z}
    starts = {"x": 1.0, "y": 1.0, "z": 20.0}
    states = tuple(State(n, "1", n, rate, start=starts[n]) for n, rate in rates.items())
    return Component("lorenz", "Lorenz", states=states, outputs=(Output("out", "1", "x", x),))


def spectra(_: Path) -> Works:
    """All exponents of a motion of 20 s

    Every program gets the same equations and span. The first frame is the states' axes; if a
    program makes its own, ours starts from that one. The tolerance of each is tightened until all
    exponents are within 0.001 of the converged ones (relative; bits/s if they are below 1 bit/s),
    and this run is timed, warm. Preparing is derivation and compilation. SciPy, jitcode and heyoka
    solve the variational system, with our QR after every 2 ms (nctf), 50 ms (iol) and 0.1 s
    (Lorenz). The converged values are this program's at a tolerance of 1e-13.
    """
    loops = {"iol": (loop("iol"), 0.05), "nctf": (loop("nctf"), 2e-3), "Lorenz": (lorenz(), 0.1)}
    return {name: programs(*given) for name, given in loops.items()}


def sampled(_: Path) -> Works:
    """Exponents of a sampled loop

    `ballscrew lyapunov` with its verdict, at two tolerances, beside a plain run of the same loop in
    one solver.
    """
    asked = {"loop": "pid_sampled", "stop": 30.0}
    programs = {
        OURS: lambda: ballscrew.lyapunov(**asked),
        "a plain run": lambda: ballscrew.run(**asked, fmus=False),
    }
    return {"pid_sampled, 30 s at 1 kHz": programs}


TABLES = spectra, sampled
