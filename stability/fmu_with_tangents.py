"""One variational FMU in a run with tangents: its states, and what is set and read."""

from __future__ import annotations

import ctypes as ct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from ..fmus.ports import (
    FRAME,
    TRACE,
    is_tangent_port,
    set_port,
    tangent_port,
    tangent_states,
)
from ..orchestration.fmu.fmu_instance import Instance
from ..orchestration.master.compiled import USES, Struct
from ..orchestration.master.fmi_calls import Bound

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Ports:
    """A FMU instance's ordinary ports, for wiring."""

    name: str
    inputs: Sequence[str]
    outputs: Sequence[str]


def ordinary(instance: Instance) -> Instance:
    states, _ = tangent_states(list(getattr(instance, "parameters", [])))

    def names(ports: Sequence[str]) -> list[str]:
        return [p for p in ports if not is_tangent_port(p, {*ports, *states})]

    ports = _Ports(instance.name, names(instance.inputs), names(instance.outputs))
    return cast("Instance", ports)


class Side:
    """One FMU with tangents: its states, and what is set and read.

    Parameters
    ----------
    instance : Instance
    """

    def __init__(self, instance: Instance) -> None:
        self.instance = instance
        parameters: list[str] = list(getattr(instance, "parameters", []))
        self.states, self.tangents = tangent_states(parameters)

    def bind(
        self,
        side: Struct,
        inputs: Sequence[str],
        moved: Sequence[str],
        outputs: Sequence[str],
        count: int,
    ) -> tuple[Bound, Bound]:
        """Fill its record; `moved` are its inputs that have tangents, which follow all inputs."""
        own = [tangent_port(s, k + 1) for k in range(count) for s in self.states]
        given, taken = (
            [tangent_port(n, k + 1) for k in range(count) for n in names]
            for names in (moved, outputs)
        )
        side.set(states=len(self.states))
        frame = [*map(set_port, own), FRAME] if own else []
        shown = [*own, TRACE] if own else []
        return (
            Bound(
                self.instance,
                [*inputs, *given],
                [*outputs, *taken],
                USES,
                side.part("calls"),
            ),
            Bound(self.instance, frame, shown, USES, side.part("frames")),
        )


def rows_at(address: int, rows: int, columns: int) -> Matrix:
    """The numbers at an address."""
    numbers = (ct.c_double * (rows * columns)).from_address(address)
    return np.ctypeslib.as_array(numbers).reshape(rows, columns)
