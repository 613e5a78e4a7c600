"""From a component to the source text of fast functions: value and Jacobian.

The text is plain Python over ``math``. The tapes for the compiled core are made from it,
operation by operation. It is also part of FMUs.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import replace

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from .component import TIME, Component, DiscreteState, Event, Mode, Output, State, symbol
from .core import CHANGES_MODE, EITHER, RESETS
from .errors import ContractError
from .functions import slopes, symbols_in
from .kernel import Kernel, OutputInfo, StateInfo
from .kernel_cache import hashed_name
from .tape import record_tape

_HEAD = '''"""The equations of {name}, generated."""

import math

'''
_INDENT = "    "


class _Printer(PythonCodePrinter):  # type: ignore[misc]
    """Python over ``math``, with the few functions that SymPy's printer writes only for readers."""

    def _print_sign(self, e: sp.Expr) -> str:
        x = self._print(e.args[0])
        return f"(0.0 if {x} == 0.0 else math.copysign(1.0, {x}))"

    def _print_Heaviside(self, e: sp.Expr) -> str:
        x, at_zero = map(self._print, e.args)
        return f"(1.0 if {x} > 0.0 else {at_zero} if {x} == 0.0 else 0.0)"

    def _print_sech(self, e: sp.Expr) -> str:
        return f"(1.0/math.cosh({self._print(e.args[0])}))"

    def _print_csch(self, e: sp.Expr) -> str:
        return f"(1.0/math.sinh({self._print(e.args[0])}))"

    def _print_coth(self, e: sp.Expr) -> str:
        return f"(1.0/math.tanh({self._print(e.args[0])}))"

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


_PRINTER = _Printer({"fully_qualified_modules": True})


def as_python(expression: sp.Basic) -> str:
    """An expression as Python over ``math``."""
    return str(_PRINTER._print(expression))  # its ``doprint`` searches for what we do not have


def _function(
    header: str, unpack: dict[str, list[str]], by_mode: Sequence[dict[str, sp.Expr]]
) -> str:
    """One generated function: the assignments of the system, or of its present mode."""
    if len(by_mode) == 1:
        return "\n".join([header, *_assignments(unpack, by_mode[0], _INDENT)]) + "\n"
    lines = [header]
    for k, targets in enumerate(by_mode):
        lines.append(f"{_INDENT}{'el' if k else ''}if u[{len(unpack['u'])}] == {k}.0:")
        lines += _assignments(unpack, targets, 2 * _INDENT)
    return "\n".join(lines) + "\n"


def _assignments(
    unpack: dict[str, list[str]], targets: dict[str, sp.Expr], indent: str
) -> list[str]:
    """Unpack used symbols, common subexpressions, then assignments."""
    targets = {name: sp.sympify(e) for name, e in targets.items()}
    temporaries = sp.numbered_symbols("_c", real=True)
    common, reduced = sp.cse(list(targets.values()), symbols=temporaries)
    used = set().union(*map(symbols_in, targets.values()))
    lines = []
    for vector, names in unpack.items():
        for index, name in enumerate(names):
            if symbol(name) in used:
                lines.append(f"{indent}{name}_ = {vector}[{index}]")
    rename = {s: sp.Symbol(s.name + "_", real=True) for s in used if s != TIME}
    for name, expression in [*common, *zip(targets, reduced, strict=True)]:
        lines.append(f"{indent}{name} = {as_python(expression.xreplace(rename))}")
    return lines or [f"{indent}pass"]


def _matrix(name: str, entries: sp.Matrix) -> dict[str, sp.Expr]:
    rows, columns = entries.shape
    return {f"{name}[{i}, {j}]": entries[i, j] for i in range(rows) for j in range(columns)}


def _linearized(component: Component, mode: Mode | None) -> tuple[sp.Matrix, sp.Matrix]:
    states = [symbol(s.name) for s in component.all_states]
    f = _derivatives(component, mode)
    return slopes(f, states), _rates_by_time(component, f)


def _rates_by_time(component: Component, expressions: Sequence[sp.Expr]) -> sp.Matrix:
    """Partial derivatives by time; delayed signals are functions of time."""
    rates = slopes(expressions, [TIME])
    for delay in component.delays:
        rates += slopes(expressions, [symbol(delay.name)]) * symbol(delay.rate)
    return rates


