"""Connections of the set-point of an .ssp, from SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..fmus.system_reading import SystemConnection, SystemPort, SystemStructure
from ..fmus.units import Unit
from ..solver.set_point import set_point_orders
from .fmu_instance import FmuInstance
from .isolated import IsolatedInstance
from .port_units import from_si

Fmus = Mapping[str, FmuInstance | IsolatedInstance]
Goal = tuple[tuple[SystemConnection, int], ...]
"""Connections, and the order of the set-point's time derivative for each."""


def goal_of(system: SystemStructure, fmus: Fmus, rest: Sequence[str]) -> Goal:
    """Connections of the set-point: to the system's input, else to an input that nothing drives.

    With an input ``x_d`` also those of the derivatives, ``v_d`` and ``a_d``, as in a loop of two
    parts.
    """
    candidates: dict[str, tuple[SystemConnection, ...]] = {
        i.name: tuple(_from_si(c, i.defined, fmus) for c in i.drives)
        for i in system.inputs
        if i.drives and all(c.target.element in rest for c in i.drives)
    }
    if not candidates:
        driven = {c.target for c in system.connections}
        free = [SystemPort(e, p) for e in rest for p in fmus[e].inputs]
        candidates = {
            str(port): (
                _from_si(SystemConnection(SystemPort("", port.connector), port), None, fmus),
            )
            for port in free
            if port not in driven
        }
    called = [(n.rpartition(".")[2], drives) for n, drives in candidates.items()]
    orders = set_point_orders([n for n, _ in called])
    return tuple(
        (c, order)
        for name, order in orders.items()
        for n, drives in called
        if n == name
        for c in drives
    )


def _from_si(c: SystemConnection, unit: Unit | None, fmus: Fmus) -> SystemConnection:
    """A connection from the set-point in SI units, for a system's input in `unit`.

    An input without a unit has the unit of the port that it drives.
    """
    unit = unit or fmus[c.target.element].description.unit(c.target.connector)
    if unit is None or unit.exponents is None:
        return c
    factor, offset = from_si(unit)
    return replace(c, factor=c.factor * factor, offset=c.factor * offset + c.offset)
