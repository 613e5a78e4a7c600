"""The rig's sampled parts as one component: what they do at one sample instant, in their order.

A part that stands after another takes that one's new values, as it does when both run as FMUs one
after the other.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..instruments.sampling_period import sampling_period
from ..solver.component import (
    Component,
    ContractError,
    DiscreteState,
    Input,
    Output,
    Parameter,
    symbol,
)
from .rig_wiring import COMMAND, PLANT, Wiring


def program(wiring: Wiring, name: str) -> Component:
    """Compose the parts of a wiring.

    Parameters and discrete states are named ``part_name``; the parts share one ``sample_time``.
    Inputs are the plant's outputs as ``plant_name`` and what comes from outside under its own name;
    outputs are the wiring's taps, under theirs, and the command `u`.

    Raises
    ------
    ContractError
        If a feed names what is not there, or not there yet.
    """
    inputs: dict[str, Input] = {}
    now: dict[str, sp.Expr] = {}  # signals in terms of the values before the instant
    held: dict[str, sp.Expr] = {}  # and in terms of those after it
    discrete: list[DiscreteState] = []
    parameters: list[Parameter] = []
    period = sampling_period()

    def signal(source: str, table: dict[str, sp.Expr], port: Input) -> sp.Expr:
        owner, dot, name = source.rpartition(".")
        if dot and owner != PLANT:
            if source not in table:
                raise ContractError(f"{port.name} takes {source!r}, which no part before it gives")
            return table[source]
        name = f"{PLANT}_{name}" if dot else name
        inputs.setdefault(name, replace(port, name=name))
        return symbol(name)

    for part in wiring.parts:
        # The period is the program's, not the part's own.
        component = part.make()
        prefixed = component.prefixed(f"{part.name}_")
        own = {symbol(f"{part.name}_sample_time"): symbol(period.name)}
        feeds_now, feeds_held = dict(own), dict(own)
        for port in component.inputs:
            feeds_now[symbol(port.name)] = signal(part.feeds[port.name], now, port)
            feeds_held[symbol(port.name)] = signal(part.feeds[port.name], held, port)
        updated = prefixed.equations_with(feeds_now)
        updates = {symbol(d.name): d.update for d in updated["discrete"]}
        discrete += updated["discrete"]
        parameters += prefixed.parameters
        for output in component.outputs:
            value = prefixed.output(output.name).value
            at = f"{part.name}.{output.name}"
            # both replacements at once: updates hold the values before the instant already
            now[at] = sp.sympify(value).xreplace({**feeds_now, **updates})
            held[at] = sp.sympify(value).xreplace(feeds_held)
    outputs = [_tap(column, source, held, wiring) for column, source in wiring.taps.items()]
    if "." in wiring.command:
        outputs.append(_tap(COMMAND, wiring.command, held, wiring))
    return Component(
        name=name,
        description="The rig's instruments and controller as one program",
        parameters=tuple(parameters),
        inputs=tuple(inputs.values()),
        outputs=tuple(outputs),
        discrete=tuple(discrete),
        sample_time=period,
    )


def _tap(column: str, source: str, held: dict[str, sp.Expr], wiring: Wiring) -> Output:
    owner, _, port = source.rpartition(".")
    part = next((p for p in wiring.parts if p.name == owner), None)
    if part is None or source not in held:
        raise ContractError(f"{column} takes {source!r}, which no part gives")
    return replace(part.make().output(port), name=column, value=held[source])
