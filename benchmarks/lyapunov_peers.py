"""Other programs for Lyapunov exponents, on the same system with the same first frame.

Each function returns a `Solver`: the time of preparation, and a function of the tolerance that runs
the program.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import sympy as sp

Vector = npt.NDArray[np.float64]
PYNAMICALSYS_SEED = 13


class TooSlow(RuntimeError):
    """A run has taken longer than allowed."""


class NotInstalled(RuntimeError):
    """The program is not installed."""


@dataclass(frozen=True)
class System:
    """Autonomous equations with numbers for parameters.

    Attributes
    ----------
    interval : float
        Time between orthonormalizations, for programs that need it [s].
    """

    name: str
    symbols: list[sp.Symbol]
    rates: list[sp.Expr]
    start: Vector
    nominal: Vector
    stop: float
    interval: float

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
    """A program ready to run.

    Attributes
    ----------
    prepared : float
        Seconds of derivation and compilation.
    run : function of a tolerance
        Returns the exponents [nats/s].
    tolerances : tuple of float
        Values of the program's tolerance or step, from loose to tight.
    frame : ndarray or None
        First frame by rows, if it cannot be the states' axes.
    """

    prepared: float
    run: Callable[[float], Vector]
    tolerances: tuple[float, ...]
    frame: Vector | None = None


def orthonormalized(
    advance: Callable[[Vector, float, float], Vector], system: System, seconds: float
) -> Vector:
    """Exponents by QR of all tangents after each interval, with any solver."""
    n = len(system.symbols)
    state = np.concatenate([system.start, np.eye(n).ravel()])
    logs = np.zeros(n)
    begin = time.perf_counter()
    edges = np.linspace(0.0, system.stop, round(system.stop / system.interval) + 1)
    for a, b in itertools.pairwise(edges):
        state = advance(state, float(a), float(b))
        q, r = np.linalg.qr(state[n:].reshape(n, n))
        with np.errstate(divide="ignore"):
            logs += np.log(np.abs(np.diag(r)))
        state[n:] = q.ravel()
        if time.perf_counter() - begin > seconds:
            raise TooSlow
    return logs / system.stop


def scipy_lsoda(system: System, seconds: float) -> Solver:
    from scipy.integrate import solve_ivp

    begin = time.perf_counter()
    rates = sp.lambdify([system.symbols], system.rates, "math", cse=True)
    matrix = sp.lambdify([system.symbols], system.jacobian.tolist(), "math", cse=True)
    n = len(system.symbols)

    def rhs(_: float, w: Vector) -> Vector:
        x = w[:n].tolist()
        out = np.empty_like(w)
        out[:n] = rates(x)
        out[n:] = (np.array(matrix(x)) @ w[n:].reshape(n, n)).ravel()
        return out

    prepared = time.perf_counter() - begin

    def run(tolerance: float) -> Vector:
        atol = tolerance * np.concatenate([system.nominal, np.full(n * n, 1e-3)])

        def advance(state: Vector, a: float, b: float) -> Vector:
            done = solve_ivp(rhs, (a, b), state, "LSODA", rtol=tolerance, atol=atol)
            return np.asarray(done.y[:, -1])

        return orthonormalized(advance, system, seconds)

    return Solver(prepared, run, (1e-6, 1e-8, 1e-10))


def jitcode(system: System, seconds: float) -> Solver:
    try:
        import jitcode as package
    except ImportError as error:
        raise NotInstalled from error
    begin = time.perf_counter()
    symbols, rates = system.with_tangents()
    table = {s: sp.Symbol(f"Y{k}") for k, s in enumerate(symbols)}
    import symengine

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
    prepared = time.perf_counter() - begin

    def run(tolerance: float) -> Vector:
        atol = tolerance * 1e-3 * min(float(system.nominal.min()), 1.0)
        ode.set_integrator("LSODA", rtol=tolerance, atol=atol)

        def advance(state: Vector, a: float, b: float) -> Vector:
            ode.set_initial_value(state, a)
            return np.array(ode.integrate(b))

        return orthonormalized(advance, system, seconds)

    return Solver(prepared, run, (1e-6, 1e-8, 1e-10))


def heyoka(system: System, seconds: float) -> Solver:
    try:
        import heyoka as hy
    except ImportError as error:
        raise NotInstalled from error
    begin = time.perf_counter()
    symbols, rates = system.with_tangents()
    names = hy.make_vars(*[s.name for s in symbols])
    pairs = [(v, hy.from_sympy(sp.N(e, 17))) for v, e in zip(names, rates, strict=True)]
    n = len(system.symbols)
    state = np.concatenate([system.start, np.eye(n).ravel()])
    made: dict[float, Any] = {}

    def integrator(tolerance: float) -> Any:
        if tolerance not in made:
            made[tolerance] = hy.taylor_adaptive(pairs, state, tol=tolerance, compact_mode=True)
        return made[tolerance]

    tolerances = (1e-9, 1e-15)
    integrator(tolerances[0])
    prepared = time.perf_counter() - begin

    def run(tolerance: float) -> Vector:
        ta = integrator(tolerance)

        def advance(state: Vector, a: float, b: float) -> Vector:
            ta.time = a
            ta.state[:] = state
            ta.propagate_until(b)
            return np.array(ta.state)

        return orthonormalized(advance, system, seconds)

    return Solver(prepared, run, tolerances)


def pynamicalsys(system: System, seconds: float) -> Solver:
    try:
        from pynamicalsys import ContinuousDynamicalSystem
    except ImportError as error:
        raise NotInstalled from error
    from numba import njit

    begin = time.perf_counter()
    n = len(system.symbols)
    own = sp.symbols(f"x0:{n}", real=True)
    table = dict(zip(system.symbols, own, strict=True))
    lines = ["def rhs(time, u, parameters):", f"    out = np.empty({n})"]
    lines += [f"    x{k} = u[{k}]" for k in range(n)]
    for body, target in (
        ([e.xreplace(table) for e in system.rates], "out[{0}]"),
        ([e.xreplace(table) for e in system.jacobian], "out[{1}, {2}]"),
    ):
        if target == "out[{1}, {2}]":
            lines += ["    return out", "def jac(time, u, parameters):"]
            lines += [f"    out = np.empty(({n}, {n}))"]
            lines += [f"    x{k} = u[{k}]" for k in range(n)]
        shared, reduced = sp.cse([sp.N(e, 17) for e in body], symbols=sp.numbered_symbols("c"))
        lines += [f"    {s} = {sp.pycode(e)}" for s, e in shared]
        lines += [
            f"    {target.format(k, k // n, k % n)} = {sp.pycode(e)}" for k, e in enumerate(reduced)
        ]
    lines.append("    return out")
    space: dict[str, Any] = {"np": np, "math": math}
    exec("\n".join(lines), space)
    made = ContinuousDynamicalSystem(
        equations_of_motion=njit(space["rhs"]),
        jacobian=njit(space["jac"]),
        system_dimension=n,
        number_of_parameters=0,
    )
    frame, _ = np.linalg.qr(
        -1.0 + 2.0 * np.random.RandomState(PYNAMICALSYS_SEED).rand(n * n).reshape(n, n)
    )
    made.integrator("rk45", atol=1e-6, rtol=1e-6)
    made.lyapunov(system.start, 1e-4, parameters=[], num_exponents=n)
    prepared = time.perf_counter() - begin

    def run(tolerance: float) -> Vector:
        atol = tolerance * 1e-3 * float(system.nominal.min())
        made.integrator("rk45", atol=atol, rtol=tolerance)
        # It cannot be stopped: run a share of the time first, to estimate the total time.
        begin = time.perf_counter()
        share = 1e-3
        made.lyapunov(system.start, share * system.stop, parameters=[], num_exponents=n)
        if (time.perf_counter() - begin) / share > seconds:
            raise TooSlow
        return np.asarray(made.lyapunov(system.start, system.stop, parameters=[], num_exponents=n))

    return Solver(prepared, run, (1e-6, 1e-8, 1e-10), frame.T)
