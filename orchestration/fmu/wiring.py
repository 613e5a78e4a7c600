"""Connections: ports matched by name, or as mapped by the user."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from ...fmus.ports import gain_port, law_ports, rate_port, reference_port
from ...solver.errors import CouplingError, nearest
from ...solver.set_point import DERIVATIVES, SET_POINT, set_point_orders
from .fmu_instance import AnyFmu, Instance

PLANT, CONTROLLER = "plant", "controller"
POSITION = "x"  # the output that a set-point is compared with
COLUMNS = ("time", SET_POINT)  # of the results, in addition to the plant's


@dataclass(frozen=True)
class Wiring:
    """The connections of a loop."""

    commands: tuple[tuple[str, str], ...]  # controller output, plant input
    signals: tuple[tuple[str, str], ...]  # plant output, controller input
    # inputs that take the set-point: the one called ``x_d``, else the only one that nothing drives;
    # with ``x_d`` also those that take its derivatives, ``v_d`` and ``a_d``
    references: tuple[str, ...]
    accepts_law: bool  # whether the plant has the law's inputs
    reports_law: bool  # whether the controller has its outputs
    # inputs of the controller that nothing drives: they stay at their start or given values
    unconnected: tuple[str, ...] = ()
    orders: tuple[int, ...] = ()  # of the time derivative of each of `references`
    of_plant: tuple[str, ...] = ()  # as `unconnected`
    others: tuple[str, ...] = ()  # further outputs of the controller that are recorded
    # whether parts feed each other within a side: their signals and outputs are judged, too
    network: bool = False

    def __post_init__(self) -> None:
        if not self.orders:
            object.__setattr__(self, "orders", (0,) * len(self.references))

    @property
    def is_empty(self) -> bool:
        """Whether no signal is connected in either direction."""
        return not self.commands and not self.signals

    def check_given(
        self, plant_values: Collection[str], controller_values: Collection[str]
    ) -> None:
        """Make sure that no input is given a value that a connection drives.

        Raises
        ------
        CouplingError
        """
        of_plant = {port for _, port in self.commands}
        of_controller = {*(port for _, port in self.signals), *self.references}
        for side, driven, given in (
            (PLANT, of_plant, plant_values),
            (CONTROLLER, of_controller, controller_values),
        ):
            for name in sorted(driven.intersection(given)):
                raise CouplingError(
                    f"{side}.{name} is an input that is connected in the loop; expected a "
                    "parameter or an input that is not connected"
                )

    def plant_law(self) -> list[str]:
        """The plant's inputs except the commands, in the order in which a law is written.

        Gains, one row for each command, references likewise, and rates.
        """
        commands, signals = [c for _, c in self.commands], [s for s, _ in self.signals]
        gains = [gain_port(c, s) for c in commands for s in signals]
        references = [reference_port(c, s) for c in commands for s in signals]
        return [*gains, *references, *map(rate_port, commands)]

    def controller_law(self) -> list[str]:
        """The controller's outputs except the commands, in the order in which a law is read.

        Gains, one row for each command, and rates.
        """
        commands, signals = [c for c, _ in self.commands], [s for _, s in self.signals]
        return [*(gain_port(c, s) for c in commands for s in signals), *map(rate_port, commands)]


UNWIRED = Wiring((), (), (), accepts_law=False, reports_law=False)
"""Stands for connections that are still to be found, by `wire`."""


def wire(plant: Instance, controller: Instance, mapping: Mapping[str, str] | None = None) -> Wiring:
    """Match the ports of a plant and a controller.

    Parameters
    ----------
    mapping : mapping of str to str, optional
        ``theirs -> ours``: a third-party FMU's ports to their partners on the other side.
        ``plant.theirs`` and ``controller.theirs`` are for one side only.

    Raises
    ------
    CouplingError
        If every command of the plant or every measurement of the controller stays unmatched, a
        name of the mapping is no port, two ports would have one name, or the set-point is not
        given.
    """
    mapping = dict(mapping or {})
    _check_mapping(plant, controller, mapping)
    on_plant = names_on(PLANT, [*plant.outputs, *plant.inputs], mapping)
    on_controller = names_on(CONTROLLER, [*controller.inputs, *controller.outputs], mapping)
    plant_outputs = {on_plant[n]: n for n in plant.outputs}
    law = law_ports(plant.inputs, plant.inputs, plant.outputs)
    needed = {on_plant[n]: n for n in plant.inputs if n not in law}
    commands = tuple(
        (n, needed[on_controller[n]]) for n in controller.outputs if on_controller[n] in needed
    )
    # beside x_d these are the set-point's, also if the plant has such outputs, except if mapped
    named = set_point_orders([on_controller[n] for n in controller.inputs])
    own = [n for n, order in named.items() if order]
    signals = tuple(
        (plant_outputs[on_controller[n]], n)
        for n in controller.inputs
        if on_controller[n] in plant_outputs and (n not in own or on_controller[n] != n)
    )
    driven = {theirs for _, theirs in commands}
    missing = [n for n in needed.values() if n not in driven]
    if missing and not commands:
        raise CouplingError(
            f"nothing is connected to the input {missing[0]!r} of {plant.name}: {controller.name} "
            "has the "
            f"outputs {', '.join(controller.outputs) or 'none'}"
            f"{nearest(missing[0], controller.outputs)}; use --map theirs=ours"
        )
    if not signals and (controller.inputs or controller.outputs):
        raise CouplingError(
            f"{controller.name} has no input that fits an output of {plant.name}: its inputs are "
            f"{', '.join(controller.inputs) or 'none'}, the plant's outputs are "
            f"{', '.join(plant.outputs)}; use --map theirs=ours"
        )
    connected = {theirs for _, theirs in signals}
    free = {on_controller[n]: n for n in controller.inputs if n not in connected}
    taken = set_point_orders([*free])
    if free and not taken:
        raise CouplingError(
            f"{controller.name} has the inputs {', '.join(free.values())} that are not connected "
            f"to {plant.name}; give the set-point, such as --map {min(free.values())}={SET_POINT}"
        )
    references, orders = tuple(free[n] for n in taken), tuple(taken.values())
    unconnected = tuple(n for n in free.values() if n not in references)
    acting = {c for c, _ in commands}
    others = tuple(n for n in plain_outputs(controller) if n not in acting)
    wiring = Wiring(
        commands, signals, references, False, False, unconnected, orders, tuple(missing), others
    )
    return replace(
        wiring,
        accepts_law=bool(commands) and set(wiring.plant_law()) <= set(plant.inputs),
        reports_law=set(wiring.controller_law()) <= set(controller.outputs),
    )


def with_aliases(plant: AnyFmu, controller: AnyFmu, mapping: Mapping[str, str]) -> dict[str, str]:
    """The mapping by the ports' own names, and with the aliases that have a partner (FMI 3.0)."""
    found = dict(mapping)
    for side, fmu, other in ((PLANT, plant, controller), (CONTROLLER, controller, plant)):
        theirs = {*other.inputs, *other.outputs}
        known = {*theirs, *other.description.aliases, POSITION, SET_POINT, *DERIVATIVES}
        for alias, port in fmu.description.aliases.items():
            if port not in (*fmu.inputs, *fmu.outputs):
                continue
            own, bare = f"{side}.{port}", alias not in theirs
            for key in (f"{side}.{alias}", *([alias] if bare else [])):
                if key in found:
                    found[own] = found.pop(key)
            if {port, own} & {*found, *theirs} or (side == PLANT and alias in COLUMNS):
                continue
            if alias in known:
                found[own] = alias
    return found


