"""From a component to the source text of fast functions: value and Jacobian.

The text is plain Python over ``math``; numba compiles it where numba is present. The same text
goes into FMUs and is the reason why a number computed in one process is bit for bit the number of
another.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from . import stepper
from .component import TIME, Component, symbol
from .kernel import InputInfo, Kernel, OutputInfo, ParameterInfo, StateInfo

# The stepper's text comes first and the equations after it, in one module whose name is a hash of
# both. One module is needed: numba's compiled functions are linked by their module's and function's
# names, and code cached by two processes for two systems may not meet under one name.
_FOOTER = """

rhs = njit(error_model="numpy")(rhs)
jac = njit(error_model="numpy")(jac)
out = njit(cache=True, error_model="numpy")(out)
sample = njit(cache=True, error_model="numpy")(sample)
integrate = build(rhs, jac)


@njit(cache=True, error_model="numpy")
def derivatives(t, x, u, p, dx):
    rhs(t, x, u, p, dx)


@njit(cache=True, error_model="numpy")
def jacobian(t, x, u, p, J, ft):
    jac(t, x, u, p, J, ft)


@njit(cache=True, error_model="numpy")
def advance(t0, t1, x, u, p, atol, rtol, work, info, max_steps):
    return integrate(t0, t1, x, u, p, atol, rtol, work, info, max_steps)


@njit(cache=True, error_model="numpy")
def trajectory(times, X, u, p, atol, rtol, work, info, max_steps):
    for k in range(1, times.shape[0]):
        X[k] = X[k - 1]
        status = integrate(
            times[k - 1], times[k], X[k], u, p, atol, rtol, work, info, max_steps
        )
        if status != 0:
            return k
    return times.shape[0]
"""


class UnsupportedComponent(NotImplementedError):
    """The component uses a part of the contract that this version does not solve."""


class _Printer(PythonCodePrinter):  # type: ignore[misc]
    """Python over ``math``, with the few functions that Python's printer spells for people."""

    def _print_sign(self, e: sp.Expr) -> str:
        x = self._print(e.args[0])
        return f"(0.0 if {x} == 0.0 else math.copysign(1.0, {x}))"

    def _print_Heaviside(self, e: sp.Expr) -> str:
        x = self._print(e.args[0])
        return f"(1.0 if {x} > 0.0 else 0.0)"

    def _print_Integer(self, e: sp.Integer) -> str:
        return f"{int(e)}.0"

    def _print_Rational(self, e: sp.Rational) -> str:
        return repr(float(e))

    def _print_Pow(self, e: sp.Pow, rational: bool = False) -> str:
        base, exponent = e.as_base_exp()
        if exponent.is_Integer and 2 <= abs(int(exponent)) <= 4:
            text = "*".join([self.parenthesize(base, 60)] * abs(int(exponent)))
            return f"({text})" if exponent > 0 else f"(1.0/({text}))"
        if exponent == -1:
            return f"(1.0/{self.parenthesize(base, 60)})"
        return str(super()._print_Pow(e, rational=rational))


def _function(
    header: str, unpack: dict[str, list[str]], targets: dict[str, sp.Expr], printer: _Printer
) -> str:
    """One generated function: unpack used symbols, common subexpressions, then assignments."""
    targets = {name: sp.sympify(e) for name, e in targets.items()}
    temporaries = sp.numbered_symbols("_c", real=True)
    common, reduced = sp.cse(list(targets.values()), symbols=temporaries, optimizations="basic")
    used = set().union(*(e.free_symbols for e in targets.values())) if targets else set()
    lines = [header]
    for vector, names in unpack.items():
        for index, name in enumerate(names):
            if symbol(name) in used:
                lines.append(f"    {name}_ = {vector}[{index}]")
    rename = {s: sp.Symbol(s.name + "_", real=True) for s in used if s != TIME}
    for name, expression in common:
        lines.append(f"    {name} = {printer.doprint(expression.xreplace(rename))}")
    for target, expression in zip(targets, reduced, strict=True):
        lines.append(f"    {target} = {printer.doprint(expression.xreplace(rename))}")
    if len(lines) == 1:
        lines.append("    pass")
    return "\n".join(lines) + "\n"