def _derivatives(component: Component, mode: Mode | None) -> list[sp.Expr]:
    own = mode.derivatives if mode else {}
    common = zip(component.all_states, component.derivatives, strict=True)
    return [own.get(s.name, derivative) for s, derivative in common]


def _outputs(component: Component, mode: Mode | None) -> list[sp.Expr]:
    own = mode.outputs if mode else {}
    return [own.get(o.name, o.value) for o in component.all_outputs]


def _events(component: Component, most: int) -> str:
    """The functions for events."""
    unpack = _places(component)
    modes = component.modes
    names = [m.name for m in modes]
    states = [s.name for s in component.all_states]
    mode_at = f"u[{len(unpack['u'])}]"
    indicators, spreads = [], []
    for mode in modes:
        rows: dict[str, sp.Expr] = {f"g[{k}]": sp.Integer(-1) for k in range(most)}
        sizes: dict[str, sp.Expr] = {f"s[{k}]": sp.Integer(0) for k in range(most)}
        for k, event in enumerate(mode.events):
            rows[f"g[{k}]"] = -event.indicator if event.direction < 0 else event.indicator
            sizes[f"s[{k}]"] = _spread(component, event)
        indicators.append(rows)
        spreads.append(sizes)
    kinds, reactions = ["def kind(u, k):"], ["def react(t, x, u, p, k):"]
    slopes = ["def slopes(t, x, u, p, k, g, R, rt):"]
    for m, mode in enumerate(modes):
        for k, event in enumerate(mode.events):
            here = f"{_INDENT}if {mode_at} == {m}.0 and k == {k}:"
            what = CHANGES_MODE if event.next_mode is not None else RESETS
            what = what if event.direction else EITHER
            kinds += [here, f"{2 * _INDENT}return {what}"]
            # all new values from the old ones, then the assignments
            reset = {f"new_{n}": sp.sympify(e) for n, e in event.reset.items()}
            reactions += [here, *_assignments(unpack, reset, 2 * _INDENT)]
            reactions += [f"{2 * _INDENT}x[{states.index(n)}] = new_{n}" for n in event.reset]
            if event.next_mode is not None:
                reactions.append(f"{2 * _INDENT}{mode_at} = {names.index(event.next_mode)}.0")
            reactions.append(f"{2 * _INDENT}return")
            slopes += [here, *_slopes(component, event, unpack)]
    kinds.append(f"{_INDENT}return 0")
    reactions.append(f"{_INDENT}return")
    return "\n\n".join(
        [
            _function("def indicate(t, x, u, p, g):", unpack, indicators or [{}]),
            _function("def spread(t, x, u, p, s):", unpack, spreads or [{}]),
            "\n".join(kinds) + "\n",
            "\n".join(reactions) + "\n",
            "\n".join([*slopes, f"{_INDENT}return 0.0"]) + "\n",
        ]
    )


def _spread(component: Component, event: Event) -> sp.Expr:
    """Change of an indicator when states and inputs change by their nominals, and time by 1 s."""
    nominals = {symbol(s.name): s.nominal for s in component.all_states}
    nominals |= {symbol(i.name): i.nominal for i in component.inputs}
    nominals |= {symbol(d.name): d.nominal for d in component.delays}
    nominals[TIME] = 1.0
    rates = slopes([event.indicator], list(nominals))
    return sp.Add(*(abs(rate) * size for rate, size in zip(rates, nominals.values(), strict=True)))


def _slopes(component: Component, event: Event, unpack: dict[str, list[str]]) -> list[str]:
    """Lines of `slopes` for one event: the gradient of its indicator and the slopes of its reset.

    They return the indicator's partial derivative by time.
    """
    names = [s.name for s in component.all_states]
    states = [symbol(n) for n in names]
    after = [event.reset.get(n, symbol(n)) for n in names]
    gradient = slopes([event.indicator], states)
    targets = {f"g[{k}]": e for k, e in enumerate(gradient)}
    targets |= _matrix("R", slopes(after, states))
    targets |= {f"rt[{k}]": e for k, e in enumerate(_rates_by_time(component, after))}
    targets["rate"] = _rates_by_time(component, [event.indicator])[0]
    return [*_assignments(unpack, targets, 2 * _INDENT), f"{2 * _INDENT}return rate"]