def plain_outputs(instance: Instance) -> list[str]:
    """Outputs except those of a feedback law."""
    law = law_ports(instance.outputs, instance.outputs, instance.inputs)
    return [n for n in instance.outputs if n not in law]


def names_on(side: str, ports: Collection[str], mapping: Mapping[str, str]) -> dict[str, str]:
    """Names of a side's ports here; the plant's are never those of a column of the results."""
    called = {n: mapping.get(f"{side}.{n}", mapping.get(n, n)) for n in ports}
    if side == PLANT:
        called |= {n: f"{PLANT}.{n}" for n in ports if called[n] == n and n in COLUMNS}
    return called


def _check_mapping(plant: Instance, controller: Instance, mapping: Mapping[str, str]) -> None:
    """Make sure that every name is a port, and that no port takes the name of another."""
    ports = {
        PLANT: [*plant.outputs, *plant.inputs],
        CONTROLLER: [*controller.inputs, *controller.outputs],
    }
    for theirs in mapping:
        side, _, own = theirs.partition(".")
        if theirs in ports[PLANT] or theirs in ports[CONTROLLER]:
            continue
        if side not in ports:
            everything = {*ports[PLANT], *ports[CONTROLLER]}
            raise CouplingError(
                f"--map: neither side has a port {theirs!r}{nearest(theirs, everything)}"
            )
        if own not in ports[side]:
            raise CouplingError(f"--map: {side} has no port {own!r}{nearest(own, ports[side])}")
    for side, group, taken in (
        (PLANT, ports[PLANT], COLUMNS),
        (CONTROLLER, controller.inputs, ()),
        (CONTROLLER, controller.outputs, ()),
    ):
        called = names_on(side, group, mapping)
        for theirs, ours in called.items():
            if ours == theirs:
                continue
            others = [n for n, name in called.items() if name == ours and n != theirs]
            if others or ours in taken:
                whose = f"{side}'s port {others[0]!r}" if others else "a column of the results"
                raise CouplingError(
                    f"--map {theirs}={ours} has the same name as {whose}; map "
                    "one of them to an unused name"
                )
