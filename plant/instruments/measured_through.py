"""A controller that measures through instruments, as one component."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from ...solver.component import Component
from ...solver.errors import ContractError
from ...solver.interconnect import interconnect
from ...solver.signals import MEASURED
from .sample_and_hold import sampled


def measured_through(controller: Component, instruments: Sequence[Component]) -> Component:
    """The controller with measurements from instruments without modes.

    An instrument's output ``x_measured`` replaces ``x`` for the instruments after it in the list,
    and for the controller: a `velocity_estimate` after an encoder differentiates the output of the
    encoder. All sampled parts have one ``sample_time``. At a sample instant each part reads the new
    values of the parts before it, not the previous ones. The controller's parameters and states
    keep their names, those of instruments are ``<instrument>_<name>``.

    Raises `ContractError` if an instrument has modes, measures nothing that the parts after it use,
    or has another sampling period.
    """
    names = [i.name for i in instruments]
    inputs = {i.name: i for i in controller.inputs}
    connections: dict[str, str] = {}
    measured: dict[str, str] = {}
    for place, instrument in enumerate(instruments):
        _check(instrument, instruments[:place], [*instruments[place + 1 :], controller])
        for i in instrument.inputs:
            connections[f"{instrument.name}.{i.name}"] = measured.get(i.name, i.name)
            inputs.setdefault(i.name, replace(i, role="measurement"))
        for o in instrument.all_outputs:
            measured[o.name.removesuffix(MEASURED)] = f"{instrument.name}.{o.name}"
    return interconnect(
        {"": controller} | {i.name: i for i in reversed(instruments)},
        connections | {f".{i.name}": measured.get(i.name, i.name) for i in controller.inputs},
        tuple(inputs.values()),
        {o.name: f".{o.name}" for o in controller.all_outputs},
        "_".join([controller.name, "behind", *names]),
        f"{controller.description}; measured through {', '.join(names)}",
    )


def in_practice(law: Component, is_sampled: bool, instruments: Iterable[Component]) -> Component:
    """The controller, sampled if requested, with instruments, which are sampled with it."""
    if is_sampled:
        if not {"measurement", "reference"} & {i.role for i in law.inputs}:
            raise ContractError(
                f"{law.name} cannot be sampled: none of its inputs has the role measurement "
                "or reference, as those of a controller have"
            )
        law = sampled(law)
    parts = [*instruments]
    for k, (part, own) in enumerate((p, p.sample_time) for p in parts):
        if own and law.sample_time:
            parts[k] = replace(part, sample_time=replace(own, default=law.sample_time.default))
    return measured_through(law, parts) if parts else law


def instruments_for(
    controller: Component, listed: Iterable[Component]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The first instrument of a list for each signal measured, and the signals without one."""
    used = {str(s) for s in controller.used_symbols()}
    roles = "measurement", "signal"
    measured = [i.name for i in controller.inputs if i.role in roles and i.name in used]
    made = {instrument.name: instrument for instrument in listed}
    outputs = [(o.name, name) for name, instrument in made.items() for o in instrument.outputs]
    first = {output.removesuffix(MEASURED): name for output, name in reversed(outputs)}
    wanted, instruments = {*measured}, list[str]()
    for name in reversed(made):  # an instrument may use the output of the one before it
        if name in map(first.get, wanted):
            instruments.insert(0, name)
            wanted |= {i.name for i in made[name].inputs}
    if not instruments:
        there = ", ".join(output for output, _ in outputs)
        raise ContractError(
            f"{controller.name} measures {', '.join(measured) or 'nothing'}, but the instruments "
            f"measure {there}"
        )
    return tuple(instruments), tuple(name for name in measured if name not in first)


def _check(instrument: Component, before: Sequence[Component], behind: Sequence[Component]) -> None:
    """Check that a component is an instrument, and that a part after it uses its output."""
    if instrument.name in [i.name for i in before]:
        raise ContractError(f"{instrument.name} is given twice; expected each instrument once")
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
