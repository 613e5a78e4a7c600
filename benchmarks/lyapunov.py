"""Cost of Lyapunov exponents, here and in other programs: ``python benchmarks/lyapunov.py``.

Every program gets the same equations, the same first frame and the same time span. Its tolerance is
reduced until all exponents are within 1e-3 of the converged ones (relative, or in bits/s if an
exponent is below 1 bit/s), and this run is timed, warm, the best of five. Preparing is derivation
and compilation. docs/speed.md has the tables.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

# compilation is timed, so the cache must be empty; set before the package is imported
_FOLDER = tempfile.TemporaryDirectory()
os.environ["BALLSCREW_CACHE"] = _FOLDER.name

import lyapunov_peers as peers  # noqa: E402
import numpy as np  # noqa: E402
import numpy.typing as npt  # noqa: E402
import sympy as sp  # noqa: E402

from ballscrew.orchestration.loop.catalogue import component  # noqa: E402
from ballscrew.orchestration.loop.whole_loop import loop_kernel  # noqa: E402
from ballscrew.solver.codegen import generate  # noqa: E402
from ballscrew.solver.component import Component, Output, State, symbol  # noqa: E402
from ballscrew.solver.interconnect import connect  # noqa: E402
from ballscrew.solver.kernel import Model  # noqa: E402
from ballscrew.solver.spectrum import follow_tangents  # noqa: E402

Vector = npt.NDArray[np.float64]

ERROR = 1e-3
SETPOINT = 0.08  # m
SECONDS = float(os.environ.get("BENCH_SECONDS", "60"))  # longest time of one run
OURS = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
CONVERGED = 1e-13
REPEATS = 5
LORENZ = (10.0, 28.0, 8.0 / 3.0)


@dataclass(frozen=True)
class Row:
    """Cost of one program on one system; times in seconds, the error as in `ERROR`."""

    program: str
    prepared: float = math.nan
    seconds: float = math.nan
    error: float = math.nan
    remark: str = ""


def numbers(loop: Component, setpoint: float) -> tuple[list[sp.Symbol], list[sp.Expr]]:
    """States and rates of a component, with defaults and set-point instead of symbols."""
    table = {symbol(p.name): sp.Float(p.default, 17) for p in loop.all_parameters}
    table |= {symbol(i.name): sp.Float(setpoint, 17) for i in loop.inputs}
    # without the amplifier's limits: the last branch of each case, which other programs can read
    rates = [
        sp.sympify(e).replace(lambda q: isinstance(q, sp.Piecewise), lambda q: q.args[-1].expr)
        for e in loop.derivatives
    ]
    rates = [e.xreplace(table) for e in rates]
    return [symbol(s.name) for s in loop.all_states], rates


def lorenz_component() -> Component:
    x, y, z = (symbol(n) for n in "xyz")
    sigma, rho, beta = (sp.Float(p, 17) for p in LORENZ)
    rates = {"x": sigma * (y - x), "y": x * (rho - z) - y, "z": x * y - beta * z}
    starts = {"x": 1.0, "y": 1.0, "z": 20.0}
    states = tuple(State(n, "1", n, rate, start=starts[n]) for n, rate in rates.items())
    return Component("lorenz", "Lorenz", states=states, outputs=(Output("x", "1", "x", x),))


def system(name: str, whole: Component, stop: float, interval: float) -> peers.System:
    symbols, rates = numbers(whole, SETPOINT)
    start = np.array([s.start for s in whole.all_states])
    nominal = np.array([s.nominal for s in whole.all_states])
    return peers.System(name, symbols, rates, start, nominal, stop, interval)


def hand_written(given: peers.System, _: float) -> peers.Solver:
    """Lorenz and its tangents by RK4 in numba, with Gram-Schmidt in every tenth step."""
    from numba import njit

    @njit(fastmath=True)
    def rhs(w: Vector, out: Vector) -> None:
        x, y, z = w[0], w[1], w[2]
        out[0], out[1], out[2] = 10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z
        for k in range(3):
            a, b, c = w[3 + 3 * k], w[4 + 3 * k], w[5 + 3 * k]
            out[3 + 3 * k] = 10.0 * (b - a)
            out[4 + 3 * k] = (28.0 - z) * a - b - x * c
            out[5 + 3 * k] = y * a + x * b - 8.0 / 3.0 * c

    @njit(fastmath=True)
    def march(start: Vector, stop: float, h: float) -> Vector:
        w, at, logs = np.zeros(12), np.zeros(12), np.zeros(3)
        k1, k2, k3, k4 = np.zeros(12), np.zeros(12), np.zeros(12), np.zeros(12)
        w[:3] = start
        w[3] = w[7] = w[11] = 1.0
        steps = round(stop / h)
        for s in range(1, steps + 1):
            rhs(w, k1)
            for i in range(12):
                at[i] = w[i] + 0.5 * h * k1[i]
            rhs(at, k2)
            for i in range(12):
                at[i] = w[i] + 0.5 * h * k2[i]
            rhs(at, k3)
            for i in range(12):
                at[i] = w[i] + h * k3[i]
            rhs(at, k4)
            for i in range(12):
                w[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
            if s % 10 == 0 or s == steps:
                for j in range(3):
                    for k in range(j):
                        dot = 0.0
                        for i in range(3):
                            dot += w[3 + 3 * j + i] * w[3 + 3 * k + i]
                        for i in range(3):
                            w[3 + 3 * j + i] -= dot * w[3 + 3 * k + i]
                    length = 0.0
                    for i in range(3):
                        length += w[3 + 3 * j + i] ** 2
                    length = math.sqrt(length)
                    logs[j] += math.log(length)
                    for i in range(3):
                        w[3 + 3 * j + i] /= length
        return logs / stop

    begin = time.perf_counter()
    march(given.start, 0.1, 0.01)
    prepared = time.perf_counter() - begin
    steps = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)
    return peers.Solver(prepared, lambda h: march(given.start, given.stop, h), steps)


def error_of(found: Vector, converged: Vector) -> float:
    """Largest error of an exponent: relative, or in bits/s if the exponent is below 1 bit/s."""
    bits = np.array([np.sort(found), np.sort(converged)]) / math.log(2.0)
    with np.errstate(invalid="ignore"):
        worst = float(np.max(np.abs(bits[0] - bits[1]) / np.maximum(np.abs(bits[1]), 1.0)))
    return worst if math.isfinite(worst) else math.inf


def timed(run: Callable[[], Vector]) -> tuple[Vector, float]:
    """The result, and the shortest time of as many runs as possible in a few seconds."""
    best, spent = math.inf, 0.0
    for _ in range(REPEATS):
        begin = time.perf_counter()
        result = run()
        taken = time.perf_counter() - begin
        best, spent = min(best, taken), spent + taken
        if spent > 5.0:
            break
    return result, best


def measured(
    program: str,
    prepared: float,
    run: Callable[[float], Vector],
    tolerances: tuple[float, ...],
    converged: Vector,
) -> Row:
    """Result for the first tolerance, from loose to tight, that meets `ERROR`; else the best."""
    best = Row(program, prepared, remark=f"not finished in {SECONDS:.0f} s")
    for tolerance in tolerances:
        try:
            found, seconds = timed(lambda t=tolerance: run(t))  # type: ignore[misc]
        except peers.TooSlow:
            break
        except Exception as error:  # a failure of another program is a result, too
            best = Row(program, prepared, remark=f"fails: {type(error).__name__}: {error}"[:90])
            continue
        error = error_of(found, converged)
        right = int(
            sum(
                error_of(np.array([a]), np.array([b])) <= ERROR
                for a, b in zip(np.sort(found), np.sort(converged), strict=True)
            )
        )
        if error <= ERROR:
            return Row(program, prepared, seconds, error)
        if not best.error <= error:
            remark = f"never right: {right} of {len(found)} exponents within {ERROR:g}"
            best = Row(program, prepared, seconds, error, remark)
    return best


def rows_of(
    given: peers.System,
    make: Callable[[float], Model],
    extra: dict[str, Callable[..., peers.Solver]],
) -> list[Row]:
    begin = time.perf_counter()
    follow_tangents(make(1e-6), [0.0, 1e-3 * given.stop])
    prepared = time.perf_counter() - begin
    grid = [0.0, given.stop]
    converged = follow_tangents(make(CONVERGED), grid).exponents
    rows = [
        measured(
            "this program",
            prepared,
            lambda t: follow_tangents(make(t), grid).exponents,
            OURS,
            converged,
        )
    ]
    n = len(converged)
    if n > 3:
        slow = follow_tangents(make(CONVERGED), grid, count=2).exponents
        rows.append(
            measured(
                "this program, slowest two",
                prepared,
                lambda t: follow_tangents(make(t), grid, count=2).exponents,
                OURS,
                slow,
            )
        )
    others = {
        **extra,
        "scipy, LSODA": peers.scipy_lsoda,
        "jitcode, LSODA": peers.jitcode,
        "heyoka": peers.heyoka,
        "pynamicalsys, rk45": peers.pynamicalsys,
    }
    for program, prepare in others.items():
        print(f"  {given.name}: {program} ...", flush=True)
        try:
            solver = prepare(given, SECONDS)
        except peers.NotInstalled:
            rows.append(Row(program, remark="not installed"))
            continue
        except Exception as error:  # as above
            rows.append(Row(program, remark=f"fails: {type(error).__name__}: {error}"[:90]))
            continue
        goal = converged
        if solver.frame is not None:
            goal = follow_tangents(make(CONVERGED), grid, frame=solver.frame).exponents
        rows.append(measured(program, solver.prepared, solver.run, solver.tolerances, goal))
    return rows


def table(given: peers.System, rows: list[Row]) -> str:
    ours = rows[0].seconds
    lines = [
        f"## {given.name}, {given.stop:g} s",
        "",
        "| program | prepare [s] | run [ms] | times ours | worst error | |",
        "|---|---|---|---|---|---|",
    ]

    def cell(value: float, form: str) -> str:
        return format(value, form) if math.isfinite(value) else ""

    for row in rows:
        cells = [
            row.program,
            cell(row.prepared, ".2f"),
            cell(1e3 * row.seconds, ".3g"),
            cell(row.seconds / ours, ".3g"),
            cell(row.error, ".1e"),
            row.remark,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def judged(tables: dict[str, list[Row]]) -> list[str]:
    """The aims, met or missed, and every program that is faster."""

    def row(name: str, program: str) -> Row:
        return next(r for r in tables[name] if r.program == program)

    def against(what: str, found: Row, aim: float) -> str:
        word = "met" if found.seconds <= aim and not found.remark else "missed"
        note = f" ({found.remark})" if found.remark else ""
        return f"- {what}: {1e3 * found.seconds:.3g} ms, target {1e3 * aim:.3g} ms: {word}{note}"

    lines = [
        against("NCTF loop, slowest two", row("NCTF loop", "this program, slowest two"), 0.05),
        against("NCTF loop, all", row("NCTF loop", "this program"), 0.2),
        against("IOL loop, all", row("IOL loop", "this program"), 0.03),
        against(
            "Lorenz, against twice the hand-written loop",
            row("Lorenz", "this program"),
            2.0 * row("Lorenz", "hand-written RK4").seconds,
        ),
    ]
    for name, rows in tables.items():
        for r in rows[1:]:
            if r.program.startswith("this"):
                continue
            if not r.remark and r.seconds < rows[0].seconds:
                ratio = rows[0].seconds / r.seconds
                lines.append(f"- {name}: {r.program} runs {ratio:.3g} times as fast")
            if math.isfinite(r.prepared) and r.prepared < rows[0].prepared and not r.remark:
                ratio = rows[0].prepared / r.prepared
                lines.append(f"- {name}, preparing: {r.program} is ready {ratio:.3g} times as fast")
    return lines


def versions() -> str:
    found = []
    for name in ("numpy", "numba", "scipy", "jitcode", "heyoka", "pynamicalsys"):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name}: not installed")
    return ", ".join(found)


def main() -> None:
    load = os.getloadavg()[0]
    loops = {}
    for name in ("nctf", "iol"):
        whole = connect(component("plant"), component(name))
        loops[name] = system(f"{name.upper()} loop", whole, 20.0, 2e-3 if name == "nctf" else 0.05)
    tables: dict[str, list[Row]] = {}
    kernels = {}

    def loop(name: str) -> Callable[[float], Model]:
        def make(tolerance: float) -> Model:
            kernel = loop_kernel("plant", name)
            kernel.compile()
            model = Model(kernel, {}, tolerance)
            model.set_input("x_d", SETPOINT)
            return model

        return make

    def lorenz(tolerance: float) -> Model:
        if "lorenz" not in kernels:
            kernels["lorenz"] = generate(lorenz_component())
            kernels["lorenz"].compile()
        return Model(kernels["lorenz"], {}, tolerance)

    chaos = system("Lorenz", lorenz_component(), 20.0, 0.1)
    for given, make, extra in (
        (loops["iol"], loop("iol"), {}),
        (loops["nctf"], loop("nctf"), {}),
        (chaos, lorenz, {"hand-written RK4": hand_written}),
    ):
        tables[given.name] = rows_of(given, make, extra)
        print(table(given, tables[given.name]), flush=True)
    print("\n".join(judged(tables)))
    print(f"{versions()}; {os.cpu_count()} cores, load {load:.1f} to {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