def _matrix(name: str, entries: sp.Matrix) -> dict[str, sp.Expr]:
    rows, columns = entries.shape
    return {f"{name}[{i}, {j}]": entries[i, j] for i in range(rows) for j in range(columns)}


def _linearized(component: Component) -> tuple[sp.Matrix, sp.Matrix]:
    states = [symbol(s.name) for s in component.all_states]
    f = sp.Matrix(list(component.derivatives)) if states else sp.zeros(0, 1)
    by_state = f.jacobian(states) if states else sp.zeros(0, 0)
    return by_state, f.diff(TIME) if states else sp.zeros(0, 1)


def generate(component: Component) -> Kernel:
    """Generate the functions of a component.

    Raises
    ------
    UnsupportedComponent
        If it has modes, events or delays.
    """
    if component.modes or component.delays:
        part = "modes and events" if component.modes else "delays"
        raise UnsupportedComponent(
            f"{component.name} has {part}; this version solves components without them"
        )
    inputs = [i.name for i in component.inputs]
    held = inputs + [d.name for d in component.discrete]
    unpack = {
        "x": [s.name for s in component.all_states],
        "u": held,
        "p": [p.name for p in component.all_parameters],
    }
    printer = _Printer({"fully_qualified_modules": True})
    by_state, by_time = _linearized(component)
    outputs = {f"y[{k}]": o.value for k, o in enumerate(component.all_outputs)}
    updates = {f"d[{k}]": d.update for k, d in enumerate(component.discrete)}
    body = "\n\n".join(
        [
            _function(
                "def rhs(t, x, u, p, dx):",
                unpack,
                {f"dx[{k}]": e for k, e in enumerate(component.derivatives)},
                printer,
            ),
            _function(
                "def jac(t, x, u, p, J, ft):",
                unpack,
                {**_matrix("J", by_state), **{f"ft[{k}]": e for k, e in enumerate(by_time)}},
                printer,
            ),
            _function("def out(t, x, u, p, y):", unpack, outputs, printer),
            _function("def sample(t, x, u, p, d):", unpack, updates, printer),
        ]
    )
    source = Path(stepper.__file__).read_text(encoding="utf-8") + "\n\n" + body + _FOOTER
    return Kernel(
        name=component.name,
        description=component.description,
        parameters=[
            ParameterInfo(p.name, p.default, p.unit, p.meaning, p.source, p.minimum, p.maximum)
            for p in component.all_parameters
        ],
        inputs=[
            InputInfo(i.name, i.unit, i.meaning, i.start, i.nominal, i.role, list(i.law))
            for i in component.inputs
        ],
        states=[
            StateInfo(s.name, s.unit, s.meaning, s.start, s.nominal) for s in component.all_states
        ],
        discrete=[
            StateInfo(d.name, d.unit, d.meaning, d.start, d.nominal) for d in component.discrete
        ],
        outputs=[
            OutputInfo(
                o.name,
                o.unit,
                o.meaning,
                o.nominal,
                sorted(s.name for s in sp.sympify(o.value).free_symbols - {TIME}),
                [name for name in inputs if symbol(name) in sp.sympify(o.value).free_symbols],
            )
            for o in component.all_outputs
        ],
        sample_time=component.sample_time.name if component.sample_time else "",
        equations=_readable(component),
        module=hashed_name(f"equations_{component.name}", source),
        source=source,
    )


def hashed_name(stem: str, text: str) -> str:
    """A module name that no other content can have."""
    return f"{stem}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def _readable(component: Component) -> list[list[str]]:
    """Left and right sides of all equations as MathML, for the documentation inside an FMU."""
    rows = [
        (sp.Derivative(symbol(s.name), TIME), e)
        for s, e in zip(component.all_states, component.derivatives, strict=True)
    ]
    rows += [(symbol(o.name), sp.sympify(o.value)) for o in component.all_outputs]
    rows += [(symbol(d.name + "_next"), sp.sympify(d.update)) for d in component.discrete]
    return [
        [sp.mathml(left, printer="presentation"), sp.mathml(right, printer="presentation")]
        for left, right in rows
    ]
