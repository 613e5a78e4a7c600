"""Connect two components into one: the whole closed loop as one system of equations."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from .component import Component, ContractError, Output, symbol

PLANT, CONTROLLER = "plant_", "controller_"


def connect(plant: Component, controller: Component) -> Component:
    """The closed loop of a plant and a controller.

    Signals meet by name: the controller's measurements take the plant's outputs, the plant's
    inputs take the controller's outputs. Parameters and states are prefixed with ``plant_`` and
    ``controller_``; outputs keep their names, the plant's first.

    Raises
    ------
    ContractError
        If a signal is missing, or both sides depend directly on each other.
    """
    p, c = plant.prefixed(PLANT), controller.prefixed(CONTROLLER)
    if any(m.outputs for m in p.modes) and any(
        i.name in m.outputs for i in c.inputs for m in p.modes
    ):
        raise ContractError(
            f"{plant.name}: a measured output that differs between modes cannot be connected yet"
        )
    if c.modes:
        raise ContractError(
            f"{controller.name} has modes and cannot be connected in one solver yet"
        )
    measured = {}
    for signal in (i for i in c.inputs if i.role != "reference"):
        value = p.output(signal.name).value
        if {symbol(i.name) for i in p.inputs} & value.free_symbols:
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
    ours = p.equations_with({symbol(i.name): commands[i.name] for i in p.inputs})
    return Component(
        name=f"{plant.name}_with_{controller.name}",
        description=f"Closed loop: {plant.description}; {controller.description}",
        parameters=p.parameters + c.parameters,
        inputs=tuple(i for i in c.inputs if i.role == "reference"),
        states=ours["states"] + theirs["states"],
        outputs=_distinct(ours["outputs"], theirs["outputs"]),
        balances=ours["balances"] + theirs["balances"],
        discrete=ours["discrete"] + theirs["discrete"],
        sample_time=c.sample_time or p.sample_time,
        modes=ours["modes"],
    )


def _distinct(first: tuple[Output, ...], second: tuple[Output, ...]) -> tuple[Output, ...]:
    taken = {o.name for o in first}
    renamed = (replace(o, name=CONTROLLER + o.name) if o.name in taken else o for o in second)
    return (*first, *renamed)