def _places(component: Component) -> dict[str, list[str]]:
    """The place of each symbol in the vectors x, u and p."""
    return {
        "x": [s.name for s in component.all_states],
        "u": [
            *(i.name for i in component.inputs),
            *(d.name for d in component.discrete),
            *(d.name for d in component.delays),
            *(d.rate for d in component.delays),
        ],
        "p": [p.name for p in component.all_parameters],
    }


def generate(component: Component) -> Kernel:
    """Generate the functions of a component.

    Raises
    ------
    ContractError
        If a delay's duration is not constant.
    """
    _check_durations(component)
    inputs = [i.name for i in component.inputs]
    unpack = _places(component)
    most = max((len(m.events) for m in component.modes), default=0)
    source = _source(component, unpack, most)
    uses = [_symbols_of(component, o) for o in component.all_outputs]
    tapes = record_tape(
        source,
        len(component.all_states),
        len(unpack["u"]) + bool(component.modes),
        most,
        len(component.delays),
        len(inputs) + len(component.discrete),
    )
    return Kernel(
        name=component.name,
        description=component.description,
        parameters=[
            replace(p, nominal=p.nominal or abs(p.default) or 1.0) for p in component.all_parameters
        ],
        inputs=list(component.inputs),
        states=list(map(_info, component.all_states)),
        discrete=list(map(_info, component.discrete)),
        outputs=[
            OutputInfo(
                o.name, o.unit, o.meaning, o.nominal, sorted(used), [n for n in inputs if n in used]
            )
            for o, used in zip(component.all_outputs, uses, strict=True)
        ],
        sample_time=component.sample_time.name if component.sample_time else "",
        modes=[m.name for m in component.modes],
        events=most,
        module=hashed_name(f"equations_{component.name}", source),
        source=source,
        delays=[StateInfo(d.name, d.unit, "", d.start, d.nominal) for d in component.delays],
        tapes=b64encode(tapes).decode(),
    )


def _info(s: State | DiscreteState) -> StateInfo:
    return StateInfo(s.name, s.unit, s.meaning, s.start, s.nominal)


def _source(component: Component, unpack: dict[str, list[str]], most: int) -> str:
    """The functions of a component in Python, with at most this number of events in a mode."""
    modes: tuple[Mode | None, ...] = component.modes or (None,)
    linearized = [_linearized(component, m) for m in modes]
    updates = {f"d[{k}]": d.update for k, d in enumerate(component.discrete)}

    def numbered(vector: str, expressions: Iterable[sp.Expr]) -> dict[str, sp.Expr]:
        return {f"{vector}[{k}]": e for k, e in enumerate(expressions)}

    by_mode = {
        "def rhs(t, x, u, p, dx):": [numbered("dx", _derivatives(component, m)) for m in modes],
        "def jac(t, x, u, p, J, ft):": [
            {**_matrix("J", j), **numbered("ft", by_time)} for j, by_time in linearized
        ],
        "def out(t, x, u, p, y):": [numbered("y", _outputs(component, m)) for m in modes],
        "def sample(t, x, u, p, d):": [updates],
    }
    parts = [_function(header, unpack, targets) for header, targets in by_mode.items()]
    parts.append(_events(component, most))
    parts += [_delayed(component, unpack)] if component.delays else []
    body = "\n\n".join(parts)
    return f"{_HEAD.format(name=component.name)}\n{body}"


def _check_durations(component: Component) -> None:
    constant = {symbol(p.name) for p in component.all_parameters}
    for delay in component.delays:
        if moving := sorted(s.name for s in symbols_in(sp.sympify(delay.duration)) - constant):
            raise ContractError(
                f"{component.name}: the duration of delay {delay.name!r} depends on {moving[0]!r}; "
                "this version solves constant delays"
            )


def _delayed(component: Component, unpack: dict[str, list[str]]) -> str:
    """The function for values of the delayed signals, their delays, start values and nominals."""
    of = "expression", "duration", "start", "nominal"
    values = [getattr(d, name) for name in of for d in component.delays]
    targets = {f"e[{k}]": sp.sympify(e) for k, e in enumerate(values)}
    return _function("def delayed(t, x, u, p, e):", unpack, [targets])


def _symbols_of(component: Component, output: Output) -> set[str]:
    """Names of what an output depends on, in any mode."""
    values = [output.value, *(m.outputs.get(output.name, output.value) for m in component.modes)]
    return {s.name for value in values for s in symbols_in(sp.sympify(value))}
