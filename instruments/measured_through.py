"""A controller that measures through instruments, as one component."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import sympy as sp

from ..solver.component import Component, ContractError, Parameter, symbol
from . import MEASURED


def measured_through(controller: Component, instruments: Sequence[Component]) -> Component:
    """The controller with measurements as instruments give them.

    An instrument's output ``x_measured`` takes the place of ``x`` for the instruments behind it in
    the list, and for the controller: an encoder before a `velocity_estimate` is what that
    differentiates. All that is sampled has one ``sample_time``. At a sample instant each part sees
    what those before it give at that instant, not at the one before.

    Parameters
    ----------
    controller : Component
        Its parameters and states keep their names.
    instruments : sequence of Component
        Without modes. Their parameters and states are named ``<instrument>_<name>``.

    Raises
    ------
    ContractError
        If an instrument has modes, measures nothing that the parts behind it take, or samples at
        another period.
    """
    period = _common_period([controller, *instruments])
    now: dict[sp.Basic, sp.Expr] = {}  # measured signals,
    at_sample: dict[sp.Basic, sp.Expr] = {}  # and what they are when all before them have sampled
    inputs = {i.name: i for i in controller.inputs}
    parts = []
    for place, instrument in enumerate(instruments):
        _check(instrument, [*instruments[place + 1 :], controller])
        part = instrument.prefixed(f"{instrument.name}_")
        clock: dict[sp.Basic, sp.Expr] = {}
        if part.sample_time and period:
            clock[symbol(part.sample_time.name)] = symbol(period.name)
        fields = part.equations_with({**now, **clock})
        then = part.equations_with({**at_sample, **clock})
        fields["discrete"] = then["discrete"]
        updates = {symbol(d.name): d.update for d in then["discrete"]}
        for value, later in zip(fields["outputs"], then["outputs"], strict=True):
            signal = symbol(value.name.removesuffix(MEASURED))
            now[signal] = value.value
            at_sample[signal] = sp.sympify(later.value).xreplace(updates)
        for i in instrument.inputs:
            inputs.setdefault(i.name, replace(i, role="measurement"))
        parts.append(fields | {"parameters": part.parameters})
    fields = controller.equations_with(now)
    fields["discrete"] = controller.equations_with(at_sample)["discrete"]
    parts.append(fields | {"parameters": controller.parameters})

    def joined(kind: str) -> tuple[Any, ...]:
        return tuple(entry for part in reversed(parts) for entry in part[kind])

    names = [i.name for i in instruments]
    return replace(
        controller,
        name="_".join([controller.name, "behind", *names]),
        description=f"{controller.description}; measured through {', '.join(names)}",
        inputs=tuple(inputs.values()),
        outputs=fields["outputs"],
        modes=fields["modes"],
        sample_time=period,
        **{k: joined(k) for k in ("parameters", "states", "discrete", "delays", "balances")},
    )


def _common_period(parts: Sequence[Component]) -> Parameter | None:
    """The sampling period of the first that is sampled; None if none is."""
    sampled = [(p.name, p.sample_time) for p in parts if p.sample_time]
    for name, period in sampled:
        first, common = sampled[0]
        if period.default != common.default:
            raise ContractError(
                f"{first} samples every {common.default:g} s and {name} every "
                f"{period.default:g} s; expected one period"
            )
    return sampled[0][1] if sampled else None


def _check(instrument: Component, behind: Sequence[Component]) -> None:
    """Make sure that an instrument is one, and that something behind it takes what it gives."""
    if instrument.modes:
        raise ContractError(f"{instrument.name} has modes; expected an instrument without")
    for output in instrument.all_outputs:
        signal = output.name.removesuffix(MEASURED)
        if signal == output.name:
            raise ContractError(
                f"{instrument.name}: output {output.name!r} does not say what it measures; "
                f"expected the name of a signal and {MEASURED!r}"
            )
        if not any(i.name == signal for part in behind for i in part.inputs):
            names = ", ".join(p.name for p in behind)
            raise ContractError(
                f"{instrument.name} measures {signal!r}, which none of {names} takes"
            )
