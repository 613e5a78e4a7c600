"""What makes a component inconsistent: names, equations, modes and ranges."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NoReturn

import sympy as sp

from .errors import ContractError
from .functions import FUNCTIONS, TIME, symbol, symbols_in, unsupported_function

if TYPE_CHECKING:
    from .component import Component


def check(component: Component) -> None:
    """Raise `ContractError` for the first fault of a component."""
    states = [s.name for s in component.all_states]
    outputs = [o.name for o in component.all_outputs]
    declared = _declared(component)
    _check_outputs_and_ranges(component, outputs)
    balanced = [b.state for b in component.balances]
    for name in balanced:
        if name not in states or balanced.count(name) > 1:
            has = f"{balanced.count(name)} force balances and is {'' if name in states else 'no '}"
            _refuse(component, f"{name!r} has {has}state; expected one balance of a state")
    _check_modes(component, states, outputs)
    for state in component.all_states:
        if (state.derivative is None) != (state.name in balanced):
            needs = "one equation, either a derivative or a force balance"
            _refuse(component, f"state {state.name!r} needs {needs}")
    if component.discrete and component.sample_time is None:
        name = component.discrete[0].name
        _refuse(component, f"the discrete state {name!r} needs a sample_time")
    for where, expression in component.expressions():
        _check_expression(component, where, sp.sympify(expression), declared)


def _refuse(component: Component, fault: str) -> NoReturn:
    raise ContractError(f"{component.name}: {fault}")


def _declared(component: Component) -> dict[str, str]:
    """The names that equations may use, and what each of them is."""
    kinds: dict[str, tuple[Any, ...]] = {
        "parameter": component.all_parameters,
        "input": component.inputs,
        "state": component.all_states,
        "discrete state": component.discrete,
        "delayed signal": component.delays,
    }
    names = [(kind, part.name) for kind, parts in kinds.items() for part in parts]
    names += [("rate of a delayed signal", delay.rate) for delay in component.delays]
    seen = {TIME.name: "time"}
    for kind, name in names:
        if not name.isidentifier():
            _refuse(component, f"{kind} {name!r} is not an identifier")
        if name in seen:
            _refuse(component, f"{name!r} is declared as {seen[name]} and as {kind}")
        seen[name] = kind
    return seen


def _check_expression(part: Component, where: str, e: sp.Expr, declared: dict[str, str]) -> None:
    if wrong := unsupported_function(e):
        known = ", ".join(sorted(f.__name__ for f in FUNCTIONS))
        _refuse(part, f"{where} uses {wrong}, which is not supported; supported are {known}")
    for name in sorted(s.name for s in symbols_in(e)):
        if name not in declared:
            _refuse(part, f"{where} uses {name!r}, which is not declared")
        if symbol(name) not in symbols_in(e):
            how = "with other assumptions; make it with ballscrew.symbol"
            _refuse(part, f"{where} uses a symbol {name!r} {how}")


def _check_modes(component: Component, states: list[str], outputs: list[str]) -> None:
    modes = [m.name for m in component.modes]
    for mode in component.modes:
        if modes.count(mode.name) > 1:
            _refuse(component, f"mode {mode.name!r} is declared twice")
        targets = [(n, states) for n in mode.derivatives]
        targets += [(n, outputs) for n in mode.outputs]
        targets += [(n, states) for n in mode.signs]
        for event in mode.events:
            targets += [(n, states) for n in event.reset]
            targets += [(event.next_mode, modes)] if event.next_mode is not None else []
        for name, known in targets:
            if name not in known:
                there = ", ".join(known) or "none"
                _refuse(component, f"mode {mode.name!r} names {name!r}, which is not among {there}")
        for name, sign in mode.signs.items():
            if sign not in (-1, 0, 1):
                said = f"says that the sign of {name!r} is {sign}, expected -1, 0 or 1"
                _refuse(component, f"mode {mode.name!r} {said}")


def _check_outputs_and_ranges(component: Component, outputs: list[str]) -> None:
    taken = {p.name for p in component.all_parameters} | {i.name for i in component.inputs}
    for name in (component.name, *outputs):
        if not name.isidentifier():
            _refuse(component, f"{name!r} is not an identifier")
        if name in taken and name in outputs:
            _refuse(component, f"output {name!r} has the name of a parameter or an input")
        if outputs.count(name) > 1:
            _refuse(component, f"output {name!r} is declared twice")
    for p in component.all_parameters:
        if not (math.isfinite(p.default) and p.minimum <= p.default <= p.maximum):
            within = f"[{p.minimum}, {p.maximum}]"
            _refuse(component, f"default {p.default!r} of {p.name!r} is not within {within}")
