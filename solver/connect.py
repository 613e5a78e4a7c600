"""Connect two components into one: the whole closed loop as one system of equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import sympy as sp

from .component import Component, ContractError, Event, Mode, Output, symbol
from .functions import symbols_in
from .kernel import CONTROLLER, PLANT

_REFERENCES = ("reference", "reference_derivative")


def connect(plant: Component, controller: Component) -> Component:
    """The closed loop of a plant and a controller.

    Signals meet by name: the controller's measurements take the plant's outputs, the plant's
    inputs take the controller's outputs. A measurement that the controller does not use may be
    missing. Parameters and states are prefixed with ``plant_`` and ``controller_``; outputs keep
    their names, the plant's first.

    Raises
    ------
    ContractError
        If a signal is missing, or both sides depend directly on each other.
    """
    p, c = plant.prefixed(PLANT), controller.prefixed(CONTROLLER)
    measured = {}
    used = c.used_symbols()
    for signal in (i for i in c.inputs if i.role not in _REFERENCES and symbol(i.name) in used):
        if not any(o.name == signal.name for o in p.all_outputs):
            there = ", ".join(o.name for o in p.all_outputs) or "none"
            raise ContractError(
                f"{plant.name} has no output {signal.name!r}, {controller.name} measures it; "
                f"it has {there}"
            )
        value = p.output(signal.name).value
        if {symbol(i.name) for i in p.inputs} & symbols_in(value):
            raise ContractError(
                f"{plant.name} and {controller.name}: {signal.name!r} depends on the plant's input "
                "at once, which makes an algebraic loop"
            )
        measured[symbol(signal.name)] = value
    # The halves are complete only together, so the contract is checked on the whole.
    theirs = c.equations_with(measured)
    commands = {o.name: sp.sympify(o.value) for o in theirs["outputs"]}
    missing = [i.name for i in p.inputs if i.name not in commands]
    if missing:
        raise ContractError(
            f"{controller.name} has no output {missing[0]!r}, {plant.name} needs it"
        )
    _check_delays(p, c)
    _check_delays(c, p)
    ours = p.equations_with({symbol(i.name): commands[i.name] for i in p.inputs})
    return Component(
        name=f"{plant.name}_with_{controller.name}",
        description=f"Closed loop: {plant.description}; {controller.description}",
        parameters=p.parameters + c.parameters,
        inputs=tuple(i for i in c.inputs if i.role in _REFERENCES),
        states=ours["states"] + theirs["states"],
        outputs=_distinct(ours["outputs"], theirs["outputs"]),
        balances=ours["balances"] + theirs["balances"],
        discrete=ours["discrete"] + theirs["discrete"],
        sample_time=c.sample_time or p.sample_time,
        modes=_modes(p, c) if p.modes or c.modes else (),
        delays=ours["delays"] + theirs["delays"],
    )


def _check_delays(component: Component, other: Component) -> None:
    """A delayed signal has one expression, whatever the mode."""
    moded = {symbol(n) for mode in other.modes for n in mode.outputs}
    for delay in component.delays:
        if moded & symbols_in(sp.sympify(delay.expression)):
            raise ContractError(
                f"{component.name}: {delay.name!r} delays a signal that modes change; give it a "
                "state of its own"
            )


def _modes(plant: Component, controller: Component) -> tuple[Mode, ...]:
    """Every pair of a mode of the plant and one of the controller, each with all its equations."""
    alone = Mode("")
    modes = []
    for ours in plant.modes or (alone,):
        seen = {o.name: sp.sympify(ours.outputs.get(o.name, o.value)) for o in plant.all_outputs}
        measured = {
            symbol(i.name): seen[i.name]
            for i in controller.inputs
            if i.role not in _REFERENCES and i.name in seen
        }
        for theirs in controller.modes or (alone,):
            answers = {
                o.name: sp.sympify(theirs.outputs.get(o.name, o.value)).xreplace(measured)
                for o in controller.all_outputs
            }
            command = {symbol(i.name): answers[i.name] for i in plant.inputs}
            outputs = {n: e.xreplace(command) for n, e in seen.items()}
            outputs |= {(CONTROLLER + n if n in seen else n): e for n, e in answers.items()}
            both = Mode(
                _pair(ours.name, theirs.name),
                derivatives=_rates(plant, ours, command) | _rates(controller, theirs, measured),
                outputs=outputs,
                events=(
                    *(
                        _swapped(e, command, e.next_mode and _pair(e.next_mode, theirs.name))
                        for e in ours.events
                    ),
                    *(
                        _swapped(e, measured, e.next_mode and _pair(ours.name, e.next_mode))
                        for e in theirs.events
                    ),
                ),
                signs={**ours.signs, **theirs.signs},
            )
            modes.append(_told(both))
    return tuple(modes)


def _told(mode: Mode) -> Mode:
    """The mode with the signs that it states in its equations.

    Without, a law that takes the sign of a velocity jumps where the plant's mode ends, and is there
    neither the one before the event nor the one after it.
    """
    known: dict[sp.Expr, sp.Expr] = {}
    for name, sign in mode.signs.items():
        state = symbol(name)
        known |= {sp.sign(state): sp.Integer(sign), sp.Abs(state): sign * state}

    def told(equations: Mapping[str, sp.Expr]) -> dict[str, sp.Expr]:
        return {n: sp.sympify(e).xreplace(known) for n, e in equations.items()}

    return replace(
        mode,
        derivatives=told(mode.derivatives),
        outputs=told(mode.outputs),
        events=tuple(
            replace(e, indicator=sp.sympify(e.indicator).xreplace(known), reset=told(e.reset))
            for e in mode.events
        ),
    )


def _pair(first: str, second: str) -> str:
    return "_".join(n for n in (first, second) if n)


def _rates(
    component: Component, mode: Mode, table: Mapping[sp.Symbol, sp.Expr]
) -> dict[str, sp.Expr]:
    common = zip(component.all_states, component.derivatives, strict=True)
    own = {s.name: mode.derivatives.get(s.name, derivative) for s, derivative in common}
    return {n: sp.sympify(e).xreplace(dict(table)) for n, e in own.items()}


def _swapped(event: Event, table: Mapping[sp.Symbol, sp.Expr], next_mode: str | None) -> Event:
    return replace(
        event,
        indicator=sp.sympify(event.indicator).xreplace(dict(table)),
        reset={n: sp.sympify(e).xreplace(dict(table)) for n, e in event.reset.items()},
        next_mode=next_mode,
    )


def _distinct(first: tuple[Output, ...], second: tuple[Output, ...]) -> tuple[Output, ...]:
    taken = {o.name for o in first}
    renamed = (replace(o, name=CONTROLLER + o.name) if o.name in taken else o for o in second)
    return (*first, *renamed)
