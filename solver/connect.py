"""Connect a plant and a controller by signal name: the whole closed loop."""

from __future__ import annotations

from dataclasses import replace

from .component import Component, symbol
from .errors import ContractError
from .interconnect import interconnect
from .kernel import CONTROLLER, PLANT
from .set_point import REFERENCES, set_point_orders


def connect(plant: Component, controller: Component) -> Component:
    """The closed loop of a plant and a controller as one component.

    Signals are connected by name: the plant's outputs to the controller's measurements, the
    controller's outputs to the plant's inputs.

    Parameters
    ----------
    plant, controller : Component
        A measurement that the controller does not use may be missing.

    Returns
    -------
    Component
        Its parameters and states are called ``plant_...`` and ``controller_...``; outputs keep
        their names, the plant's first.

    Raises
    ------
    ContractError
        If a signal is missing, or both sides depend directly on each other.

    Examples
    --------
    >>> import ballscrew
    >>> loop = ballscrew.connect(ballscrew.component("plant"), ballscrew.component("iol"))
    >>> [i.name for i in loop.inputs if i.role == "reference"]
    ['x_d']
    """
    seen = [o.name for o in plant.all_outputs]
    commands = [o.name for o in controller.all_outputs]
    references = tuple(i for i in controller.inputs if i.role in REFERENCES)
    if references and not set_point_orders([i.name for i in references]):
        names = ", ".join(i.name for i in references)
        raise ContractError(
            f"{controller.name} has the inputs {names} for the set-point; expected one, or x_d "
            "with v_d and a_d for its derivatives"
        )
    connections = {f"controller.{i.name}": i.name for i in references}
    used = controller.used_symbols()
    for i in controller.inputs:
        if i in references or symbol(i.name) not in used:
            continue
        if i.name not in seen:
            raise ContractError(
                f"{plant.name} has no output {i.name!r}, {controller.name} measures it; "
                f"it has {', '.join(seen) or 'none'}"
            )
        connections[f"controller.{i.name}"] = f"plant.{i.name}"
    for i in plant.inputs:
        if i.name not in commands:
            raise ContractError(
                f"{controller.name} has no output {i.name!r}, {plant.name} needs it"
            )
        connections[f"plant.{i.name}"] = f"controller.{i.name}"
    parts = {"plant": plant, "controller": controller}
    shown = [(n, o.name) for n, part in parts.items() for o in part.outputs]
    shown += [(n, o.name) for n, part in parts.items() for t in part.terms for o in t.outputs]
    loop = interconnect(
        parts,
        connections,
        references,
        {
            (
                CONTROLLER + signal if n == "controller" and signal in seen else signal
            ): f"{n}.{signal}"
            for n, signal in shown
        },
        f"{plant.name}_with_{controller.name}",
        f"Closed loop: {plant.description}; {controller.description}",
    )
    if not (period := loop.sample_time):
        return loop
    name = (CONTROLLER if controller.sample_time else PLANT) + period.name
    return loop.substituted(
        {symbol(period.name): symbol(name)}, sample_time=replace(period, name=name)
    )
