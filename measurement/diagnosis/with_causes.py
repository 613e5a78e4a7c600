"""The plant with the causes of a diagnosis, as an ordinary component."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import sympy as sp

from ...plant.classical import with_sticking
from ...plant.direct_drive import with_command_limit
from ...plant.instruments.amplifier import with_amplifier
from ...plant.rotary_drive import turned
from ...solver.component import Component, symbol
from ...solver.errors import ContractError
from ..identification.fitted_law import LAWS
from .causes import CAUSES
from .causes.presliding_hysteresis import NAME as BRISTLES
from .causes.presliding_hysteresis import bristled
from .drive import Drive, curve_of

PRIOR = "prior value, adjusted to measured data"
FOUND = "found in measured data"

_Number = TypeVar("_Number")

# Order of causes: first forces, while there is one body that cannot stick; then joints that divide
# the body; then sticking; last, causes between the command and the force.
PARTING = ("compliance", "backlash")
_BEFORE_THE_FORCE = ("resistance_drift", "voltage_saturation", "input_delay")


def with_causes(drive: Drive, found: Sequence[tuple[str, Mapping[str, float]]]) -> Component:
    """The plant of a drive with the causes that were found in it.

    Parameters
    ----------
    drive : Drive
    found : sequence of (cause, values)
        Names of `CAUSES` with their values, SI. If each record has its own value, such as
        ``friction_cos.1`` and ``friction_cos.2``, that of the last record is used.

    Returns
    -------
    Component
        Its parameters' defaults are the drive's and the found values; their `source` says which.

    Raises
    ------
    ContractError
        If a cause is unknown or not possible in this plant.
    ContractError
        If a ball screw without a rotor is to get a spring or a gap.
    ContractError
        If the plant has no parameter of this name, or a value is outside its range.
    """
    own = {name: last_record(numbers) for name, numbers in found}
    for name in own:
        if name not in CAUSES:
            raise ContractError(f"no cause {name!r}; there are {', '.join(CAUSES)}")
        because = CAUSES[name].beyond((), drive)
        if because:
            raise ContractError(f"{name}: {because}")
    values = {n: v for numbers in own.values() for n, v in numbers.items()}
    drive = with_law_of(drive, own)
    if BRISTLES in own:
        values.pop("damping_ratio", None)
        values["sigma1"] = drive.values["sigma1"]
    plant = replace(drive.plant, name="extended_plant").with_defaults(drive.values, PRIOR)
    curve = curve_of(drive.law)
    first = [n for n in own if n not in (*PARTING, *_BEFORE_THE_FORCE)]
    for name in (*first, *(n for n in PARTING if n in own)):
        plant = CAUSES[name].extend(plant, curve, own[name])
    if LAWS[drive.law].rigid:
        plant = _able_to_stick(plant)
    plant = with_amplifier(plant) if drive.has_motor else with_command_limit(plant)
    for name in (n for n in _BEFORE_THE_FORCE if n in own):
        plant = CAUSES[name].extend(plant, curve, own[name])
    return plant.with_defaults(values, FOUND)


def as_it_moves(plant: Component, drive: Drive) -> Component:
    """The plant of a drive; for a rotating body, converted from m and N to rad and N*m."""
    return turned(plant) if drive.turns else plant


def with_law_of(drive: Drive, found: Mapping[str, Mapping[str, float]]) -> Drive:
    """The drive with its law changed by the causes: bristles are a separate law."""
    if BRISTLES not in found:
        return drive
    numbers = found[BRISTLES]
    return bristled(drive, numbers["sigma0"], numbers.get("damping_ratio", 1.0))


def last_record(values: Mapping[str, _Number]) -> dict[str, _Number]:
    """The values without record numbers in their names; the last record's, if each has its own."""

    def number(key: str) -> int:
        return int(key.partition(".")[2] or 0)

    return {key.partition(".")[0]: values[key] for key in sorted(values, key=number)}


def _able_to_stick(plant: Component) -> Component:
    """The plant with the modes of the classical law, with its other forces by direction, too.

    A cause that is a share of friction contains the sign of the velocity. In sliding, this is the
    sign of the mode, and the body breaks away if it would be accelerated.
    """
    moving = "vb" if "vb" in [s.name for s in plant.states] else "v"
    place = {"v": "x", "vb": "xb"}[moving]
    plant = with_sticking(plant, moving, place)
    inertia = next(b.inertia for b in plant.balances if b.state == moving)
    v = symbol(moving)
    friction = plant.output("friction").value
    stuck, *sliding = plant.modes
    ways = []
    away = {}
    for mode, direction in zip(sliding, (1, -1), strict=True):
        table = {sp.sign(v): sp.Integer(direction), sp.Abs(v): direction * v}
        rate = plant.derivative(moving).xreplace(table)
        outputs = {**mode.outputs, "friction": friction.xreplace(table)}
        ways.append(replace(mode, derivatives={**mode.derivatives, moving: rate}, outputs=outputs))
        away[mode.name] = inertia * rate.xreplace({v: sp.Integer(0)})
    events = tuple(
        replace(e, indicator=away[str(e.next_mode)]) if e.name.startswith("breaks away") else e
        for e in stuck.events
    )
    return replace(plant, modes=(replace(stuck, events=events), *ways))
