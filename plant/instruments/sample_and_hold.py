"""A sampled continuous law: it reads at sample instants and holds its commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import sympy as sp

from ...solver.component import Component, DiscreteState, Input, Mode, Output, Parameter, symbol
from ...solver.errors import ContractError

PERIOD = Parameter("sample_time", 1e-3, "s", "sampling period", "a common servo rate", minimum=1e-6)


def sampled(controller: Component, period: Parameter = PERIOD, delay: int = 0) -> Component:
    """The controller with samplers at its inputs and holds at its outputs.

    It is called ``<name>_sampled``. At a sample instant measurements and set-points are read, and
    the commands computed from them and from the controller's states are held until the next
    instant; with a `delay` they are output that many samples later, and zero before (for a fraction
    of a sample use `with_late_command`). The states are not discretized by a rule: between samples
    they follow their own equations with the sampled inputs, to the solver's tolerance.

    Modes that change only outputs, as in a relay, are checked at the same instants: one event may
    happen at each, before the command is computed.

    Raises `ContractError` for a controller that is already sampled or has modes that change more
    than outputs, or a delay that is not a count.
    """
    if controller.discrete:
        raise ContractError(
            f"{controller.name} has discrete states; only a continuous law can be sampled"
        )
    if delay < 0 or delay != int(delay):
        raise ContractError(f"a delay of {delay} samples, expected 0, 1, 2, ...")
    values, looked_at = _by_mode(controller)
    used = controller.used_symbols()
    read = [i for i in controller.inputs if symbol(i.name) in used]
    held = {symbol(i.name): symbol(f"{i.name}_read") for i in read}
    fields = controller.equations_with(held)
    outputs = [replace(o, value=values[o.name]) for o in controller.all_outputs]
    kept = [state for o in outputs for state in _held(o, int(delay))]
    return replace(
        controller,
        name=f"{controller.name}_sampled",
        description=f"{controller.description}; sampled, its output held between samples",
        states=fields["states"],
        balances=fields["balances"],
        discrete=(*(_read(i) for i in read), *looked_at, *kept),
        outputs=tuple(replace(o, value=symbol(f"{o.name}_held")) for o in controller.outputs),
        sample_time=period,
        modes=(),
    )


def _by_mode(controller: Component) -> tuple[dict[str, sp.Expr], tuple[DiscreteState, ...]]:
    """Each output after the event that is due, and the mode as a discrete state."""
    modes = controller.modes
    if not modes:
        return {o.name: sp.sympify(o.value) for o in controller.all_outputs}, ()
    events = [e for m in modes for e in m.events]
    if any(m.derivatives for m in modes) or any(e.reset or not e.direction for e in events):
        raise ContractError(
            f"{controller.name} has modes that change more than outputs; it cannot be sampled"
        )
    names = [m.name for m in modes]

    def after(value: Callable[[Mode], sp.Expr]) -> sp.Expr:
        """Expressions that depend on the mode, after the first of its events that is due."""
        pieces = []
        for number, mode in enumerate(modes):
            chosen = value(mode)
            for event in reversed(mode.events):
                target = modes[names.index(event.next_mode or mode.name)]
                due = event.direction * event.indicator > 0
                chosen = sp.Piecewise((value(target), due), (chosen, True))
            pieces.append((chosen, symbol("mode") < number + sp.Rational(1, 2)))
        return sp.Piecewise(*pieces[:-1], (pieces[-1][0], True))

    outputs = {
        o.name: after(lambda m, o=o: sp.sympify(m.outputs.get(o.name, o.value)))  # type: ignore[misc]
        for o in controller.all_outputs
    }
    number = after(lambda m: sp.Integer(names.index(m.name)))
    return outputs, (DiscreteState("mode", "1", "number of the mode", number),)


def _read(i: Input) -> DiscreteState:
    meaning = f"{i.meaning}, at the last sample"
    return DiscreteState(f"{i.name}_read", i.unit, meaning, symbol(i.name), i.start, i.nominal)


def _held(output: Output, delay: int) -> tuple[DiscreteState, ...]:
    """Discrete states for commands delayed by `delay` samples, and for the output command."""
    names = [*(f"{output.name}_waiting{k}" for k in range(1, delay + 1)), f"{output.name}_held"]
    values = [sp.sympify(output.value), *map(symbol, names)]
    meanings = [*("computed, not put out yet" for _ in range(delay)), "since the last sample"]
    return tuple(
        DiscreteState(n, output.unit, f"{output.meaning}, {m}", v, nominal=output.nominal)
        for n, m, v in zip(names, meanings, values, strict=False)
    )
