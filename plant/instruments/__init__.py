"""Instruments, each a separate component and FMU.

Those of the rig (Section 2.2 and Table 2.1) have their noise as an input, so that a seed outside
determines it; if the thesis gives no value, the parameter's source says what was assumed. The
instruments in `INSTRUMENTS` can be connected between any plant and controller: their input has the
name of the plant's signal, their output that name with `solver.signals.MEASURED` added.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ...solver.errors import ContractError

if TYPE_CHECKING:
    from ...solver.component import Component

UNLIMITED = 1e6
NOMINAL_VOLTAGE = 36.0  # of the axis' amplifier, Table 2.1 [V]
LIMIT = "voltage_limit"  # the plant's parameter, for any unit of its command
AMPLIFIER = "current_limit"  # a plant that has it is driven by volts, through an amplifier
OWN_LIMIT = "u_max"  # parameters of a controller for the limit of the nominal amplifier, in volts

INSTRUMENTS = {
    "position_encoder": "ballscrew.plant.instruments.encoder:position_encoder",
    "velocity_estimate": "ballscrew.plant.instruments.velocity_estimate:velocity_estimate",
    "current_sensor": "ballscrew.plant.instruments.current_sensor:current_sensor",
}
"""The instruments that are exported by name. To add one, add a file and a line here."""
SAMPLED = "sampled"
"""Suffix of a controller's name: it reads at sample instants and holds its commands."""
FEED_FORWARD = "feed_forward"
"""Suffix of a controller's name: it uses the derivatives of the set-point."""
UNITS = {
    "rotary": {"m": "rad", "N": "N*m", "kg": "kg*m^2"},
    "current": {"V": "A"},
    "force": {"V": "N"},
    "torque": {"V": "N*m"},
}
"""Suffix of the name of a drive or a controller: other names for the units of its equations."""


@dataclass(frozen=True)
class PartName:
    """The pieces of a part's name ``law+feed_forward+sampled+instrument+...+rotary+torque``."""

    bare: str  # a name of the catalogue, a file's function or a path
    feed_forward: bool = False
    sampled: bool = False
    instruments: tuple[str, ...] = ()  # in the order of the signals
    units: tuple[str, ...] = ()  # from `UNITS`

    @classmethod
    def of(cls, name: str) -> PartName:
        """The pieces; what has no other meaning is the bare part, which is never empty."""
        left = name.split("+")

        def taken(known: Container[str], most: int) -> tuple[str, ...]:
            last: list[str] = []
            while len(left) > 1 and len(last) < most and left[-1] in known:
                last.insert(0, left.pop())
            return (*last,)

        units, instruments = taken(UNITS, len(left)), taken(INSTRUMENTS, len(left))
        sampled, forward = bool(taken((SAMPLED,), 1)), bool(taken((FEED_FORWARD,), 1))
        return cls("+".join(left), forward, sampled, instruments, units)

    @property
    def plain(self) -> str:
        """The name without units."""
        return str(replace(self, units=()))

    def __str__(self) -> str:
        suffixes = [FEED_FORWARD] * self.feed_forward + [SAMPLED] * self.sampled
        return "+".join([self.bare, *suffixes, *self.instruments, *self.units])


def in_units(part: Component, units: Sequence[str]) -> Component:
    """A part in the units of a drive; a part with values of a motor has no other command."""
    words = {own: other for name in units for own, other in UNITS[name].items()}
    of_motor = [p.name for p in part.all_parameters if re.search(r"\b(A|ohm|H)\b", p.unit)]
    if of_motor and "V" in words:
        raise ContractError(
            f"{part.name} is made for the voltage of a motor, see its {of_motor[0]}, but the "
            f"command of the drive is a {units[-1]}; expected a part without such values"
        )
    made = part.in_units(words)
    if "V" not in words or all(p.name != OWN_LIMIT for p in made.all_parameters):
        return made
    return made.with_defaults({OWN_LIMIT: UNLIMITED}, "none: the limit of the machine is not known")


def limit_of(known: Container[str], values: Mapping[str, float], asked: float | None) -> float:
    """Largest command: the requested one, else that of the values, else the nominal amplifier's."""
    if asked is not None:
        return asked
    given = values.get(LIMIT, UNLIMITED)
    return NOMINAL_VOLTAGE if given >= UNLIMITED and AMPLIFIER in known else given
