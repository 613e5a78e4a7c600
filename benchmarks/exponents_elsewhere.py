"""Other programs for Lyapunov exponents, on the same system with the same first frame.

Each function takes a `System` and the longest time of a run [s], prepares the program, and returns
a `Solver`.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import logging
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
import sympy as sp

Vector = npt.NDArray[np.float64]
PYNAMICALSYS_SEED = 13


class TooSlow(RuntimeError):
    """A run has taken longer than allowed."""


@dataclass(frozen=True)
class System:
    """Autonomous equations with numbers for parameters."""

    symbols: list[sp.Symbol]
    rates: list[sp.Expr]
    start: Vector
    nominal: Vector
    stop: float
    interval: float  # between orthonormalizations, for programs that need it [s]

    @property
    def jacobian(self) -> sp.Matrix:
        return sp.Matrix(self.rates).jacobian(self.symbols)

    def with_tangents(self) -> tuple[list[sp.Symbol], list[sp.Expr]]:
        """The equations of the motion and of all tangents, row by row of their matrix."""
        n = len(self.symbols)
        q = sp.Matrix(n, n, sp.symbols(f"q0:{n * n}", real=True))
        return [*self.symbols, *q], [*self.rates, *(self.jacobian * q)]


@dataclass(frozen=True)
class Solver:
    """A prepared program; `run` takes one of its `tolerances`, and gives exponents [nats/s]."""

    run: Callable[[float], Vector]
    tolerances: tuple[float, ...]  # or steps, from loose to tight
    frame: Vector | None = None  # the first frame by rows, if it cannot be the states' axes


def orthonormalized(
    advance: Callable[[Vector, float, float], Vector], system: System, longest: float
) -> Vector:
    """Exponents by QR of all tangents after each interval, with any solver."""
    n = len(system.symbols)
    state = np.concatenate([system.start, np.eye(n).ravel()])
    logs = np.zeros(n)
    begin = perf_counter()
    edges = np.linspace(0.0, system.stop, round(system.stop / system.interval) + 1)
    for a, b in itertools.pairwise(edges):
        state = advance(state, float(a), float(b))
        q, r = np.linalg.qr(state[n:].reshape(n, n))
        with np.errstate(divide="ignore"):
            logs += np.log(np.abs(np.diag(r)))
        state[n:] = q.ravel()
        if perf_counter() - begin > longest:
            raise TooSlow
    return logs / system.stop


def scipy_lsoda(system: System, longest: float) -> Solver:
    from scipy.integrate import solve_ivp

    rates = sp.lambdify([system.symbols], system.rates, "math", cse=True)
    matrix = sp.lambdify([system.symbols], system.jacobian.tolist(), "math", cse=True)
    n = len(system.symbols)

    def rhs(_: float, w: Vector) -> Vector:
        x = w[:n].tolist()
        return np.concatenate([rates(x), (np.array(matrix(x)) @ w[n:].reshape(n, n)).ravel()])

    def run(tolerance: float) -> Vector:
        atol = tolerance * np.concatenate([system.nominal, np.full(n * n, 1e-3)])

        def advance(state: Vector, a: float, b: float) -> Vector:
            done = solve_ivp(rhs, (a, b), state, "LSODA", rtol=tolerance, atol=atol)
            return np.asarray(done.y[:, -1])

        return orthonormalized(advance, system, longest)

    return Solver(run, (1e-6, 1e-8, 1e-10))


def jitcode(system: System, longest: float) -> Solver:
    import jitcode as package
    import symengine

    symbols, rates = system.with_tangents()
    table = {s: sp.Symbol(f"Y{k}") for k, s in enumerate(symbols)}
    swap = {symengine.Symbol(f"Y{k}"): package.y(k) for k in range(len(symbols))}
    plain = [symengine.sympify(sp.N(e, 17).xreplace(table)).subs(swap) for e in rates]
    ode = package.jitcode(plain, verbose=False, wants_jacobian=True)
    level = logging.getLogger().level
    # its setuptools would read a pyproject.toml in the present folder, and changes the log level
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        # the tangents' Jacobian would take minutes to simplify
        ode.generate_jac_sym(simplify=False)
        ode.generate_f_C(simplify=False, do_cse=True)
        ode.generate_jac_C(do_cse=True)
        ode.generate_functions()
    logging.getLogger().setLevel(level)

    def run(tolerance: float) -> Vector:
        atol = tolerance * 1e-3 * min(float(system.nominal.min()), 1.0)
        ode.set_integrator("LSODA", rtol=tolerance, atol=atol)

        def advance(state: Vector, a: float, b: float) -> Vector:
            ode.set_initial_value(state, a)
            return np.array(ode.integrate(b))

        return orthonormalized(advance, system, longest)

    return Solver(run, (1e-6, 1e-8, 1e-10))


def heyoka(system: System, longest: float) -> Solver:
    import heyoka as hy

    symbols, rates = system.with_tangents()
    names = hy.make_vars(*[s.name for s in symbols])
    pairs = [(v, hy.from_sympy(sp.N(e, 17))) for v, e in zip(names, rates, strict=True)]
    start = np.concatenate([system.start, np.eye(len(system.symbols)).ravel()])

    @functools.cache
    def integrator(tolerance: float) -> Any:
        return hy.taylor_adaptive(pairs, start, tol=tolerance, compact_mode=True)

    def run(tolerance: float) -> Vector:
        ta = integrator(tolerance)

        def advance(state: Vector, a: float, b: float) -> Vector:
            ta.time = a
            ta.state[:] = state
            ta.propagate_until(b)
            return np.array(ta.state)

        return orthonormalized(advance, system, longest)

    integrator(1e-9)
    return Solver(run, (1e-9, 1e-15))


def pynamicalsys(system: System, longest: float) -> Solver:
    from numba import njit
    from pynamicalsys import ContinuousDynamicalSystem

    n = len(system.symbols)
    states = dict(zip(system.symbols, sp.symbols(f"x0:{n}", real=True), strict=True))

    def compiled(entries: list[sp.Expr], shape: tuple[int, ...]) -> Any:
        """A function of time, state and parameters that numba compiles."""
        plain = [sp.N(e.xreplace(states), 17) for e in entries]
        shared, reduced = sp.cse(plain, symbols=sp.numbered_symbols("c"))
        lines = ["def function(time, u, parameters):", f"    out = np.empty({len(entries)})"]
        lines += [f"    x{k} = u[{k}]" for k in range(n)]
        lines += [f"    {s} = {sp.pycode(e)}" for s, e in shared]
        lines += [f"    out[{k}] = {sp.pycode(e)}" for k, e in enumerate(reduced)]
        space: dict[str, Any] = {"np": np, "math": math}
        exec("\n".join([*lines, f"    return out.reshape({shape})"]), space)
        return njit(space["function"])

    made = ContinuousDynamicalSystem(
        equations_of_motion=compiled(system.rates, (n,)),
        jacobian=compiled(list(system.jacobian), (n, n)),
        system_dimension=n,
        number_of_parameters=0,
    )
    # its first frame, which it draws itself
    draws = np.random.RandomState(PYNAMICALSYS_SEED).rand(n * n).reshape(n, n)
    frame, _ = np.linalg.qr(-1.0 + 2.0 * draws)

    def follow(stop: float) -> Vector:
        return np.asarray(made.lyapunov(system.start, stop, parameters=[], num_exponents=n))

    made.integrator("rk45", atol=1e-6, rtol=1e-6)
    follow(1e-4)

    def run(tolerance: float) -> Vector:
        atol = tolerance * 1e-3 * float(system.nominal.min())
        made.integrator("rk45", atol=atol, rtol=tolerance)
        # it cannot be stopped: a share of the time first tells the total time
        begin, share = perf_counter(), 1e-3
        follow(share * system.stop)
        if (perf_counter() - begin) / share > longest:
            raise TooSlow
        return follow(system.stop)

    return Solver(run, (1e-6, 1e-8, 1e-10), frame.T)


PROGRAMS = {
    "SciPy, LSODA": (scipy_lsoda, "scipy"),
    "jitcode, LSODA": (jitcode, "jitcode"),
    "heyoka": (heyoka, "heyoka"),
    "pynamicalsys, rk45": (pynamicalsys, "pynamicalsys"),
}
